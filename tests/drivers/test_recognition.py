"""Who a frame is from: an ODrive's heartbeat among other makers' frames, a DBC file's messages, and drivers found."""

import sys
import types
from pathlib import Path

import can
import cantools
import odrive_can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import dbc_sensor, registry
from drivers.codecs.odrive import AxisState, Command, EncoderEstimates, Heartbeat, arbitration_id
from drivers.odrive.recognition import recognise


def message(identifier: int, data: bytes = b"", *, extended: bool = False, remote: bool = False) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended, is_remote_frame=remote)


@given(st.integers(0, 63), st.sampled_from([state for state in AxisState if state]), st.integers(0, 2**32 - 1))
def test_every_odrives_heartbeat_is_sure(node, state, errors):
    found = recognise(message(arbitration_id(node, Command.HEARTBEAT), Heartbeat(errors, state).encode()), {})
    assert (found.device, found.says, found.options, found.sure, found.from_host) == (
        "an ODrive",
        "heartbeat",
        {"node": node},
        True,
        False,
    )


@pytest.mark.parametrize("path", sorted(Path(odrive_can.__file__).parent.glob("dbc/*.dbc")), ids=lambda path: path.stem)
def test_heartbeats_as_odrive_cans_dbc_files_have_them(path):
    """Of firmware 0.5 and 0.6, by descriptions that nobody here wrote."""
    for each in cantools.database.load_file(path).messages:
        if each.name.endswith("_Heartbeat"):
            values = {signal.name: 0 for signal in each.signals} | {"Axis_State": 1}
            found = recognise(message(each.frame_id, each.encode(values, strict=False)), {})
            assert (found.says, found.sure, found.options) == ("heartbeat", True, {"node": each.frame_id >> 5})


@pytest.mark.parametrize(
    ("frame", "sure"),
    [
        (message(0x701, b"\x05"), False),  # a CANopen heartbeat, which has one byte
        (message(0x181, bytes(8)), False),  # a TPDO of zeros: no state of an ODrive's
        (message(0x061, bytes.fromhex("00000000ff000000")), False),
        (message(0x069, EncoderEstimates(0.25, 1.0).encode()), False),
        (message(0x061, Heartbeat(0, AxisState.IDLE).encode(), extended=True), None),
        (message(0x061, remote=True), None),
    ],
)
def test_what_others_send_is_not_sure(frame, sure):
    found = recognise(frame, {})
    assert (found is None) if sure is None else (found is not None and found.sure is sure)


def test_commands_are_known_to_come_from_a_host():
    assert recognise(message(arbitration_id(3, Command.SET_INPUT_TORQUE), bytes(8)), {}).from_host
    assert not recognise(message(arbitration_id(3, Command.IQ), bytes(8)), {}).from_host


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.booleans(), st.booleans())
def test_any_frame_may_be_shown(identifier, data, extended, remote):
    frame = message(identifier if extended else identifier & 0x7FF, data, extended=extended, remote=remote)
    for recogniser in registry.recognisers().values():
        recogniser(frame, {})


def test_a_dbc_files_messages():
    assert dbc_sensor.recognise(message(0x321, bytes(8)), {}).options == {"message": "TorqueReading"}
    assert dbc_sensor.recognise(message(0x321, bytes(8), extended=True), {}) is None
    assert dbc_sensor.recognise(message(0x322, bytes(8)), {}) is None
    assert dbc_sensor.recognise(message(0x321, bytes(8)), {"dbc": "/no/such.dbc"}) is None


def test_ones_own_dbc_file(tmp_path: Path):
    shipped = (Path(dbc_sensor.__file__).parent / "dbc" / "torque-sensor.dbc").read_text()
    (tmp_path / "mine.dbc").write_text(shipped.replace("801", "802"))
    options = {"dbc": str(tmp_path / "mine.dbc")}
    assert dbc_sensor.recognise(message(802, bytes(8)), options).device == "the device that mine.dbc describes"


class _Entry:
    """An entry point, as far as it is used."""

    def __init__(self, name: str, module: types.ModuleType | None) -> None:
        self.name = name
        self.module = module

    def load(self):
        if self.module is None:
            raise SyntaxError("a stranger's mistake")
        return self.module.open_amplifier


def test_drivers_are_found_and_broken_ones_left_out(monkeypatch):
    module = types.ModuleType("a_strangers_driver")
    module.open_amplifier = lambda settings, link: None
    module.open_amplifier.__module__ = module.__name__
    module.recognise = lambda frame, options: None
    monkeypatch.setitem(sys.modules, module.__name__, module)
    entries = [_Entry("stranger", module), _Entry("broken", None)]
    monkeypatch.setattr(registry, "entry_points", lambda group: entries if group == registry.AMPLIFIERS else [])
    assert registry.installed(registry.AMPLIFIERS) == {"stranger": module}
    assert registry.recognisers() == {"stranger": module.recognise}
