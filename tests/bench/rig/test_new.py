"""``rig new``: answers become a rig file that means what was answered; what cannot be is told with its question."""

import sys
import types
from math import inf
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field

from norton_bench.cli.new import _flat
from norton_bench.errors import RigError, UsageError
from norton_bench.rig.files import parse_toml
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.rig.new.interview import Interview
from norton_bench.rig.new.questions import Prepared
from norton_bench.rig.rig import Command
from norton_drivers import registry
from norton_drivers.discovery import FoundPort
from norton_drivers.options import DeviceOptions

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
    assert (rig.wiring.actuator.options, rig.wiring.load, rig.wiring.shaft) == ({"node": 3}, None, "free")


def test_a_dynamometer() -> None:
    rig = rig_of(DYNO)
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
    assert '# watchdog = "0.1 s"' in text
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
