"""Every family of drives, mis-set in every way that the bench should notice: each told in a sentence with the mend."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from norton_bench.check.check import Permission, check_rig
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.rig.rig import Rig

pytestmark = pytest.mark.long

RIGS = Path(__file__).parents[3] / "rigs"
NAMES = ("odrive", "cia402", "mit", "moteus", "vesc", "damiao", "robstride", "cubemars", "dyn200")
ODRIVE, CIA402, MIT, MOTEUS, VESC, DAMIAO, ROBSTRIDE, CUBEMARS, DYN200 = (RIGS / f"sim-{name}.toml" for name in NAMES)
KINDS = {
    ODRIVE: "an ODrive",
    CIA402: "a CANopen device",
    MIT: "an actuator in MIT mode",
    MOTEUS: "a moteus controller",
    VESC: "a VESC",
    DAMIAO: "a Damiao motor",
    ROBSTRIDE: "a RobStride motor",
    CUBEMARS: "a CubeMars actuator in servo mode",
}


def really(rig: Rig, role: str, **device: Any) -> Rig:
    """``rig`` on a bench where one device is set up otherwise."""
    table = {**rig.simulated[role], "device": {**rig.simulated[role].get("device", {}), **device}}
    return replace(rig, simulated={**rig.simulated, role: table})


def sentences(rig: Rig, *, move: bool = False) -> list[str]:
    """What is told at half the rate: the devices send as often as they do."""
    rig = replace(rig, wiring=replace(rig.wiring, tick_ns=2 * rig.tick_ns))
    permission = Permission(lambda _text: None) if move else None
    return [str(problem) for problem in check_rig(rig, seed=1, move=permission).problems()]


@pytest.mark.parametrize("path", KINDS, ids=lambda path: path.stem)
def test_a_bench_in_order_moved_and_unmoved(path: Path) -> None:
    assert sentences(load_rig(path), move=True) == []


@pytest.mark.parametrize("path", KINDS, ids=lambda path: path.stem)
def test_a_wrong_node(path: Path) -> None:
    rig = load_rig(path)
    node = rig.wiring.actuator.options["node"]
    (sentence,) = sentences(really(rig, "actuator", node=13))
    assert f"nobody is heard at node = {node}" in sentence
    assert f", but {KINDS[path]} at node = 13" in sentence
    assert re.search(rf"set node = 13.*, or give the device node = {node}", sentence)


@pytest.mark.parametrize("path", [MIT, DAMIAO], ids=lambda path: path.stem)
def test_a_wrong_master(path: Path) -> None:
    (sentence,) = sentences(really(load_rig(path), "actuator", master=9))
    assert f"but {KINDS[path]} at node = 1, master = 9 (" in sentence
    assert "): set node = 1, master = 9, or " in sentence


def twins(path: Path) -> Rig:
    """A rig whose load is of the actuator's kind, and really set to the actuator's node."""
    text = path.read_text()
    actuator, load = (re.search(rf"^\[{role}\].*?(?=^\[)", text, re.S | re.M) for role in ("actuator", "load"))
    assert actuator is not None
    assert load is not None
    copied = re.sub(r"^command = .*\n", "", actuator[0].replace("[actuator]", "[load]"), flags=re.M)
    copied = re.sub(r"^node = \d+", "node = 14", copied, flags=re.M).rstrip()
    # A load is commanded in newton metres.
    copied = re.sub(r'^mode = "current".*$', 'mode = "torque"\ntorque_constant = "0.05 N*m/A"', copied, flags=re.M)
    text = re.sub(r"^\[bus\.can1\].*?(?=^\[)", "", text, flags=re.S | re.M)  # where the load was alone
    rig = parse_rig(text.replace(load[0], f'{copied}\ntorque_limit = "1 N*m"\ndirection = -1\n\n'), place="twins.toml")
    return really(rig, "load", node=rig.wiring.actuator.options["node"])


@pytest.mark.parametrize("path", [path for path in KINDS if path != CUBEMARS], ids=lambda path: path.stem)
def test_two_devices_with_one_id(path: Path) -> None:
    found = sentences(twins(path))
    assert any("bus can0: two devices share the address of [actuator]" in each for each in found)
    assert any(each.startswith("[load] ") and "does not answer" in each for each in found)


@pytest.mark.parametrize("rate", [{"bitrate": "500 kbit/s"}, {"data_bitrate": "2 Mbit/s"}], ids=["bitrate", "data"])
def test_a_wrong_bitrate_of_who_is_alone_on_its_bus(rate: dict[str, str]) -> None:
    (sentence,) = sentences(really(load_rig(MOTEUS), "actuator", **rate))
    assert "not one frame is heard, but errors are (bus error " in sentence
    assert "bitrate = 1000000 bit/s (data 5000000 bit/s) is probably not the devices'" in sentence


@pytest.mark.parametrize("path", [path for path in KINDS if path != MOTEUS], ids=lambda path: path.stem)
def test_a_wrong_bitrate(path: Path) -> None:
    (sentence,) = sentences(really(load_rig(path), "actuator", bitrate="500 kbit/s"))
    assert "can be heard, and errors (bus error " in sentence
    assert "is it set to 1000000 bit/s" in sentence


@pytest.mark.parametrize(("path", "baud"), [(ODRIVE, 115_200), (DYN200, 9_600)], ids=["bota", "dyn200"])
def test_a_wrong_baud(path: Path, baud: int) -> None:
    (sentence,) = sentences(really(load_rig(path), "torque_sensor", baud=baud))
    assert f"it speaks at {baud} baud, not at " in sentence
    assert f"set baud = {baud}" in sentence


def test_a_wrong_firmware() -> None:
    (sentence,) = sentences(really(load_rig(ODRIVE), "actuator", firmware="0.5"))
    assert "answers as firmware 0.5 does" in sentence
    assert 'write firmware = "0.5"' in sentence


def swapped_sensor(rig: Rig) -> Rig:
    table = {**rig.simulated["torque_sensor"], "mounted": -rig.simulated["torque_sensor"]["mounted"]}
    return replace(rig, simulated={**rig.simulated, "torque_sensor": table})


@pytest.mark.parametrize("path", KINDS, ids=lambda path: path.stem)
def test_a_swapped_sensor_sign(path: Path) -> None:
    rig = swapped_sensor(load_rig(path))
    assert sentences(rig) == []
    (sentence,) = sentences(rig, move=True)
    assert "reverse [torque_sensor] direction" in sentence


Wrong = Callable[[Rig], Rig]


@pytest.mark.parametrize(
    ("path", "device", "words"),
    [
        (MIT, {"velocity_range": "100 rad/s"}, "[actuator] its velocity readings say 0.49 times what its positions do"),
        (MIT, {"position_range": "25 rad"}, "[actuator] turned 0.50 times as far as [load]"),
        (MIT, {"torque_range": "36 N*m", "watchdog_probe": "0 N*m"}, "by [load] and [torque_sensor]: check its torque"),
        (CIA402, {"torque_per_unit": "1 mN*m"}, "[actuator] gives 1.7"),
        (CIA402, {"counts_per_turn": 65536}, "[actuator] turned 0.50 times as far as [load]"),
        (CIA402, {"velocity_per_unit": "0.002 rpm"}, "[actuator] its velocity readings say 0.50 times"),
        (VESC, {"pole_pairs": 14}, "[actuator] its velocity readings say 1.9"),
    ],
)
def test_a_wrong_table_of_scales(path: Path, device: dict[str, Any], words: str) -> None:
    rig = really(load_rig(path), "actuator", **device)
    assert sentences(rig) == []  # at rest nothing shows
    assert any(words in each for each in sentences(rig, move=True))
