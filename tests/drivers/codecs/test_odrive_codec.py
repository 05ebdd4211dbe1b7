"""ODrive CANSimple against tables from its manual, and against the DBC file that a third party ships."""

import math
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from struct import pack, unpack

import cantools
import odrive_can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs import odrive, odrive_06
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.odrive_06 import describe_axis_state, describe_errors, describe_procedure_result

# (message, payload): written by hand from the manual's table of messages, little-endian.
TABLE = [
    (odrive.Version(2, (4, 4, 58), (0, 6, 10), 0), "02 04 04 3A 00 06 0A 00"),
    (odrive.Heartbeat(0, 1, 0, True), "00 00 00 00 01 00 01 00"),
    (odrive.Heartbeat(0x01000000, 8, 3), "00 00 00 01 08 03 00 00"),
    (odrive.GetError(0x200, 0x01000000), "00 02 00 00 00 00 00 01"),
    (odrive_06.RxSdo(1, 0x00C8, odrive_06.f32_value(0.5)), "01 C8 00 00 00 00 00 3F"),
    (odrive_06.RxSdo(0, 0x01C9), "00 C9 01 00 00 00 00 00"),
    (odrive_06.TxSdo(0x00C9, odrive_06.u32_value(1)), "00 C9 00 00 01 00 00 00"),
    (odrive.SetAxisState(8), "08 00 00 00 00 00 00 00"),
    (odrive.EncoderEstimates(1.5, -2.0), "00 00 C0 3F 00 00 00 C0"),
    (odrive.SetControllerMode(1, 6), "01 00 00 00 06 00 00 00"),
    (odrive.SetInputTorque(-0.5), "00 00 00 BF 00 00 00 00"),
    (odrive.SetLimits(10.0, 20.0), "00 00 20 41 00 00 A0 41"),
    (odrive.Iq(1.0, -1.0), "00 00 80 3F 00 00 80 BF"),
    (odrive.Temperature(25.0, 50.0), "00 00 C8 41 00 00 48 42"),
    (odrive.BusVoltageCurrent(24.0, 0.5), "00 00 C0 41 00 00 00 3F"),
    (odrive.ClearErrors(), "00"),
    (odrive.ClearErrors(identify=True), "01"),
    (odrive.Torques(0.25, 0.125), "00 00 80 3E 00 00 00 3E"),
]


@pytest.mark.parametrize(("message", "payload"), TABLE, ids=lambda value: type(value).__name__)
def test_both_directions(message, payload):
    data = bytes.fromhex(payload)
    assert message.encode() == data
    assert type(message).decode(bytearray(data)) == message


@pytest.mark.parametrize(("message", "payload"), TABLE, ids=lambda value: type(value).__name__)
def test_padding_to_eight_bytes_changes_nothing(message, payload):
    assert type(message).decode(bytes.fromhex(payload).ljust(8, b"\0")) == message


FOUR_ARE_ENOUGH = (odrive.SetAxisState, odrive.SetInputTorque)
LENIENT = (odrive.ClearErrors, odrive_06.RxSdo, odrive_06.TxSdo)


@pytest.mark.parametrize("message", [message for message, _ in TABLE if type(message) not in LENIENT], ids=repr)
def test_a_frame_cut_short_is_refused(message):
    needed = 4 if type(message) in FOUR_ARE_ENOUGH else 8
    assert type(message).decode(message.encode()[:needed]) == message
    with pytest.raises(CodecError):
        type(message).decode(message.encode()[: needed - 1])


@pytest.mark.parametrize("kind", [odrive.EncoderEstimates, odrive.Iq, odrive.SetLimits, odrive.BusVoltageCurrent])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused_both_ways(kind, bad):
    for pair in ((bad, 0.0), (0.0, bad)):
        with pytest.raises(CodecError):
            kind.decode(pack("<ff", *pair))
        with pytest.raises(CodecError):
            kind(*pair).encode()


def test_a_torque_that_is_no_number_cannot_be_sent():
    with pytest.raises(CodecError):
        odrive.SetInputTorque(math.nan).encode()
    with pytest.raises(CodecError):
        odrive.SetInputTorque(1e300).encode()


def test_a_missing_thermistor_is_nan_and_no_error():
    assert math.isnan(odrive.Temperature.decode(pack("<ff", 30.0, math.nan)).motor_c)


@given(st.integers(0, 63), st.integers(0, 31))
def test_identifiers(node, command):
    identifier = odrive.arbitration_id(node, command)
    assert identifier == node * 32 + command < 0x800
    assert odrive.split_id(identifier) == (node, command)


@pytest.mark.parametrize("node", [-1, 64])
def test_a_node_that_cannot_be(node):
    with pytest.raises(CodecError, match="0 to 63"):
        odrive.arbitration_id(node, 0)


FINITE = st.floats(-1e6, 1e6)


@given(FINITE, FINITE)
def test_estimates_come_back_within_half_a_step_of_the_wire(position_rev, velocity_rev_s):
    back = odrive.EncoderEstimates.decode(odrive.EncoderEstimates(position_rev, velocity_rev_s).encode())
    for sent, received in ((position_rev, back.position_rev), (velocity_rev_s, back.velocity_rev_s)):
        step = math.ldexp(1.0, max(math.frexp(sent)[1], -125) - 24)
        assert abs(received - sent) <= step / 2


@given(st.binary(max_size=12))
def test_no_payload_raises_anything_but_a_codec_error(data):
    for kind in {type(message) for message, _ in TABLE}:
        with suppress(CodecError):
            kind.decode(data)


# ---- The DBC file of the package odrive-can -------------------------------------------------------------------------

DBC = cantools.database.load_file(Path(odrive_can.__file__).parent / "dbc" / "odrive-cansimple-0.6.10.dbc")
U8, U32, F32 = (
    st.integers(0, 0xFF),
    st.integers(0, 0xFFFFFFFF),
    st.floats(width=32, allow_nan=False, allow_infinity=False),
)
STATES = st.sampled_from(list(odrive.AxisState))

# our message -> what the DBC file calls it and its signals, in the order of our fields
NAMES = {
    odrive.EncoderEstimates: ("Get_Encoder_Estimates", ("Pos_Estimate", "Vel_Estimate")),
    odrive.Heartbeat: ("Heartbeat", ("Axis_Error", "Axis_State", "Procedure_Result", "Trajectory_Done_Flag")),
    odrive.GetError: ("Get_Error", ("Active_Errors", "Disarm_Reason")),
    odrive.SetControllerMode: ("Set_Controller_Mode", ("Control_Mode", "Input_Mode")),
    odrive.SetLimits: ("Set_Limits", ("Velocity_Limit", "Current_Limit")),
    odrive.Iq: ("Get_Iq", ("Iq_Setpoint", "Iq_Measured")),
    odrive.Temperature: ("Get_Temperature", ("FET_Temperature", "Motor_Temperature")),
    odrive.BusVoltageCurrent: ("Get_Bus_Voltage_Current", ("Bus_Voltage", "Bus_Current")),
    odrive.Torques: ("Get_Torques", ("Torque_Target", "Torque_Estimate")),
}
FIELDS = {
    odrive.Heartbeat: (U32, STATES.map(int), U8, st.booleans()),
    odrive.GetError: (U32, U32),
    odrive.SetControllerMode: (U32, U32),
}


@pytest.mark.parametrize("kind", NAMES, ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_a_third_partys_description_reads_and_writes_the_same(kind, data):
    name, signals = NAMES[kind]
    message = kind(*data.draw(st.tuples(*FIELDS.get(kind, (F32, F32)))))
    oracle = DBC.get_message_by_name(f"Axis3_{name}")
    values = {signal: getattr(message, field.name) for signal, field in zip(signals, fields(message), strict=True)}
    assert oracle.frame_id == odrive.arbitration_id(3, kind.COMMAND)
    assert oracle.decode(message.encode(), decode_choices=False) == values
    assert kind.decode(oracle.encode(values)) == message


@given(st.integers(0, 1), st.integers(0, 0xFFFF), U32)
def test_parameter_requests_as_a_third_party_reads_them(opcode, endpoint, value):
    # The file marks the endpoint as a multiplexer without branches, which cantools cannot read whole: by hand, then.
    data = odrive_06.RxSdo(opcode, endpoint, odrive_06.u32_value(value)).encode()
    signals = {signal.name: signal for signal in DBC.get_message_by_name("Axis0_RxSdo").signals}
    bits = int.from_bytes(data, "little")
    for name, expected in (("Opcode", opcode), ("Endpoint_ID", endpoint), ("Value", value)):
        assert bits >> signals[name].start & (1 << signals[name].length) - 1 == expected
    assert odrive_06.u32_of(odrive_06.RxSdo.decode(data).value) == value


@given(F32, STATES.map(int))
def test_commands_have_the_length_and_content_that_a_third_party_expects(torque_nm, state):
    torque, request = DBC.get_message_by_name("Axis0_Set_Input_Torque"), DBC.get_message_by_name("Axis0_Set_Axis_State")
    assert torque.encode({"Input_Torque": torque_nm}) == odrive.SetInputTorque(torque_nm).encode()
    assert request.encode({"Axis_Requested_State": state}) == odrive.SetAxisState(state).encode()
    for message, _ in TABLE:
        (described,) = (each for each in DBC.messages if each.frame_id == message.COMMAND)
        assert len(message.encode()) == described.length


def test_every_command_stands_in_the_third_partys_description_under_our_name():
    known = {message.frame_id & 0x1F: message.name.upper() for message in DBC.messages}
    words = {"ERROR": "GET_ERROR", "RX_SDO": "RXSDO", "TX_SDO": "TXSDO"}
    for command in odrive.MessageId:
        assert words.get(command.name, command.name) in known[command]


def test_error_bits_and_states_as_in_the_third_partys_description():
    heartbeat = DBC.get_message_by_name("Axis0_Heartbeat")
    errors = {int(bit) for bit in heartbeat.get_signal_by_name("Axis_Error").choices if int(bit)}
    assert all("unknown" not in word for bit in errors for word in describe_errors(bit))
    assert len({describe_errors(bit) for bit in errors}) == len(errors)
    states = {int(state): str(name) for state, name in heartbeat.get_signal_by_name("Axis_State").choices.items()}
    assert {int(state): state.name for state in odrive.AxisState}.items() <= states.items()
    results = heartbeat.get_signal_by_name("Procedure_Result").choices
    assert all("unknown" not in describe_procedure_result(int(result)) for result in results)


def test_unknown_bits_are_said_not_swallowed():
    assert describe_errors(0) == ()
    assert describe_errors(1 << 31 | 1 << 24) == (
        "watchdog expired: no command arrived in time",
        "unknown error bits 0x80000000",
    )
    assert describe_procedure_result(99) == "unknown result 99"
    assert describe_axis_state(99) == "unknown state 99"


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_parameter_values(number):
    assert odrive_06.f32_of(odrive_06.f32_value(number)) == number == unpack("<f", odrive_06.f32_value(number))[0]
