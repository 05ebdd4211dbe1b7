"""ODrive firmware 0.5 against tables from its documentation, and against the DBC file generated from its source."""

from contextlib import suppress
from pathlib import Path

import cantools
import odrive_can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs import odrive, odrive_05
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.odrive_05 import (
    ERROR_ESTOP,
    ERROR_INVALID_STATE,
    ERROR_MOTOR_FAILED,
    ERROR_WATCHDOG,
    ClearErrors05,
    Command05,
    EncoderCount,
    Heartbeat05,
    errors_of,
    errors_value,
)

DBC = cantools.database.load_file(Path(odrive_can.__file__).parent / "dbc" / "odrive-cansimple-0.5.6.dbc")
I32 = st.integers(-(2**31), 2**31 - 1)
STATES = st.sampled_from(list(odrive.AxisState)).map(int)
HEARTBEATS = st.builds(
    Heartbeat05, st.integers(0, 0xFFFFFFFF), STATES, st.booleans(), st.booleans(), st.booleans(), st.booleans()
)


def test_heartbeats_laid_out_by_hand():
    # docs/can-protocol: error, state, motor flag, encoder flag, controller flag with "trajectory done" in bit 7.
    data = bytes.fromhex("00 08 00 00 01 01 00 81")
    assert Heartbeat05.decode(data) == Heartbeat05(ERROR_WATCHDOG, 1, True, False, True, True)
    assert Heartbeat05(ERROR_WATCHDOG, 1, True, False, True, True).encode() == data


@given(HEARTBEATS)
def test_heartbeats_as_a_third_party_reads_and_writes_them(heartbeat):
    oracle = DBC.get_message_by_name("Axis3_Heartbeat")
    values = {
        "Axis_Error": heartbeat.error_bits,
        "Axis_State": heartbeat.axis_state,
        "Motor_Error_Flag": heartbeat.motor_failed,
        "Encoder_Error_Flag": heartbeat.encoder_failed,
        "Controller_Error_Flag": heartbeat.controller_failed,
        "Trajectory_Done_Flag": heartbeat.trajectory_done,
    }
    assert oracle.frame_id == odrive.arbitration_id(3, Heartbeat05.COMMAND)
    assert oracle.decode(heartbeat.encode(), decode_choices=False) == values
    assert Heartbeat05.decode(oracle.encode(values)) == heartbeat


@given(I32, I32)
def test_counts_as_a_third_party_reads_them(shadow, in_turn):
    oracle = DBC.get_message_by_name("Axis3_Get_Encoder_Count")
    message = EncoderCount(shadow, in_turn)
    assert EncoderCount.decode(message.encode()) == message
    # The file has them unsigned; the firmware sends int32_t.
    read = oracle.decode(message.encode(), decode_choices=False)
    assert (read["Shadow_Count"], read["Count_in_CPR"]) == (shadow % 2**32, in_turn % 2**32)
    assert oracle.frame_id == odrive.arbitration_id(3, Command05.ENCODER_COUNT)


@given(st.integers(0, 2**64 - 1))
def test_errors(bits):
    assert errors_of(errors_value(bits)) == bits
    assert errors_of(errors_value(bits)[:4]) == bits & 0xFFFFFFFF


@pytest.mark.parametrize(
    ("name", "command", "signal"),
    [
        ("Get_Motor_Error", Command05.MOTOR_ERROR, "Motor_Error"),
        ("Get_Encoder_Error", Command05.ENCODER_ERROR, "Encoder_Error"),
        ("Get_Sensorless_Error", Command05.SENSORLESS_ERROR, "Sensorless_Error"),
        ("Get_Controller_Error", Command05.CONTROLLER_ERROR, "Controller_Error"),
    ],
)
def test_error_messages_as_a_third_party_reads_them(name, command, signal):
    oracle = DBC.get_message_by_name(f"Axis0_{name}")
    assert oracle.frame_id == command
    assert oracle.decode(errors_value(0x01020304), decode_choices=False)[signal] == 0x01020304


def test_clearing_errors_carries_nothing():
    oracle = DBC.get_message_by_name("Axis0_Clear_Errors")
    assert (oracle.frame_id, oracle.length) == (ClearErrors05.COMMAND, len(ClearErrors05().encode()))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Set_Axis_State", odrive.SetAxisState(8)),
        ("Set_Controller_Mode", odrive.SetControllerMode(1, 1)),
        ("Set_Input_Torque", odrive.SetInputTorque(0.5)),
        ("Set_Limits", odrive.SetLimits(1.0, 2.0)),
        ("Get_Encoder_Estimates", odrive.EncoderEstimates(1.0, 2.0)),
        ("Get_Iq", odrive.Iq(1.0, 2.0)),
        ("Get_Bus_Voltage_Current", odrive.BusVoltageCurrent(24.0, 1.0)),
    ],
)
def test_what_both_firmwares_have_in_common(name, message):
    oracle = DBC.get_message_by_name(f"Axis0_{name}")
    data = message.encode()
    assert (oracle.frame_id, oracle.length) == (message.COMMAND, len(data))
    assert oracle.encode(oracle.decode(data, decode_choices=False)) == data


@pytest.mark.parametrize(
    ("message", "signal", "meaning"),
    [
        ("Heartbeat", "Axis_Error", odrive_05.AXIS_WORDS),
        ("Get_Motor_Error", "Motor_Error", odrive_05.MOTOR_WORDS),
        ("Get_Encoder_Error", "Encoder_Error", odrive_05.ENCODER_WORDS),
        ("Get_Controller_Error", "Controller_Error", odrive_05.CONTROLLER_WORDS),
        ("Get_Sensorless_Error", "Sensorless_Error", odrive_05.SENSORLESS_WORDS),
    ],
)
def test_every_error_bit_of_the_third_partys_description_has_words(message, signal, meaning):
    choices = DBC.get_message_by_name(f"Axis0_{message}").get_signal_by_name(signal).choices
    bits = {int(bit) for bit in choices if int(bit)}
    assert bits == {1 << bit for bit in meaning}
    assert len({odrive_05.describe_errors_05(bit, meaning, "axis") for bit in bits}) == len(bits)


def test_the_bits_that_have_names_are_those_of_the_description():
    choices = DBC.get_message_by_name("Axis0_Heartbeat").get_signal_by_name("Axis_Error").choices
    named = {
        "INVALID_STATE": ERROR_INVALID_STATE,
        "MOTOR_FAILED": ERROR_MOTOR_FAILED,
        "WATCHDOG_TIMER_EXPIRED": ERROR_WATCHDOG,
        "ESTOP_REQUESTED": ERROR_ESTOP,
    }
    assert {str(name): int(bit) for bit, name in choices.items()}.items() >= named.items()


def test_unknown_bits_are_said_not_swallowed():
    assert odrive_05.describe_errors_05(0, odrive_05.ENCODER_WORDS, "encoder") == ()
    assert odrive_05.describe_errors_05(1 << 2 | 1 << 20, odrive_05.ENCODER_WORDS, "encoder") == (
        "no response from the encoder",
        "unknown encoder error bits 0x100000",
    )


@given(st.binary(max_size=12))
def test_no_payload_raises_anything_but_a_codec_error(data):
    for decode in (Heartbeat05.decode, EncoderCount.decode, errors_of):
        with suppress(CodecError):
            decode(data)


@pytest.mark.parametrize("decode", [Heartbeat05.decode, EncoderCount.decode])
def test_a_frame_cut_short_is_refused(decode):
    with pytest.raises(CodecError):
        decode(bytes(7))
    with pytest.raises(CodecError):
        errors_of(bytes(3))
