"""Damiao's frames against two packages that drive such motors."""

import math
import struct
from contextlib import suppress

import pytest
from damiao_motor.core import motor as theirs
from hypothesis import given
from hypothesis import strategies as st
from pydamiao.protocol import DamiaoProtocol
from pydamiao.structs import MotorFault, MotorLimits, MotorReg

from norton_drivers.codecs import damiao, mit
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.damiao import Feedback, Operation, Register, RegisterFrame, Special
from norton_drivers.codecs.ranges import Ranges

RANGES = Ranges(12.5, 30.0, 10.0)  # DM4310, as both packages have it
LIMITS = MotorLimits(12.5, 30.0, 10.0)
CODES12, CODES16, BYTES = st.integers(0, 4095), st.integers(0, 65535), st.integers(0, 255)
NODES = st.integers(1, 15)


@pytest.fixture(scope="module")
def motor():
    """damiao-motor's; without a bus it still packs and unpacks."""
    return theirs.DaMiaoMotor(1, 17, None, motor_type="4310")


def payload(bridged: bytes) -> bytes:
    """The CAN payload in what pydamiao writes to its serial bridge."""
    return bridged[21:29]


@given(torque_nm=st.floats(-10, 10))
def test_a_command_as_third_parties_pack_it(motor, torque_nm):
    code = RANGES.command_code(torque_nm)
    # They cut off where we round: given the middle of our step, all come to the same code.
    middle_nm = min(RANGES.commanded_nm(code) + 0.5 * RANGES.torque_step_nm, 10.0)
    assert mit.command_value(code) == motor.encode_cmd_msg(0.0, 0.0, middle_nm, 0.0, 0.0)
    assert mit.command_value(code) == payload(DamiaoProtocol.encode_mit_control(1, LIMITS, 0, 0, 0, 0, middle_nm))


def test_special_frames(motor):
    assert Special.ENABLE.encode() == motor.encode_enable_msg()
    assert Special.DISABLE.encode() == motor.encode_disable_msg()
    assert Special.ZERO.encode() == motor.encode_save_position_zero_msg()
    assert Special.CLEAR.encode() == motor.encode_clear_error_msg()
    assert [damiao.special_of(special.encode()) for special in Special] == list(Special)
    assert damiao.special_of(mit.command_value(0xFFF)) is None


@given(NODES, st.integers(0, 15), CODES16, CODES12, CODES12, BYTES, BYTES)
def test_feedback_as_third_parties_unpack_it(node, status, position, velocity, torque, transistor, rotor):
    data = Feedback(node, status, position, velocity, torque, transistor, rotor).encode()
    assert Feedback.decode(data) == (node, status, position, velocity, torque, transistor, rotor)
    motor = theirs.DaMiaoMotor(node, 17, None, motor_type="4310")
    told = motor.decode_sensor_feedback(data)
    assert (told["can_id"], told["status_code"], told["t_mos"], told["t_rotor"]) == (node, status, transistor, rotor)
    others = DamiaoProtocol.decode_status(data, LIMITS)
    for position_rad, velocity_rad_s, torque_nm in ((told["pos"], told["vel"], told["torq"]), others):
        # They read the lower end of each step, we its middle; the second in float32.
        assert RANGES.position_of(position) == pytest.approx(position_rad + 0.5 * RANGES.position_step_rad, abs=1e-5)
        assert RANGES.velocity_of(velocity) == pytest.approx(
            velocity_rad_s + 0.5 * RANGES.velocity_step_rad_s, abs=1e-5
        )
        assert RANGES.torque_of(torque) == pytest.approx(torque_nm + 0.5 * RANGES.torque_step_nm, abs=1e-5)


@given(NODES, st.floats(-12.49, 12.49), st.floats(-29.9, 29.9), st.floats(-9.9, 9.9))
def test_measurements_come_back_within_half_a_step(node, position_rad, velocity_rad_s, torque_nm):
    told = damiao.feedback_of(node, damiao.ENABLED, (position_rad, velocity_rad_s, torque_nm), (30.4, 41.9), RANGES)
    told = Feedback.decode(told.encode())
    assert (told.node, told.status, told.transistor_c, told.rotor_c) == (node, damiao.ENABLED, 30, 41)
    assert abs(RANGES.position_of(told.position_code) - position_rad) <= 0.5 * RANGES.position_step_rad + 1e-9
    assert abs(RANGES.velocity_of(told.velocity_code) - velocity_rad_s) <= 0.5 * RANGES.velocity_step_rad_s + 1e-9
    assert abs(RANGES.torque_of(told.torque_code) - torque_nm) <= 0.5 * RANGES.torque_step_nm + 1e-9


def test_the_errors_are_those_that_a_third_party_names():
    words = {"OVER_VOLTAGE": "voltage too high", "UNDER_VOLTAGE": "voltage too low", "OVER_CURRENT": "current",
             "MOS_OVER_TEMP": "transistors", "COIL_OVER_TEMP": "motor too hot", "COMM_LOSS": "communication lost",
             "OVERLOAD": "overload"}  # fmt: skip
    for fault in MotorFault:
        told = damiao.describe_status(fault)
        assert words[fault.name] in told if fault else told == ""
    assert damiao.describe_status(damiao.ENABLED) == ""
    assert damiao.describe_status(7) == "unknown error 7"


# ---- Registers ------------------------------------------------------------------------------------------------------


@given(NODES, st.sampled_from(Register))
def test_questions_as_a_third_party_asks_them(node, register):
    ours = RegisterFrame(node, Operation.READ, register).encode()
    assert ours == payload(DamiaoProtocol.encode_read_param(node, MotorReg(register)))
    refresh = RegisterFrame(node, Operation.REFRESH, 0).encode()
    assert refresh == payload(DamiaoProtocol.encode_refresh_state(node))


@given(NODES, st.sampled_from(Register), st.floats(0, 1e6, width=32))
def test_numbers_in_registers_as_third_parties_have_them(motor, node, register, value):
    value = float(int(value)) if theirs.REGISTER_TABLE[register].data_type == "uint32" else value
    ours = RegisterFrame(node, Operation.WRITE, register, damiao.raw_of(register, value))
    assert ours.encode() == payload(DamiaoProtocol.encode_write_param(node, MotorReg(register), value))
    answer = RegisterFrame(node, Operation.READ, register, ours.raw)
    motor.decode_register_reply(answer.encode())
    assert RegisterFrame.decode(answer.encode()).value == motor.registers[register] == value


def test_names_and_kinds_are_those_of_the_makers_table():
    for register in Register:
        info = theirs.REGISTER_TABLE[register]
        assert info.variable.upper() == register.name
        assert damiao.raw_of(register, 5.0) == struct.pack("<f" if info.data_type == "float" else "<I", 5)


def test_the_version_is_four_digits():
    assert damiao.version_of(bytes.fromhex("35303137")) == "5017"
    assert damiao.version_of(struct.pack("<I", 1234)) == "1234"


@pytest.mark.parametrize(
    ("register", "value"), [(Register.TMAX, math.nan), (Register.TIMEOUT, -1.0), (Register.TIMEOUT, 2.0**32)]
)
def test_what_a_register_cannot_hold(register, value):
    with pytest.raises(CodecError):
        damiao.raw_of(register, value)


@given(st.binary(max_size=12))
def test_no_data_raise_anything_but_a_codec_error(data):
    """Any other error would come out of ``suppress``."""
    damiao.special_of(data)
    for decode in (Feedback.decode, RegisterFrame.decode):
        with suppress(CodecError):
            told = decode(data)
            assert told.encode() == data
            if isinstance(told, RegisterFrame):
                _ = told.value
