"""VESC's frames against vectors from its documentation and a package that sends such, its packets against vectors and a
CRC that others wrote."""

import math
import struct
from contextlib import suppress
from types import SimpleNamespace

import crccheck
import pytest
from hypothesis import given
from hypothesis import strategies as st
from TMotorCANControl import servo_can
from TMotorCANControl.servo_can import CAN_Manager_servo

from norton_drivers.codecs import vesc
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import Packet, describe_fault

# vedderb/bldc, documentation/comm_can.md: "setting the current to 51 A on VESC ID 23".
DOCUMENTED = (0x0117, bytes.fromhex("0000C738"))

# By hand from the same document's tables: big-endian, with the scales given there.
TABLE = [
    (vesc.Status(1000.0, 1.2, 0.345), ">ihh", (1000, 12, 345)),
    (vesc.Status(-70_000.0, -12.3, -0.95), ">ihh", (-70_000, -123, -950)),
    (vesc.Status4(31.5, -5.0, 2.5, 359.98), ">hhhh", (315, -50, 25, 17999)),
    (vesc.Status5(-42, 24.1), ">ihxx", (-42, 241)),
]

# CubeMars, AK Series Actuator Driver Manual V1.0.8, section 5.2.2, whose drives speak VESC's packets on a serial line:
# 02, length, payload, CRC, 03.
SERIAL_LINES = [
    "02 01 04 40 84 03",
    "02 05 05 00 00 4E 20 29 F6 03",
    "02 05 05 FF FF B1 E0 77 85 03",
    "02 05 06 00 00 13 88 8B 25 03",
    "02 05 06 FF FF EC 78 E3 05 03",
    "02 05 08 00 00 03 E8 2B 58 03",
    "02 05 08 FF FF FC 18 43 78 03",
    "02 0D 5B 00 02 BF 20 00 00 13 88 00 00 75 30 A5 AC 03",
]


def test_the_documented_example():
    identifier, data = DOCUMENTED
    assert vesc.arbitration_id(Packet.SET_CURRENT, 23) == identifier
    assert vesc.split_id(identifier) == (Packet.SET_CURRENT, 23)
    assert vesc.current_value(51.0) == data
    assert vesc.current_of(data) == 51.0


def test_a_duty_cycle_as_documented():
    assert vesc.duty_value(-0.5) == struct.pack(">i", -50_000)
    assert vesc.duty_of(struct.pack(">i", 20_000)) == 0.2


@pytest.fixture(scope="module")
def stranger():
    """TMotorCANControl's host for CubeMars' servo mode, whose commands are a VESC's; it lacks a name that it uses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(servo_can, "send_index", 4, raising=False)
        yield SimpleNamespace(buffer_append_int32=CAN_Manager_servo.buffer_append_int32)


@given(st.integers(-60_000, 60_000), st.integers(0, 254))
def test_a_current_as_a_third_party_packs_it(stranger, milliamperes, node):
    sent = []
    stranger.send_servo_message = lambda identifier, data, _length: sent.append((identifier, bytes(data)))
    # It cuts off where we round: a little further out both come to the same.
    CAN_Manager_servo.comm_can_set_current(stranger, node, milliamperes / 1000 + math.copysign(1e-7, milliamperes))
    assert sent == [(vesc.arbitration_id(Packet.SET_CURRENT, node), vesc.current_value(milliamperes / 1000))]


@given(st.integers(-95_000, 95_000), st.integers(0, 254))
def test_a_duty_cycle_as_a_third_party_packs_it(stranger, share, node):
    sent = []
    stranger.send_servo_message = lambda identifier, data, _length: sent.append((identifier, bytes(data)))
    CAN_Manager_servo.comm_can_set_duty(stranger, node, share / 1e5 + math.copysign(1e-9, share))
    assert sent == [(vesc.arbitration_id(Packet.SET_DUTY, node), vesc.duty_value(share / 1e5))]


@pytest.mark.parametrize(("message", "layout", "numbers"), TABLE, ids=lambda value: str(value)[:20])
def test_status_in_both_directions(message, layout, numbers):
    data = struct.pack(layout, *numbers)
    # Some decimals lie a little below their multiple in binary, and the cast would cut that off.
    nudged = (math.copysign(abs(value) + 1e-9, value) if isinstance(value, float) else value for value in message)
    assert type(message)(*nudged).encode() == data
    assert type(message).decode(data) == pytest.approx(message)
    assert type(message).decode(bytearray(data)) == type(message).decode(data)


def test_the_reserved_end_of_status_5_may_be_missing():
    assert vesc.Status5.decode(struct.pack(">ih", 7, 240)) == vesc.Status5(7, 24.0)


def test_commands_are_four_bytes_for_six_are_misread():
    """comm_can.c reads an off delay from the first two bytes of six, and the current from the four that follow."""
    assert len(vesc.current_value(3.0)) == len(vesc.duty_value(0.1)) == 4
    six = struct.pack(">ih", 51_000, 100)
    assert vesc.current_of(six) == struct.unpack(">i", six[2:])[0] / 1000 != 51.0


@given(st.floats(-2e6, 2e6))
def test_a_current_comes_back_within_half_a_milliampere(current_a):
    assert abs(vesc.current_of(vesc.current_value(current_a)) - current_a) <= 0.5e-3 + 1e-9


@given(st.floats(-1, 1))
def test_a_duty_cycle_comes_back_within_half_its_last_digit(duty):
    assert abs(vesc.duty_of(vesc.duty_value(duty)) - duty) <= 0.5e-5 + 1e-12


@given(st.floats(-3000, 3000), st.floats(-1e5, 1e5))
def test_what_the_cast_cuts_off_is_given_back_as_the_middle(current_a, erpm):
    back = vesc.Status.decode(vesc.Status(erpm, current_a, 0.5).encode())
    for sent, read, step in ((current_a, back.drawn_a, 0.1), (erpm, back.erpm, 1.0)):
        assert abs(read) <= abs(sent) + 1e-9
        # Half a step, but for what is less than one step either way of zero.
        within = 0.5 * step if abs(sent) >= step else step
        assert abs(vesc.middle(read, step) - sent) <= within + 1e-6


@given(st.floats(0, 359.999), st.floats(-40, 150), st.integers(-(1 << 40), 1 << 40))
def test_slow_values_come_back_within_a_step(position_deg, celsius, sixths):
    slow = vesc.Status4.decode(vesc.Status4(celsius, celsius, 1.0, position_deg).encode())
    assert 0 <= position_deg - slow.position_deg <= vesc.POSITION_STEP_DEG + 1e-9
    assert abs(slow.transistor_c - celsius) <= 0.1 + 1e-9
    assert (vesc.Status5.decode(vesc.Status5(sixths, 24.0).encode()).tachometer - sixths) % vesc.TACHOMETER_SPAN == 0


@pytest.mark.parametrize(
    ("drawn_a", "duty", "current_a"),
    [(2.0, 0.1, 2.0), (-2.0, 0.1, -2.0), (2.0, -0.1, -2.0), (-2.0, -0.1, 2.0), (0.0, 0.3, 0.0), (1.0, 0.0, None)],
)
def test_the_sign_of_a_current_is_told_with_that_of_the_voltage(drawn_a, duty, current_a):
    """STATUS says whether the motor draws or generates, not which way it pushes."""
    assert vesc.Status(0.0, drawn_a, duty).current_a == current_a


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e12, -1e308])
def test_what_cannot_be_sent(value):
    for encode in (vesc.current_value, vesc.duty_value):
        with pytest.raises(CodecError):
            encode(value)


@pytest.mark.parametrize("node", [-1, 256])
def test_a_controller_id_that_cannot_be(node):
    with pytest.raises(CodecError, match="0 to 254"):
        vesc.arbitration_id(Packet.PING, node)


# ---- packets --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", SERIAL_LINES)
def test_the_checksum_of_published_packets(line):
    data = bytes.fromhex(line)
    payload, checksum = data[2:-3], int.from_bytes(data[-3:-1], "big")
    *_, closing = vesc.frames_of(payload * 7, sender=1, receiver=2, handling=0)
    assert crccheck.crc.CrcXmodem.calc(payload) == checksum  # the same polynomial
    assert int.from_bytes(closing.data[-2:], "big") == crccheck.crc.CrcXmodem.calc(payload * 7)


def test_a_short_packet_by_hand():
    """comm_can_send_buffer: sender, what to do, payload, in one frame."""
    (frame,) = vesc.frames_of(bytes.fromhex("3200008000"), sender=254, receiver=23, handling=0)
    assert frame == (0x0817, bytes.fromhex("FE003200008000"))
    assert vesc.ask_fault() == bytes.fromhex("3200008000")


def test_a_long_packet_by_hand():
    payload = bytes(range(10))
    frames = list(vesc.frames_of(payload, sender=23, receiver=254, handling=1))
    crc = crccheck.crc.CrcXmodem.calc(payload).to_bytes(2, "big")
    assert frames == [
        (0x05FE, bytes((0, 0, 1, 2, 3, 4, 5, 6))),
        (0x05FE, bytes((7, 7, 8, 9))),
        (0x07FE, bytes((23, 1, 0, 10)) + crc),
    ]


def assembled(frames):
    assembler = vesc.Assembler()
    found = [assembler.feed(frame.arbitration_id >> 8, frame.data) for frame in frames]
    return [each for each in found if each is not None], assembler


@given(st.binary(min_size=1, max_size=vesc.LONGEST), st.integers(0, 255), st.integers(0, 2))
def test_packets_of_every_length_come_back(payload, sender, handling):
    frames = list(vesc.frames_of(payload, sender=sender, receiver=9, handling=handling))
    found, assembler = assembled(frames)
    assert found == [(sender, handling, payload)]
    assert assembler.malformed == 0
    assert all(frame.arbitration_id & 0xFF == 9 and len(frame.data) <= 8 for frame in frames)


@given(st.binary(min_size=7, max_size=300), st.data())
def test_a_packet_that_lost_or_changed_a_frame_is_counted_and_the_next_is_whole(payload, data):
    frames = list(vesc.frames_of(payload, sender=1, receiver=9, handling=1))
    victim = data.draw(st.integers(0, len(frames) - 1))
    if data.draw(st.booleans()):
        broken = frames[:victim] + frames[victim + 1 :]
    else:
        at = len(frames[victim].data) - 1  # of the payload, or of the checksum
        changed = frames[victim].data[:at] + bytes((frames[victim].data[at] ^ 0x40,))
        broken = [*frames[:victim], frames[victim]._replace(data=changed), *frames[victim + 1 :]]
    found, assembler = assembled(broken + frames)
    assert found == [(1, 1, payload)]
    assert assembler.malformed == (0 if victim == len(frames) - 1 and len(broken) < len(frames) else 1)


@pytest.mark.parametrize("payload", [b"", bytes(vesc.LONGEST + 1)])
def test_a_packet_that_cannot_be_sent(payload):
    with pytest.raises(CodecError):
        list(vesc.frames_of(payload, sender=1, receiver=2, handling=0))


@given(st.integers(0, 255))
def test_fault_codes(code):
    assert vesc.fault_of(vesc.fault_value(code)) == code
    assert describe_fault(code)


def test_another_answer_is_no_fault_code():
    with pytest.raises(CodecError):
        vesc.fault_of(bytes.fromhex("320000400000"))


def test_the_version_as_firmware_6_gives_it():
    # commands.c, COMM_FW_VERSION: major, minor, hardware's name and its end, UUID, four more.
    payload = bytes((0, 6, 5)) + b"Cheap_FOCer_2\0" + bytes(range(12)) + bytes(4)
    assert vesc.version_of(payload) == (6, 5, "Cheap_FOCer_2")
    assert vesc.version_of(bytes((0, 3, 62))) == (3, 62, "")
    assert vesc.version_of(vesc.version_value(5, 2, "60")) == (5, 2, "60")
    assert vesc.ask_version() == b"\0"


def test_pong():
    assert vesc.pong_of(vesc.pong_value(23)) == (23, 0)
    assert vesc.pong_of(b"\x17") == (23, 0)
    with pytest.raises(CodecError):
        vesc.pong_of(b"")


@given(st.lists(st.tuples(st.sampled_from([5, 6, 7, 8, 9, 18]), st.binary(max_size=8)), max_size=60))
def test_no_frames_raise_anything_but_a_codec_error(frames):
    """Any other error would come out of ``suppress``."""
    assembler = vesc.Assembler()
    for packet, data in frames:
        assembler.feed(packet, data)
        for decode in (vesc.Status.decode, vesc.Status4.decode, vesc.Status5.decode, vesc.pong_of, vesc.current_of):
            with suppress(CodecError):
                decode(data)
        for read in (vesc.fault_of, vesc.version_of):
            with suppress(CodecError):
                read(data or b"\0")


def test_faults_in_words():
    """datatypes.h, mc_fault_code."""
    assert describe_fault(0) == "no fault"
    assert describe_fault(2).startswith("supply voltage too low")
    assert describe_fault(5) == "transistors too hot"
    assert describe_fault(29) == "low-voltage output fault"
    assert describe_fault(99) == "unknown fault code 99"
