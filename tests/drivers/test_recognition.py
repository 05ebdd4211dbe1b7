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
from norton_drivers.codecs import damiao as damiao_codec
from norton_drivers.codecs import robstride as robstride_codec
from norton_drivers.codecs.cubemars import Upload
from norton_drivers.codecs.odrive import AxisState, EncoderEstimates, Heartbeat, MessageId, arbitration_id
from norton_drivers.cubemars import drive as cubemars
from norton_drivers.damiao import messages as damiao
from norton_drivers.mit import replies as mit
from norton_drivers.odrive.drive import recognise
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Recognition, answers_remotely, nobodys
from norton_drivers.robstride import messages as robstride
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


def test_a_reply_with_a_temperature_where_an_error_would_be_is_a_damiaos():
    told = damiao_codec.Feedback(3, damiao_codec.DISABLED, 32767, 2047, 2047, 30, 29).encode()
    assert mit.recognise(message(0x11, told), {}) is None
    assert mit.recognise(message(0x11, told), {"master": 0x11}) is None
    assert damiao.recognise(message(0x11, told), {}).options == {"node": 3, "master": 0x11}
    cubemars_reply = bytes((3, *told[1:6], 30, 0))
    assert damiao.recognise(message(0x11, cubemars_reply), {"master": 0x11}) is None
    assert mit.recognise(message(0x11, cubemars_reply), {}).options == {"node": 3, "master": 0x11}


def test_a_damiaos_feedback_in_motion_is_known_under_its_master_alone():
    told = damiao_codec.Feedback(3, damiao_codec.ENABLED, 1, 4000, 100, 30, 29).encode()
    assert damiao.recognise(message(0x11, told), {}) is None
    assert damiao.recognise(message(0x11, told), {"master": 0x11}).options == {"node": 3, "master": 0x11}
    assert damiao.recognise(message(0x11, told, extended=True), {"master": 0x11}) is None


def test_a_damiaos_own_identifier_is_sure():
    raw = damiao_codec.raw_of(8, 5)
    told = damiao_codec.RegisterFrame(5, 0x33, 8, raw).encode()
    assert damiao.recognise(message(0x7F, told), {}).options == {"node": 5, "master": 0x7F}
    other = damiao_codec.RegisterFrame(4, 0x33, 8, raw).encode()
    assert damiao.recognise(message(0x7F, other), {}) is None  # it contradicts itself


def test_a_damiaos_answers():
    told = heard(0x11, damiao_codec.Feedback(3, 1, 0x1234, 0, 0, 30, 30).encode())
    register = heard(0x11, damiao_codec.RegisterFrame(3, 0x33, 23).encode())
    refresh, read = (sent(0x7FF, bytes((3, 0, *asked, 0, 0, 0, 0))) for asked in ((0xCC, 0), (0x33, 23)))
    assert (damiao.answers(refresh, told), damiao.answers(refresh, register)) == (True, False)
    assert (damiao.answers(read, told), damiao.answers(read, register)) == (False, True)
    assert not damiao.answers(sent(0x7FF, bytes((4, 0, 0xCC, 0, 0, 0, 0, 0))), told)
    assert not damiao.answers(sent(3, bytes(8)), told)  # asked once, it might be answered beside one asked before


def robstride_message(identifier: int, data: bytes) -> can.Message:
    return message(identifier, data, extended=True)


def test_robstride():
    feedback = robstride_message(*robstride_codec.Feedback(9, 2, 0, 1, 2, 3, 300).encode(0xFD))
    assert (robstride.recognise(feedback, {}).options, robstride.recognise(feedback, {}).sure) == ({"node": 9}, True)
    answer = robstride_message(*robstride_codec.answer_value(9, 0xFD, 0x7005, bytes(4)))
    assert (robstride.recognise(answer, {}).options, robstride.recognise(answer, {}).sure) == ({"node": 9}, True)
    command = robstride_message(*robstride_codec.torque_value(9, 32768))
    assert robstride.recognise(command, {}).from_host
    question = robstride_message(*robstride_codec.read_value(9, 0xFD, 0x7005))
    assert robstride.recognise(question, {}) is None
    cold = robstride_message(*robstride_codec.Feedback(9, 2, 0, 1, 2, 3, 0).encode(0xFD))
    assert not robstride.recognise(cold, {}).sure
    assert not robstride.recognise(message(0x18FF0917, bytes(8), extended=True), {}).sure  # J1939


def test_a_robstrides_answers():
    question = sent(*robstride_codec.read_value(9, 0xFD, 0x7005), extended=True)
    assert robstride.answers(question, heard(*robstride_codec.answer_value(9, 0xFD, 0x7005, bytes(4)), extended=True))
    feedback = robstride_codec.Feedback(9, 2, 0, 1, 2, 3, 300).encode(0xFD)
    assert not robstride.answers(question, heard(*feedback, extended=True))
    version = sent(0x0400FD09, robstride_codec.VERSION_QUESTION, extended=True)
    assert not robstride.answers(version, heard(*feedback, extended=True))
    command = sent(*robstride_codec.torque_value(9, 32768), extended=True)
    assert robstride.answers(command, heard(*feedback, extended=True))
    assert not robstride.answers(
        sent(*robstride_codec.torque_value(8, 0), extended=True), heard(*feedback, extended=True)
    )


def test_a_robstride_that_greets_is_no_vesc_and_no_cubemars():
    """Switched on, it sends its own identifier, 0xFE, and eight bytes: 0x09 is STATUS, 0x12 a pong, 0x29 an upload."""
    for node in (0x09, 0x12, 0x29):
        greeting = message(node << 8 | 0xFE, bytes.fromhex("0102030405060700"), extended=True)
        assert cubemars.recognise(greeting, {}) is None
        found = vesc.recognise(greeting, {})
        assert found is None or not found.sure


def test_cubemars():
    told = message(0x2968, Upload(12, 100.0, 1.0, 30, 0).encode(), extended=True)
    assert (cubemars.recognise(told, {}).options, cubemars.recognise(told, {}).sure) == ({"node": 0x68}, True)
    assert vesc.recognise(told, {}) is None
    assert robstride.recognise(told, {}) is None
    assert cubemars.recognise(message(0x2968, bytes.fromhex("000C0E740E730E74"), extended=True), {}) is None  # VESC BMS


def test_an_sdos_answer():
    question = sent(0x605, bytes(8))
    assert canopen.answers(question, heard(0x585, bytes(8)))
    assert not canopen.answers(question, heard(0x586, bytes(8)))
    assert not canopen.answers(sent(0x205, bytes(8)), heard(0x585, bytes(8)))


def test_a_remote_frames_answer():
    assert answers_remotely(sent(0x20, b"", remote=True), heard(0x20, bytes(8)))
    assert not answers_remotely(sent(0x20, bytes(8)), heard(0x20, bytes(8)))
    assert not answers_remotely(sent(0x20, b"", remote=True), heard(0x21, bytes(8)))


@pytest.mark.parametrize("offers", [canopen, damiao, mit, robstride, vesc])
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
