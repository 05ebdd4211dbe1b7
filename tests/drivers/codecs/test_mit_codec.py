"""MIT mode's frames against two packages that drive such motors, and against the firmware's own arithmetic."""

import math
from contextlib import suppress
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from motor_driver import canmotorlib
from TMotorCANControl.mit_can import CAN_Manager, MIT_Params

from norton_drivers.codecs import mit
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.mit import Reply, Special
from norton_drivers.codecs.ranges import POSITION_CODES, Ranges

RANGES = Ranges(12.5, 50.0, 18.0)  # AK80-9, as both packages have it (but for the velocity of one)
CODES12, CODES16 = st.integers(0, 4095), st.integers(0, 65535)


@pytest.fixture(scope="module")
def cheetah():
    """mini-cheetah-motor-driver-socketcan; without a CAN socket it still packs and unpacks."""
    motor = canmotorlib.CanMotorController("nowhere", 1, "AK80_9_V2")
    motor.change_motor_constants(-12.5, 12.5, -50.0, 50.0, 0.0, 500.0, 0.0, 5.0, -18.0, 18.0)
    return motor


# ---- commands -------------------------------------------------------------------------------------------------------


@given(torque_nm=st.floats(-18, 18))
def test_a_command_as_a_third_party_packs_it(cheetah, torque_nm):
    sent = []
    cheetah._send_can_frame, cheetah._recv_can_frame = sent.append, lambda: (0, 6, bytes(6))
    code = RANGES.command_code(torque_nm)
    # It cuts off where we round: given the middle of our step, both come to the same code.
    cheetah.send_rad_command(0.0, 0.0, 0.0, 0.0, min(RANGES.commanded_nm(code) + 0.5 * RANGES.torque_step_nm, 18.0))
    assert mit.command_value(code) == sent[-1]


@given(torque_nm=st.floats(-17.9, 17.9))
def test_a_command_as_another_third_party_packs_it(torque_nm):
    """TMotorCANControl spreads the range over 4096 steps where the firmware has 4095: one code apart at most."""
    sent = []
    manager = SimpleNamespace(send_MIT_message=lambda _motor, data: sent.append(bytes(data)))
    CAN_Manager.MIT_controller(manager, 1, "AK80-9", 0.0, 0.0, 0.0, 0.0, torque_nm)
    ours = mit.command_value(RANGES.command_code(torque_nm))
    assert ours[5:6] == sent[-1][5:6] == b"\0"  # no damping
    assert abs(mit.torque_code_of(ours) - mit.torque_code_of(sent[-1])) <= 1


def test_a_command_by_hand():
    """bgkatz/motorcontrol, can.c, unpack_cmd: 16, 12, 12, 12 and 12 bits, most significant first."""
    data = mit.command_value(0xABC)
    assert len(data) == 8
    number = int.from_bytes(data, "big")
    fields = [number >> shift & (1 << bits) - 1 for shift, bits in ((48, 16), (36, 12), (24, 12), (12, 12), (0, 12))]
    assert fields == [32767, 2047, 0, 0, 0xABC]


@given(st.floats(-18, 18))
def test_a_torque_is_sent_within_half_a_step(torque_nm):
    assert abs(RANGES.commanded_nm(RANGES.command_code(torque_nm)) - torque_nm) <= 0.5 * RANGES.torque_step_nm + 1e-9


def test_zero_is_half_a_step_off():
    zero_nm = RANGES.commanded_nm(RANGES.command_code(0.0))
    assert RANGES.torque_step_nm == pytest.approx(8.79e-3, rel=1e-3)
    assert abs(zero_nm) == pytest.approx(0.5 * RANGES.torque_step_nm)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_what_is_beyond_the_range_is_held_within_it(torque_nm):
    code = RANGES.command_code(torque_nm)
    assert 0 <= code <= 4095
    assert RANGES.commanded_nm(4095) == pytest.approx(18.0)
    if abs(torque_nm) > 18.0:
        assert code == (4095 if torque_nm > 0 else 0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_cannot_be_commanded(value):
    with pytest.raises(CodecError):
        RANGES.command_code(value)


def test_special_frames():
    assert Special.ENABLE.encode() == bytes.fromhex("FFFFFFFFFFFFFFFC")
    assert Special.DISABLE.encode() == bytes.fromhex("FFFFFFFFFFFFFFFD")
    assert Special.ZERO.encode() == bytes.fromhex("FFFFFFFFFFFFFFFE")
    assert [mit.special_of(special.encode()) for special in Special] == list(Special)
    assert mit.special_of(bytes.fromhex("FFFFFFFFFFFFFFFF")) is None
    assert mit.special_of(bytes.fromhex("FFFFFFFFFFFFFC")) is None


@given(CODES12)
def test_no_command_is_a_special_frame(code):
    assert mit.special_of(mit.command_value(code)) is None


# ---- replies --------------------------------------------------------------------------------------------------------


@given(CODES16, CODES12, CODES12)
def test_a_reply_as_a_third_party_unpacks_it(cheetah, position, velocity, torque):
    data = Reply(7, position, velocity, torque).encode()
    assert cheetah.decode_motor_status(data) == (position, velocity, torque)
    assert Reply.decode(data) == (7, position, velocity, torque, None, None)


@given(CODES16, CODES12, CODES12, st.integers(0, 255), st.integers(0, 6))
def test_a_reply_with_temperature_and_error_as_another_third_party_unpacks_it(
    position, velocity, torque, warmth, error
):
    data = Reply(7, position, velocity, torque, warmth, error).encode()
    theirs = CAN_Manager.parse_MIT_message(SimpleNamespace(debug=False), data, "AK80-9")
    ours = Reply.decode(data)
    assert (theirs.temperature, theirs.error) == (ours.temperature, ours.error) == (warmth, error)
    # They read the lower end of each step, we its middle.
    assert RANGES.position_of(ours.position_code) == pytest.approx(theirs.position + 0.5 * RANGES.position_step_rad)
    assert RANGES.velocity_of(ours.velocity_code) == pytest.approx(theirs.velocity + 0.5 * RANGES.velocity_step_rad_s)
    assert RANGES.torque_of(ours.torque_code) == pytest.approx(theirs.current + 0.5 * RANGES.torque_step_nm)


@given(st.floats(-12.49, 12.49), st.floats(-49.9, 49.9), st.floats(-17.9, 17.9))
def test_measurements_come_back_within_half_a_step(position_rad, velocity_rad_s, torque_nm):
    reply = Reply.decode(Reply.of(1, position_rad, velocity_rad_s, torque_nm, RANGES).encode())
    assert abs(RANGES.position_of(reply.position_code) - position_rad) <= 0.5 * RANGES.position_step_rad + 1e-9
    assert abs(RANGES.velocity_of(reply.velocity_code) - velocity_rad_s) <= 0.5 * RANGES.velocity_step_rad_s + 1e-9
    assert abs(RANGES.torque_of(reply.torque_code) - torque_nm) <= 0.5 * RANGES.torque_step_nm + 1e-9


def test_a_shaft_that_stands_still_reads_zero():
    reply = Reply.of(1, 0.0, 0.0, 0.0, RANGES)
    assert RANGES.velocity_of(reply.velocity_code) == pytest.approx(0.0, abs=1e-12)
    assert RANGES.torque_of(reply.torque_code) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(-200, 200))
def test_a_position_beyond_the_range_wraps(position_rad):
    """65,536 codes further on, as the firmware's integer is cut to two bytes."""
    reply = Reply.decode(Reply.of(1, position_rad, 0.0, 0.0, RANGES).encode())
    turned = (position_rad - RANGES.position_of(reply.position_code)) / RANGES.position_step_rad / POSITION_CODES
    assert abs(turned - round(turned)) < 2 / POSITION_CODES


@pytest.mark.parametrize("length", [0, 1, 5, 9])
def test_a_reply_of_another_length_is_none(length):
    with pytest.raises(CodecError):
        Reply.decode(bytes(length))


@given(st.binary(max_size=12))
def test_no_data_raise_anything_but_a_codec_error(data):
    """Any other error would come out of ``suppress``."""
    mit.special_of(data)
    for decode in (Reply.decode, mit.torque_code_of):
        with suppress(CodecError):
            decode(data)


def test_the_errors_are_those_a_third_party_names():
    theirs = MIT_Params["ERROR_CODES"]
    words = {1: "hot", 2: "current", 3: "high", 4: "low", 5: "encoder", 6: "unbalanced"}
    assert len(theirs) == len(words) + 1
    for code, word in words.items():
        assert word in mit.describe_error(code)
    assert "encoder" in theirs[5].lower()
    assert mit.describe_error(77).startswith("unknown error 77")
