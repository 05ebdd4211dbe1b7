"""CANopen's frames: round trips, python-canopen as the independent reference, and a hundred thousand random frames."""

import random
import struct

import pytest
from canopen.nmt import NMT_COMMANDS, NMT_STATES
from canopen.profiles.p402 import OperationMode, State402
from canopen.sdo.exceptions import SdoAbortedError
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs import canopen_torque, cia402
from norton_drivers.codecs.canopen import describe_error, describe_nmt_state
from norton_drivers.codecs.canopen_torque import TorqueField
from norton_drivers.codecs.cia402 import Mode, State
from norton_drivers.codecs.common import CodecError

FRAMES = 100_000

U8, U16, U32 = st.integers(0, 0xFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF)
I8, I16 = st.integers(-0x80, 0x7F), st.integers(-0x8000, 0x7FFF)
I32 = st.integers(-0x80000000, 0x7FFFFFFF)
SHORT = st.binary(min_size=1, max_size=4)
ADDRESS = {"index": U16, "subindex": U8}

REQUESTS = st.one_of(
    st.builds(protocol.SdoRead, **ADDRESS),
    st.builds(protocol.SdoWrite, **ADDRESS, value=SHORT),
    st.builds(protocol.SdoReadSegment, toggle=st.booleans()),
    st.builds(protocol.SdoAbort, **ADDRESS, code=U32),
)
ANSWERS = st.one_of(
    st.builds(protocol.SdoValue, **ADDRESS, value=SHORT),
    st.builds(protocol.SdoLongValue, **ADDRESS, size=U32),
    st.builds(protocol.SdoSegment, toggle=st.booleans(), data=st.binary(max_size=7), last=st.booleans()),
    st.builds(protocol.SdoWritten, **ADDRESS),
    st.builds(protocol.SdoAbort, **ADDRESS, code=U32),
)


@given(REQUESTS)
def test_requests_come_back(request):
    assert protocol.sdo_request_of(request.encode()) == request


@given(ANSWERS)
def test_answers_come_back(answer):
    assert protocol.sdo_answer_of(answer.encode()) == answer


@given(st.sampled_from(protocol.NmtCommand), st.integers(0, 127))
def test_orders_come_back(command, node):
    order = protocol.NmtOrder(command, node)
    assert protocol.NmtOrder.decode(order.encode()) == order


@given(U16, U8, st.binary(min_size=5, max_size=5))
def test_emergencies_come_back(code, register, detail):
    emergency = protocol.Emergency(code, register, detail)
    assert protocol.Emergency.decode(emergency.encode()) == emergency


@given(st.sampled_from(protocol.NmtState))
def test_heartbeats_come_back(state):
    assert protocol.heartbeat_of(protocol.heartbeat(state)) is state
    assert describe_nmt_state(state)


@given(U16, I8, I16)
def test_commands_come_back(controlword, mode, target):
    assert cia402.command_of(cia402.command_value(controlword, mode, target)) == (controlword, mode, target)


@given(U16, I8, I16, I16, st.booleans())
def test_statuses_come_back(statusword, mode, torque, current, with_current):
    status = cia402.Status(statusword, mode, torque, current if with_current else 0)
    assert cia402.status_of(cia402.status_value(status, with_current=with_current), with_current=with_current) == status


@given(I32, I32)
def test_motions_come_back(position, velocity):
    assert cia402.motion_of(cia402.motion_value(cia402.Motion(position, velocity))) == (position, velocity)


@given(st.sampled_from(["i16", "i32"]), st.integers(0, 4), st.floats(-30_000, 30_000), st.integers(0, 4))
def test_whole_torques_come_back_within_half_a_digit(kind, offset, digits, more):
    end = TorqueField(kind, offset).end
    field = TorqueField(kind, offset, min(end + more, 8))
    assert field.decode(field.encode(digits)) == pytest.approx(digits, abs=0.5)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False), st.integers(0, 4))
def test_float_torques_come_back(digits, offset):
    field = TorqueField("f32", offset, 8)
    assert field.decode(field.encode(digits)) == digits


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_torque_that_is_no_number_is_none(value):
    with pytest.raises(CodecError, match="not a finite number"):
        TorqueField("f32").decode(struct.pack("<f", value))
    with pytest.raises(CodecError, match="does not fit into an i16"):
        TorqueField("i16").encode(value)


def test_a_torque_beyond_its_type_is_refused():
    with pytest.raises(CodecError, match="40000 does not fit into an i16"):
        TorqueField("i16").encode(40_000)


def test_status_bits():
    assert canopen_torque.status_of(b"\x05\x01") == 0x0105
    assert canopen_torque.status_of(bytes(range(1, 9))) == 0x04030201
    with pytest.raises(CodecError, match="empty"):
        canopen_torque.status_of(b"")


# ---- Against python-canopen's tables, and frames from the standard's text -----------------------------------------


def test_states_are_those_of_python_canopen():
    names = {state.value.upper(): state for state in State if state is not State.UNDEFINED}
    assert set(names) == set(State402.SW_MASK)
    for statusword in range(0x10000):
        theirs = [name for name, (mask, value) in State402.SW_MASK.items() if statusword & mask == value]
        ours = cia402.state_of(statusword)
        assert [ours] == [names[name] for name in theirs] if theirs else ours is State.UNDEFINED


@pytest.mark.parametrize("state", [state for state in State if state is not State.UNDEFINED])
def test_a_states_own_statusword(state):
    assert cia402.state_of(cia402.statusword_of(state)) is state


def test_modes_and_controlwords_are_those_of_python_canopen():
    assert Mode.PROFILE_TORQUE == OperationMode.PROFILED_TORQUE
    assert Mode.CYCLIC_SYNCHRONOUS_TORQUE == OperationMode.CYCLIC_SYNCHRONOUS_TORQUE
    assert Mode.PROFILE_TORQUE.supported_bit == OperationMode.SUPPORTED["PROFILED TORQUE"]
    assert Mode.CYCLIC_SYNCHRONOUS_TORQUE.supported_bit == OperationMode.SUPPORTED["CYCLIC SYNCHRONOUS TORQUE"]
    theirs = set(State402.CW_CODE_COMMANDS)
    assert {int(word) for word in cia402.Controlword} == theirs


def test_network_management_is_that_of_python_canopen():
    named = {"START": "OPERATIONAL", "STOP": "STOPPED", "PRE_OPERATIONAL": "PRE-OPERATIONAL", "RESET": "RESET",
             "RESET_COMMUNICATION": "RESET COMMUNICATION"}  # fmt: skip
    assert {named[command.name]: int(command) for command in protocol.NmtCommand}.items() <= NMT_COMMANDS.items()
    assert {int(state) for state in protocol.NmtState} <= set(NMT_STATES)


def test_abort_codes_are_those_of_python_canopen():
    ours = {value for name, value in vars(protocol).items() if name.startswith("ABORT_")}
    assert ours <= set(SdoAbortedError.CODES)


@pytest.mark.parametrize(
    ("message", "data"),
    [
        (protocol.SdoRead(0x1018, 1), "40 18 10 01 00 00 00 00"),
        (protocol.SdoWrite(0x6060, 0, b"\x0a"), "2F 60 60 00 0A 00 00 00"),
        (protocol.SdoWrite(0x1017, 0, b"\x64\x00"), "2B 17 10 00 64 00 00 00"),
        (protocol.SdoWrite(0x1016, 1, b"\x2c\x01\x7f\x00"), "23 16 10 01 2C 01 7F 00"),
        (protocol.SdoValue(0x1000, 0, b"\x92\x01\x02\x00"), "43 00 10 00 92 01 02 00"),
        (protocol.SdoLongValue(0x1008, 0, 22), "41 08 10 00 16 00 00 00"),
        (protocol.SdoReadSegment(toggle=True), "70 00 00 00 00 00 00 00"),
        (protocol.SdoSegment(toggle=True, data=b"drive", last=True), "15 64 72 69 76 65 00 00"),
        (protocol.SdoWritten(0x1017, 0), "60 17 10 00 00 00 00 00"),
        (protocol.SdoAbort(0x6007, 0, 0x06020000), "80 07 60 00 00 00 02 06"),
        (protocol.NmtOrder(protocol.NmtCommand.START, 5), "01 05"),
        (protocol.Emergency(0x8130, 0x11), "30 81 11 00 00 00 00 00"),
    ],
)
def test_bytes_as_the_standard_has_them(message, data):
    assert message.encode() == bytes.fromhex(data)


def test_identifiers():
    assert [protocol.transmit_pdo_id(5, number) for number in (1, 2, 3, 4)] == [0x185, 0x285, 0x385, 0x485]
    assert [protocol.receive_pdo_id(5, number) for number in (1, 2, 3, 4)] == [0x205, 0x305, 0x405, 0x505]
    others = (protocol.emergency_id, protocol.sdo_answer_id, protocol.sdo_request_id, protocol.heartbeat_id)
    assert [of(5) for of in others] == [0x85, 0x585, 0x605, 0x705]
    assert protocol.consumer_heartbeat(127, 300) == 0x007F012C
    assert protocol.mapping_word(0x6064, 0, 32) == 0x60640020


@pytest.mark.parametrize("node", [0, -1, 128])
def test_a_node_that_cannot_be(node):
    with pytest.raises(CodecError, match="go from 1 to 127"):
        protocol.heartbeat_id(node)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda: protocol.consumer_heartbeat(1, 70_000), "not within 0 to 65535 ms"),
        (lambda: cia402.command_value(0, 10, 40_000), "does not fit into 16 bits"),
        (lambda: cia402.status_of(bytes(7), with_current=False), "7 bytes instead of 5; the PDO's mapping is another"),
        (lambda: cia402.motion_of(bytes(6)), "6 bytes instead of 8"),
        (lambda: protocol.SdoWrite(0x1008, 0, b"12345").encode(), "1 to 4 bytes fit into one frame, not 5"),
        (lambda: protocol.SdoSegment(False, bytes(8), False).encode(), "at most 7 bytes"),
        (lambda: protocol.heartbeat_of(b""), "0 bytes instead of 1"),
        (lambda: protocol.heartbeat_of(b"\x33"), "unknown state 0x33"),
        (lambda: protocol.heartbeat_of(b"\x85"), "unknown state 0x85"),  # of the older node guarding
        (lambda: protocol.NmtOrder.decode(b"\x01"), "1 bytes instead of 2"),
        (lambda: protocol.NmtOrder.decode(b"\x44\x01"), "unknown command 0x44"),
        (lambda: protocol.Emergency.decode(bytes(7)), "7 bytes instead of 8"),
        (lambda: protocol.sdo_request_of(bytes(8)), "unknown command 0x00"),
        (lambda: protocol.sdo_answer_of(b"\xe0" + bytes(7)), "unknown command 0xE0"),
        (lambda: protocol.sdo_answer_of(bytes(4)), "4 bytes instead of 8"),
        (lambda: TorqueField("i32", 0, 4).decode(bytes(2)), "2 bytes instead of 4"),
    ],
)
def test_what_is_no_message_is_said_to_be_none(spoil, words):
    with pytest.raises(CodecError, match=words):
        spoil()


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x8130, "host's heartbeat lost (0x8130)"),
        (0x3220, "bus voltage too low: is the supply on? (0x3220)"),
        (0x3299, "voltage error (0x3299)"),
        (0x8199, "communication error (0x8199)"),
        (0xFF12, "maker's own error (0xFF12)"),
        (0x0042, "unknown error (0x0042)"),
    ],
)
def test_errors_in_words(code, words):
    assert describe_error(code) == words


def test_random_bytes_are_a_message_or_a_codec_error():
    """Whatever a bus carries: never another exception, and never a value out of a frame of the wrong length."""
    rng = random.Random(4)
    field = TorqueField("i16", 2, 6)
    decoders = {
        protocol.sdo_request_of: (8,),
        protocol.sdo_answer_of: (8,),
        protocol.NmtOrder.decode: (2,),
        protocol.Emergency.decode: (8,),
        protocol.heartbeat_of: (1,),
        cia402.command_of: (5,),
        cia402.motion_of: (8,),
        lambda data: cia402.status_of(data, with_current=False): (5,),
        lambda data: cia402.status_of(data, with_current=True): (7,),
        field.decode: (6,),
        TorqueField("f32").decode: (4,),
    }
    for _ in range(FRAMES):
        data = rng.randbytes(rng.randrange(9))
        for decode, lengths in decoders.items():
            try:
                decode(data)
            except CodecError:
                continue
            assert len(data) in lengths
