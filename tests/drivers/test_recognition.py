"""Who a frame is from: an ODrive's heartbeat among other makers' frames, a DBC file's messages, and drivers found."""

import sys
import types
from pathlib import Path

import can
import canopen as canopen_library
import cantools
import odrive_can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers import dbc_sensor, registry
from norton_drivers.canopen import node as canopen
from norton_drivers.codecs.odrive import AxisState, EncoderEstimates, Heartbeat, MessageId, arbitration_id
from norton_drivers.mit import replies as mit
from norton_drivers.odrive.drive import recognise
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Recognition, answers_remotely, nobodys
from norton_drivers.vesc import messages as vesc


def message(identifier: int, data: bytes = b"", *, extended: bool = False, remote: bool = False) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended, is_remote_frame=remote)


@given(st.integers(0, 63), st.sampled_from([state for state in AxisState if state]), st.integers(0, 2**32 - 1))
def test_every_odrives_heartbeat_is_sure(node, state, errors):
    found = recognise(message(arbitration_id(node, MessageId.HEARTBEAT), Heartbeat(errors, state).encode()), {})
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
    assert recognise(message(arbitration_id(3, MessageId.SET_INPUT_TORQUE), bytes(8)), {}).from_host
    assert not recognise(message(arbitration_id(3, MessageId.IQ), bytes(8)), {}).from_host


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.booleans(), st.booleans())
def test_any_frame_may_be_shown(identifier, data, extended, remote):
    """No error is raised."""
    frame = message(identifier if extended else identifier & 0x7FF, data, extended=extended, remote=remote)
    for offered in registry.recognition().values():
        if offered.recognise is not None:
            offered.recognise(frame, {})


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
    monkeypatch.setattr(registry, "_entries", lambda group: entries if group == registry.AMPLIFIERS else [])
    assert registry.installed(registry.AMPLIFIERS) == {"stranger": module}
    assert registry.recognition() == {"stranger": Recognition(module.recognise)}


# ---- Other families -------------------------------------------------------------------------------------------------


def sent(identifier: int, data: bytes, *, extended: bool = False, remote: bool = False) -> RawFrame:
    return RawFrame(0, "can0", True, data, identifier, extended, remote)


def heard(identifier: int, data: bytes, *, extended: bool = False) -> RawFrame:
    return RawFrame(1, "can0", False, data, identifier, extended)


@pytest.mark.parametrize(
    ("frame", "says", "sure", "from_host"),
    [
        (message(0x705, b"\x05"), "heartbeat", True, False),
        (message(0x705, b"\x7f"), "heartbeat", True, False),
        (message(0x705, b"\x33"), "heartbeat", False, False),  # no state that there is
        (message(0x585, bytes.fromhex("4300100092010200")), "answers", True, False),
        (message(0x585, bytes.fromhex("4b41600037020000")), "answers", False, False),
        (message(0x185, bytes(8)), "PDO 1", False, False),
        (message(0x085, bytes(8)), "emergency", False, False),
        (message(0x205, bytes(8)), "command", False, True),
        (message(0x605, bytes(8)), "command", False, True),
    ],
)
def test_canopen(frame, says, sure, from_host):
    found = canopen.recognise(frame, {})
    assert (found.says, found.sure, found.from_host, found.options) == (says, sure, from_host, {"node": 5})


@pytest.mark.parametrize(
    "frame", [message(0x080), message(0x000, b"\1\0"), message(0x705, bytes(8)), message(0x705, b"\5", extended=True)]
)
def test_what_is_not_a_canopen_devices(frame):
    assert canopen.recognise(frame, {}) is None


def test_python_canopens_boot_up_is_known():
    """As the slave of python-canopen, which nobody here wrote, sends it."""
    network, got = canopen_library.Network(), []
    network.send_message = lambda can_id, data, remote=False: got.append(message(can_id, bytes(data)))
    node = canopen_library.LocalNode(9, str(Path(canopen.__file__).parent / "eds" / "cia402.eds"))
    node.associate_network(network)
    node.nmt.send_command(0)
    (boot_up,) = got
    assert (canopen.recognise(boot_up, {}).options, canopen.recognise(boot_up, {}).sure) == ({"node": 9}, True)


def test_vesc():
    status = message(0x0901, bytes(8), extended=True)
    assert (vesc.recognise(status, {}).says, vesc.recognise(status, {}).options) == ("STATUS_1", {"node": 1})
    assert vesc.recognise(message(0x0901, bytes(8)), {}) is None
    assert vesc.recognise(message(0x12FE, b"\x17\x00", extended=True), {}).options == {"node": 0x17}
    assert vesc.recognise(message(0x0117, bytes(4), extended=True), {}).from_host
    assert vesc.recognise(message(0x18FF0917, bytes(8), extended=True), {}) is None  # J1939's identifiers are far above


def test_a_vescs_answer_to_a_ping():
    ping = sent(0x1117, b"\xfe", extended=True)
    assert vesc.answers(ping, heard(0x12FE, b"\x17\x00", extended=True))
    assert not vesc.answers(ping, heard(0x12FE, b"\x18\x00", extended=True))
    assert not vesc.answers(ping, heard(0x12FD, b"\x17\x00", extended=True))
    assert not vesc.answers(sent(0x0117, bytes(4), extended=True), heard(0x12FE, b"\x17\x00", extended=True))


def test_mit():
    reply = message(0, bytes([3, *bytes(5)]))
    assert mit.recognise(reply, {}).options == {"node": 3}
    assert mit.recognise(message(0x10, bytes([3, *bytes(7)])), {"master": 0x10}).options == {"node": 3}
    assert mit.recognise(message(0, bytes(2)), {}) is None  # network management of CANopen
    assert mit.answers(sent(3, bytes(8)), heard(0, bytes([3, *bytes(5)])))
    assert not mit.answers(sent(3, bytes(8)), heard(0, bytes([4, *bytes(5)])))


def test_an_sdos_answer():
    question = sent(0x605, bytes(8))
    assert canopen.answers(question, heard(0x585, bytes(8)))
    assert not canopen.answers(question, heard(0x586, bytes(8)))
    assert not canopen.answers(sent(0x205, bytes(8)), heard(0x585, bytes(8)))


def test_a_remote_frames_answer():
    assert answers_remotely(sent(0x20, b"", remote=True), heard(0x20, bytes(8)))
    assert not answers_remotely(sent(0x20, bytes(8)), heard(0x20, bytes(8)))
    assert not answers_remotely(sent(0x20, b"", remote=True), heard(0x21, bytes(8)))


@pytest.mark.parametrize("offers", [canopen, mit, vesc])
def test_probes_are_answered_by_their_own_kind_and_come_once_to_each(offers):
    questions = list(offers.probes({}, set()))
    assert len(set(questions)) == len(questions) > 100


def test_probes_keep_away_from_others():
    odrive_at_2 = {0x41, 0x49}
    assert {question.arbitration_id for question in mit.probes({}, odrive_at_2)} & set(range(0x40, 0x60)) == set()
    assert {question.arbitration_id for question in mit.probes({}, {0x000})} == set(
        range(1, 128)
    )  # its own kind answers
    odrive_at_48 = {0x601}
    assert all(question.arbitration_id >= 0x620 for question in canopen.probes({}, odrive_at_48))
    assert nobodys(0x60, {0x41})
    assert not nobodys(0x5F, {0x41})
