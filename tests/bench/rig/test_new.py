"""``rig new``: answers become a rig file that means what was answered; what cannot be is told with its question."""

import sys
import types
from math import inf
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field

from norton_bench.check.check import check_rig
from norton_bench.cli.new import _flat
from norton_bench.errors import RigError, UsageError
from norton_bench.rig.files import parse_toml
from norton_bench.rig.load import load_rig, parse_rig, true_parameters
from norton_bench.rig.new.interview import Interview
from norton_bench.rig.new.options import Prepared
from norton_bench.rig.rig import Command
from norton_bench.session.dry_run import dry_run
from norton_bench.session.schema import standard_session
from norton_drivers import registry
from norton_drivers.discovery import FoundPort
from norton_drivers.wiring import DeviceOptions
from tests.bench.rig.answers import COMBINATIONS, answers

RIGS = sorted((Path(__file__).parents[3] / "rigs").glob("*.toml"))
DYNO = {
    "actuator.driver": "odrive",
    "actuator.node": "1",
    "actuator.command": "0.5 N*m",
    "load.driver": "odrive",
    "load.node": "2",
    "load.torque_limit": "1 N*m",
    "torque_sensor.driver": "bota",
    "torque_sensor.port": "/dev/ttyUSB0",
    "bus.can0.channel": "can0",
    "limits.torque": "1 N*m",
    "limits.velocity": "60 rad/s",
}


def rig_of(answers: dict[str, str], **more: Any) -> Any:
    return parse_rig(Interview(Prepared(answers), "bench", **more).rig(), place="r.toml")


def test_the_fewest_answers_give_a_rig() -> None:
    rig = rig_of({"actuator.driver": "odrive", "actuator.node": "3", "actuator.command": "0.5 N*m",
                  "bus.can0.channel": "can7", "limits.velocity": "600 rpm"})  # fmt: skip
    (bus,) = rig.wiring.buses
    assert (rig.name, rig.backend, bus.interface, bus.channel) == ("bench", "hardware", "socketcan", "can7")
    assert (rig.wiring.actuator.options, rig.wiring.load, rig.wiring.shaft) == (
        {"node": 3, "watchdog": 0.3},
        None,
        "free",
    )


def test_a_dynamometer() -> None:
    rig = rig_of(DYNO)
    shipped = load_rig(next(path for path in RIGS if path.stem == "sim-odrive")).limits
    # As wide as rehearsals need on a busy computer.
    assert (rig.limits.stale_after_ns, rig.limits.stall_after_ns) == (shipped.stale_after_ns, shipped.stall_after_ns)
    assert rig.wiring.load.direction == -1
    assert rig.wiring.torque_sensor.port == "/dev/ttyUSB0"
    assert (rig.command.unit, rig.command.limit, rig.limits.load_torque_nm) == ("N*m", 0.5, 1.0)


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_a_rig_file_answers_for_itself(path: Path) -> None:
    written = parse_toml(path.read_text(), str(path))
    known = {"torque_sensor.driver": "none", "modulator.driver": "none"}  # unless they are there
    known |= _flat({key: value for key, value in written.items() if key != "simulated"})
    again, rig = rig_of(known), load_rig(path)
    assert (again.wiring.devices(), again.limits, again.command, again.modulation, again.modelled) == (
        rig.wiring.devices(),
        rig.limits,
        rig.command,
        rig.modulation,
        rig.modelled,
    )


def test_a_motor_is_what_is_taken_for_granted() -> None:
    asker = Prepared(DYNO)
    assert 'model = "dahl_motor"' in Interview(asker, "bench").rig()
    assert rig_of(DYNO).modelled
    assert not {"actuator.command.lowest", "actuator.command.sent_as"} & set(asker.asked)


def test_without_a_model_the_command_may_stand_for_something_else() -> None:
    muscle = {**DYNO, "actuator.model": "none", "actuator.command": "0.05 N*m/rad", "actuator.command.sent_as": "N*m"}
    rig = rig_of({**muscle, "actuator.command.lowest": "0 N*m/rad"})
    assert (rig.modelled, rig.command) == (False, Command("N*m/rad", 0.05, 0.0, "N*m"))
    assert rig_of(muscle).command.lowest == -inf
    plain = rig_of({**DYNO, "actuator.model": "none"})
    assert (plain.modelled, plain.command) == (False, Command("N*m", 0.5))


def test_a_load_without_a_torque_sensor_is_asked_for_and_told() -> None:
    asker = Prepared({key: value for key, value in DYNO.items() if not key.startswith("torque_sensor")})
    with pytest.raises(UsageError, match=r"torque_sensor.driver is not answered.*identified in situ"):
        Interview(asker, "bench").rig()
    in_situ = {**asker.answers, "torque_sensor.driver": "none"}
    del in_situ["limits.torque"]
    rig = rig_of(in_situ)
    assert (rig.wiring.torque_sensor, rig.wiring.load is None) == (None, False)


def test_every_option_stands_in_the_file_with_what_it_is() -> None:
    text = Interview(Prepared(DYNO), "bench").rig()
    assert '# heartbeat = "0.1 s"' in text
    assert '\nwatchdog = "300 ms"' in text  # which outlasts the stalls of an ordinary computer
    assert "silence that makes the drive stop" in text
    assert '# range = "2 N*m"' in text
    assert "node = 1                            # the drive's CAN node id, 0 to 63" in text


@pytest.mark.parametrize(
    ("key", "answer", "words"),
    [
        ("actuator.node", "64", "64 must be at most 63"),
        ("actuator.node", "one", 'expected a whole number, not "one"'),
        ("actuator.command", "0.5 Nx", '"Nx" is not a unit known here'),
        ("actuator.command", "-1 A", "not a quantity greater than 0"),
        ("actuator.model", "muscle", '"muscle" is none of dahl_motor, none'),
        ("actuator.command.lowest", "0 A", "is not in N*m"),
        ("actuator.command.sent_as", "Nx", '"Nx" is not a unit known here'),
        ("limits.velocity", "100 Hz", "is not in rad/s"),
        ("limits.torque", "0 N*m", "must be greater than 0"),
        ("rig.rate", "fast", "is not a quantity"),
        ("load.direction", "2", '"2" is none of 1, -1'),
        ("bus.can0.interface", "socketcam", '"socketcam" is none of'),
        ("actuator.driver", "odriv", '"odriv" is none of'),
        ("actuator.watchdog", "1 ms", "at least 20 ms"),
    ],
)
def test_a_wrong_answer_is_told_with_its_question(key: str, answer: str, words: str) -> None:
    with pytest.raises(UsageError, match=f"--set {key}=") as refusal:
        rig_of({**DYNO, key: answer})
    assert words in str(refusal.value)


@pytest.mark.parametrize("key", ["actuator.driver", "actuator.node", "bus.can0.channel", "limits.velocity"])
def test_what_is_not_answered_is_named(key: str) -> None:
    answers = {name: answer for name, answer in DYNO.items() if name != key}
    with pytest.raises(UsageError, match=rf"{key} is not answered: add --set {key}="):
        rig_of(answers)


def test_whoever_has_named_no_driver_is_told_all() -> None:
    every = ", ".join(registry.installed(registry.group_of("actuator")))
    with pytest.raises(UsageError, match=rf"actuator.driver is not answered.*; one of {every}\)"):
        rig_of({name: answer for name, answer in DYNO.items() if name != "actuator.driver"})


def test_answers_that_contradict_each_other_are_told_as_in_any_rig_file() -> None:
    with pytest.raises(RigError, match=r"\[actuator.command\] limit: 0.5 N\*m on a blocked shaft"):
        rig_of({**DYNO, "limits.torque": "0.1 N*m"})


def test_an_interfaces_needs_are_asked() -> None:
    answers = {**DYNO, "bus.can0.interface": "socketcand"}
    with pytest.raises(UsageError, match=r"bus.can0.options is not answered.*needs the server's host"):
        rig_of(answers)
    rig = rig_of({**answers, "bus.can0.options": '{ host = "bench.local", port = 29536 }'})
    assert rig.wiring.buses[0].options == {"host": "bench.local", "port": 29536}


def test_what_is_plugged_in_is_proposed() -> None:
    ports = (
        FoundPort("serial", "/dev/serial/by-id/usb-CANable", interface="slcan"),
        FoundPort("serial", "/dev/serial/by-id/usb-FTDI"),
    )
    answers = {key: value for key, value in DYNO.items() if key not in ("bus.can0.channel", "torque_sensor.port")}
    wiring = rig_of(answers, ports=ports).wiring
    assert (wiring.buses[0].interface, wiring.buses[0].channel) == ("slcan", "/dev/serial/by-id/usb-CANable")
    assert wiring.torque_sensor.port == "/dev/serial/by-id/usb-FTDI"


def test_two_buses() -> None:
    rig = rig_of({**DYNO, "load.bus": "can1", "bus.can1.channel": "can1"})
    assert [bus.name for bus in rig.wiring.buses] == ["can0", "can1"]
    assert (rig.wiring.actuator.bus, rig.wiring.load.bus) == ("can0", "can1")


class StrangersOptions(DeviceOptions):
    """Options as another maker's driver may declare them."""

    gain_nm_a: float = Field(alias="gain", description="torque per current", examples=["0.05 N*m/A"])
    mode: Literal["fast", "slow"] = Field(description="how it listens", examples=["fast"])
    table: dict[str, float] = Field(description="a range for each name", examples=[{"torque": 18.0}])
    version: str = Field(description="of its firmware", examples=["2"])
    quiet: bool = False


def test_a_strangers_driver_is_asked_for_what_it_declares(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("strangers_driver")
    StrangersOptions.__module__ = module.__name__
    module.__dict__.update(
        OPTION_UNITS={"gain": "N*m/A"}, CONNECTION="can", Options=StrangersOptions, open_amplifier=lambda *_: None
    )
    module.open_amplifier.__module__ = module.__name__
    monkeypatch.setitem(sys.modules, module.__name__, module)
    known = registry.installed(registry.AMPLIFIERS)
    monkeypatch.setattr(registry, "installed", lambda group: {"stranger": module} if "ampl" in group else known)
    monkeypatch.setattr(registry, "names", lambda group: ["stranger"] if "ampl" in group else ["hardware"])
    monkeypatch.setattr(registry, "load", lambda group, name, asked_by: module.open_amplifier)
    rig = rig_of(
        {
            "actuator.driver": "stranger",
            "actuator.gain": "60 mN*m/A",
            "actuator.mode": "slow",
            "actuator.table": "{ torque = 25.0 }",
            "actuator.version": "2",
            "actuator.command": "10 A",
            "bus.can0.channel": "can0",
            "limits.velocity": "60 rad/s",
        }
    )
    options = rig.wiring.actuator.options
    assert options["gain"] == pytest.approx(0.06)
    assert {**options, "gain": 0} == {"gain": 0, "mode": "slow", "table": {"torque": 25.0}, "version": "2"}


@pytest.mark.parametrize(("actuator", "load", "sensor"), COMBINATIONS, ids=["-".join(each) for each in COMBINATIONS])
def test_with_its_twin_every_bench_can_be_rehearsed(actuator: str, load: str, sensor: str) -> None:
    text = Interview(Prepared(answers(actuator, load, sensor)), "bench").rig()
    rig = parse_rig(text, place="r.toml", backend="simulated")
    assert dry_run(standard_session(rig), rig).steps[0].planned.name == "tare"
    assert check_rig(rig, watch_s=0.2).problems() == ()


def test_a_load_is_set_to_torque_and_asked_for_what_that_needs() -> None:
    given = answers("odrive", "vesc")
    assert rig_of(given).wiring.load.options["mode"] == "torque"
    del given["load.torque_constant"]
    with pytest.raises(UsageError, match=r"load.torque_constant is not answered.*=0.05 N\*m/A"):
        rig_of(given)


@pytest.mark.parametrize(
    ("mode", "command", "words"),
    [
        ("current", "0.5 N*m", 'the drive takes commands in "A" as it is set here; write it like 5 A'),
        ("duty", "5 A", 'the drive takes commands in "1" as it is set here; write it like 0.5'),
    ],
)
def test_a_command_is_asked_in_the_unit_of_the_drives_mode(mode: str, command: str, words: str) -> None:
    with pytest.raises(UsageError, match=r"--set actuator.command=") as refusal:
        rig_of({**answers("vesc"), "actuator.mode": mode, "actuator.command": command})
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    ("actuator", "load", "rate", "bitrate"),
    [
        ("odrive", "odrive", "1 kHz", 1_000_000),
        ("vesc", "none", "1 kHz", 500_000),
        ("vesc", "vesc", "1 kHz", 1_000_000),  # two of them take more than 500 kbit/s
        ("vesc", "vesc", "500 Hz", 500_000),
        ("vesc", "mit", "1 kHz", 1_000_000),
    ],
)
def test_the_bitrate_is_the_devices_own_where_it_is_enough(actuator: str, load: str, rate: str, bitrate: int) -> None:
    given = answers(actuator, "odrive" if load == "none" else load)
    given |= {"rig.rate": rate} | ({"load.driver": "none", "torque_sensor.driver": "none"} if load == "none" else {})
    assert rig_of(given).wiring.buses[0].bitrate_bit_s == bitrate


@pytest.mark.parametrize(
    ("interface", "example"),
    [("socketcan", "can0"), ("slcan", "/dev/serial/by-id/usb-..."), ("pcan", "PCAN_USBBUS1"), ("gs_usb", "0")],
)
def test_each_interface_has_an_example_of_its_own(interface: str, example: str) -> None:
    given = {key: value for key, value in DYNO.items() if key != "bus.can0.channel"}
    with pytest.raises(UsageError, match=r"bus.can0.channel is not answered") as refusal:
        rig_of({**given, "bus.can0.interface": interface})
    assert f"--set bus.can0.channel={example} " in str(refusal.value)


def test_a_drive_that_sees_no_further_bounds_the_window() -> None:
    given = {**answers("mit"), "actuator.beyond_range": "saturates"}
    unanswered = {key: value for key, value in given.items() if key != "limits.velocity"}
    with pytest.raises(UsageError, match=r"--set limits.velocity=20 rad/s .*window of 10 rad"):
        rig_of(unanswered)
    slow = parse_rig(
        Interview(Prepared({**given, "limits.velocity": "20 rad/s"}), "bench").rig(),
        place="r.toml",
        backend="simulated",
    )
    assert len(dry_run(standard_session(slow), slow).steps) == 6
    assert rig_of(given).limits.position_rad == pytest.approx(0.8 * 12.5)
    with pytest.raises(
        RigError, match=r"\[limits\] position: lets the shaft turn further than the 12.5 rad .* \[actuator"
    ):
        rig_of({**given, "limits.position": "unlimited"})
    with pytest.raises(RigError, match=r"\[limits\] velocity: 90 rad/s is not below 80 rad/s"):
        rig_of({**given, "limits.velocity": "90 rad/s"})


def test_no_twin_where_none_is_wanted() -> None:
    assert rig_of({**DYNO, "simulated.twin": "none"}).simulated == {}


def test_the_twin_has_what_the_datasheet_says_and_is_typical_elsewhere() -> None:
    given = {**answers("vesc"), "simulated.actuator.inertia": "30 g*cm^2", "simulated.twin": "datasheet"}
    asker = Prepared({**given, "simulated.torque_sensor.stiffness": "500 N*m/rad"})
    rig = parse_rig(Interview(asker, "bench").rig(), place="r.toml", backend="simulated")
    truth = true_parameters(rig)
    assert truth["inertia"][0] == pytest.approx(3e-6)
    assert truth["torque_constant"][0] == pytest.approx(0.5 / 9, rel=1e-3)  # half of what the port stands, at 9 A
    assert rig.simulated["torque_sensor"]["stiffness"] == "500 N*m/rad"
    asked = [key for key in asker.asked if key.startswith("simulated.")]
    assert asked[0] == "simulated.twin"
    assert {"simulated.actuator.coulomb_torque", "simulated.load.inertia"} <= set(asked)


def test_a_typical_twin_is_the_papers_motor_in_other_units() -> None:
    """Of twice the torque and half the velocity: inertia and damping four times, friction twice, times as they are."""
    paper = {**answers("odrive"), "limits.velocity": "80 rad/s"}
    other = {**paper, "actuator.command": "1 N*m", "limits.torque": "2 N*m", "limits.velocity": "40 rad/s"}
    one, two = (true_parameters(rig_of(given)) for given in (paper, other))
    shipped = true_parameters(load_rig(RIGS[0].parent / "sim-odrive.toml"))
    for name, factor in (("inertia", 4), ("viscous_damping", 4), ("presliding_stiffness", 4), ("coulomb_torque", 2)):
        assert one[name][0] == pytest.approx(shipped[name][0], rel=1e-3)
        assert two[name][0] == pytest.approx(factor * one[name][0], rel=1e-3)
    assert two["torque_gain"][0] == pytest.approx(one["torque_gain"][0], rel=1e-3)
