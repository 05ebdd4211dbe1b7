"""moteus' frames: the documentation's vectors, and the maker's own package as the other end, both ways."""

import math
from struct import Struct

import moteus
import pytest
from hypothesis import given
from hypothesis import strategies as st
from moteus import multiplex as theirs
from moteus.protocol import parse_registers

from norton_drivers.codecs import moteus as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.moteus import Identity, Mode, Register, State, raw_of, value_of
from norton_drivers.codecs.multiplex import (
    FILLER,
    Address,
    Kind,
    Refusal,
    Resolution,
    Subframe,
    frame,
    read,
    subframes,
    write,
)

CONTROLLER = moteus.Controller(id=1, transport=object())
# docs/protocol/can.md, "Example".
COMMAND = bytes.fromhex("01000a07206000200150ff140400130d")
REPLY = bytes.fromhex("2404000a005000000170ff230d181400")
SCALED = [Register(register) for register in protocol._STEPS if register < 0x100]
VALUES = {
    Resolution.INT8: st.integers(-0x80, 0x7F),
    Resolution.INT16: st.integers(-0x8000, 0x7FFF),
    Resolution.INT32: st.integers(-(2**31), 2**31 - 1),
    Resolution.FLOAT: st.floats(width=32, allow_nan=False),
}


@st.composite
def parts(draw: st.DrawFn) -> Subframe | Refusal:
    register = draw(st.integers(0, 0x200))
    if draw(st.integers(0, 5)) == 0:
        return Refusal(draw(st.booleans()), register, draw(st.integers(1, 300)))
    kind, resolution, size = draw(st.sampled_from(Kind)), draw(st.sampled_from(Resolution)), draw(st.integers(1, 5))
    if kind is Kind.READ:
        return read(register, resolution, size)
    raw = tuple(draw(st.lists(VALUES[resolution], min_size=size, max_size=size)))
    return Subframe(kind, register, resolution, size, raw)


def by_them(data: bytes) -> list[object]:
    """Every register of a frame, as the maker's package has it."""
    return [(each.type.name, each.register, getattr(each, "value", None)) for each in theirs.parse_frame(data)]


def by_us(data: bytes) -> list[object]:
    found: list[object] = []
    for part in subframes(data):
        if isinstance(part, Refusal):
            found.append(("WRITE_ERROR" if part.written else "READ_ERROR", part.register, None))
            continue
        name = "RESPONSE" if part.kind is Kind.REPLY else part.kind.name
        raw = part.raw or (None,) * part.size
        found += [(name, part.register + place, value) for place, value in enumerate(raw)]
    return found


def test_the_command_of_the_documentation():
    assert list(subframes(COMMAND)) == [
        write(Register.MODE, Resolution.INT8, Mode.POSITION),
        write(Register.COMMAND_POSITION, Resolution.INT16, 96, 288, -176),
        read(Register.MODE, Resolution.INT16, 4),
        read(Register.VOLTAGE, Resolution.INT8, 3),
    ]
    assert frame(tuple(subframes(COMMAND))) == COMMAND
    turns, turns_s, torque_nm = (
        value_of(0x20 + place, Resolution.INT16, raw) for place, raw in enumerate((96, 288, -176))
    )
    assert (turns * 360, turns_s * 360, torque_nm) == pytest.approx((3.456, 25.92, -1.76))


def test_the_reply_of_the_documentation():
    (motion, rest) = subframes(REPLY)
    assert motion == Subframe(Kind.REPLY, 0, Resolution.INT16, 4, (10, 80, 256, -144))
    assert rest == Subframe(Kind.REPLY, 0x0D, Resolution.INT8, 3, (24, 20, 0))
    assert value_of(Register.VOLTAGE, Resolution.INT8, 24) == 12.0


@pytest.mark.parametrize(
    ("address", "identifier", "extended"),
    [
        (Address(0, 1, asks=True), 0x8001, True),  # can.md: send from source 0 to destination 1, a reply is wanted
        (Address(1, 0), 0x100, False),
        (Address(8, 0), 0x800, True),
        (Address(5, 0x7E, asks=True, prefix=0x1234), 0x1234857E, True),
    ],
)
def test_identifiers(address, identifier, extended):
    assert (address.identifier, address.extended) == (identifier, extended)
    assert Address.of(identifier) == address


@given(st.lists(parts(), max_size=3))
def test_the_makers_package_reads_our_frames(sent):
    data = b"".join(part.encode() for part in sent)
    assert list(subframes(data)) == sent
    assert by_us(data) == by_them(data)


@given(st.binary(max_size=64))
def test_any_bytes_give_what_the_makers_package_reads_of_them_or_an_error(data):
    try:
        if any(not isinstance(part, Refusal) and part.size > 64 for part in subframes(data)):
            return  # a question for more registers than there are
    except CodecError:
        return
    ours, other = by_us(data), by_them(data)
    assert [each for each in ours if each[2] == each[2]] == [each for each in other if each[2] == each[2]]


@given(st.data())
def test_values_are_scaled_as_by_the_makers_package(data):
    register, resolution = data.draw(st.sampled_from(SCALED)), data.draw(st.sampled_from(Resolution))
    raw = data.draw(VALUES[resolution])
    (known,) = parse_registers(Subframe(Kind.REPLY, register, resolution, 1, (raw,)).encode()).response.values()
    assert value_of(register, resolution, raw) == pytest.approx(known, rel=1e-12, nan_ok=True)


@given(st.data())
def test_values_are_cut_off_as_by_the_makers_package(data):
    register, resolution = data.draw(st.sampled_from(SCALED)), data.draw(st.sampled_from(list(Resolution)[:3]))
    value = data.draw(st.floats(-1e7, 1e7) | st.just(math.nan) | st.just(math.inf))
    step = protocol._STEPS[register][resolution]
    assert raw_of(register, resolution, value) == theirs.saturate(value, resolution, step)


@given(st.floats(-1e3, 1e3, width=32), st.integers(0, 32_000))
def test_a_torque_command_is_what_the_makers_package_would_send(torque_nm, timeout_ms):
    data, sent = protocol.torque_command(timeout_ms * 1e-3).frame(torque_nm)
    assert sent == torque_nm
    commanded = parse_registers(data).command
    assert commanded.pop(Register.MODE) == moteus.Mode.POSITION
    # docs/guides/control-modes.md, "Torque Control".
    made = CONTROLLER.make_position(
        position=math.nan, feedforward_torque=torque_nm, kp_scale=0.0, kd_scale=0.0, ilimit_scale=0.0,
        watchdog_timeout=timeout_ms * 1e-3,
    )  # fmt: skip
    wanted = parse_registers(made.data).command
    del wanted[Register.MODE]
    assert commanded == pytest.approx(wanted, rel=1e-6, nan_ok=True)


@given(st.floats(-1e3, 1e3, width=32))
def test_a_goal_is_what_the_makers_package_would_send(position_turns):
    data, sent = protocol.position_command(0.3).frame(position_turns)
    made = CONTROLLER.make_position(
        position=position_turns, watchdog_timeout=0.3, ilimit_scale=0.0, velocity_limit=-1.0, accel_limit=-1.0
    )
    assert sent == position_turns
    assert parse_registers(data).command == pytest.approx(parse_registers(made.data).command, rel=1e-6)


@given(st.floats(-1e3, 1e3, width=32))
def test_a_velocity_is_what_the_makers_package_would_send(velocity_turns_s):
    data, sent = protocol.velocity_command(0.3).frame(velocity_turns_s)
    made = CONTROLLER.make_position(
        position=math.nan,
        velocity=velocity_turns_s,
        kp_scale=0.0,
        watchdog_timeout=0.3,
        ilimit_scale=0.0,
        velocity_limit=-1.0,
        accel_limit=-1.0,
    )
    assert sent == velocity_turns_s
    expected = parse_registers(made.data).command
    assert parse_registers(data).command == pytest.approx(expected, rel=1e-6, nan_ok=True)


def test_every_question_is_what_the_makers_package_would_ask():
    wanted = moteus.QueryResolution()
    wanted.q_current = moteus.F32
    wanted.voltage = wanted.temperature = wanted.fault = moteus.INT16
    assert CONTROLLER.make_query(wanted).data == protocol.ASK
    stopped = CONTROLLER.make_stop(query_override=wanted).data
    assert stopped.ljust(12, bytes((FILLER,))) == protocol.STOP
    fields = {Register.MODEL: moteus.INT32, Register.FIRMWARE: moteus.INT32, Register.REGISTER_MAP: moteus.INT32}
    assert CONTROLLER.make_custom_query(fields).data == protocol.ASK_IDENTITY


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e39])
def test_what_is_no_number_is_not_sent(value):
    for form in (protocol.torque_command(0.1), protocol.position_command(0.1), protocol.velocity_command(0.1)):
        with pytest.raises(CodecError, match="not a finite number"):
            form.frame(value)


FINITE = st.floats(-1e6, 1e6, width=32)
STATES = st.builds(
    State,
    st.integers(0, 15),
    *[FINITE] * 4,
    st.integers(0, 600).map(lambda raw: raw * 0.1),
    st.integers(-400, 1200).map(lambda raw: raw * 0.1),
    st.integers(0, 127),
    st.lists(st.sampled_from([0x2B, 0x2D]), max_size=2).map(tuple),
)


@given(STATES)
def test_states_both_ways(state):
    data = state.encode()
    told = State.decode(data)
    assert told is not None
    assert (told[:5], told.fault, told.refused) == (state[:5], state.fault, state.refused)
    assert (told.voltage_v, told.temperature_c) == pytest.approx((state.voltage_v, state.temperature_c), abs=0.1001)
    registers = parse_registers(data).response
    theirs_of = [registers[register] for register in (*range(5), 0x0D, 0x0E, 0x0F)]
    assert list(told[:8]) == pytest.approx(theirs_of)


def test_a_state_in_another_order_is_the_same():
    state = State(10, 1.5, -2.0, 0.25, 4.5, 24.0, 31.0, 0)
    other = frame(
        (
            Subframe(Kind.REPLY, 0x0D, Resolution.INT16, 3, (240, 310, 0)),
            Subframe(Kind.REPLY, 1, Resolution.FLOAT, 4, (1.5, -2.0, 0.25, 4.5)),
            Subframe(Kind.REPLY, 0, Resolution.INT8, 1, (10,)),
        )
    )
    assert State.decode(other) == State.decode(state.encode())


@pytest.mark.parametrize("place", range(4))
def test_a_motion_that_is_no_number_is_no_reading(place):
    values = [1.0] * 4
    values[place] = math.nan
    data = bytearray(State(10, 0.0, 0.0, 0.0, 0.0, 24.0, 30.0, 0).encode())
    data[6:22] = Struct("<4f").pack(*values)
    with pytest.raises(CodecError, match="is no number"):
        State.decode(data)


def test_other_replies_are_no_states():
    identity = Subframe(Kind.REPLY, Register.MODEL, Resolution.INT32, 3, (0x0604, 0x010304, 5))
    assert State.decode(frame((identity,))) is None
    assert Identity.decode(frame((identity,))) == Identity(0x0604, 0x010304, 5)
    assert Identity(0x0604, 0x010304, 5).firmware_words == "1.3.4"  # registers.md, 0x101
    assert Identity.decode(State(0, 0.0, 0.0, 0.0, 0.0, 24.0, 30.0, 0).encode()) is None


@pytest.mark.parametrize(
    "data",
    [
        b"\x21",
        b"\x21\x00",
        b"\x2c\x04\x01" + bytes(15),
        b"\x60\x00",
        b"\x20",
        b"\x32\x01\x01",
        b"\x20\xff\xff\xff\xff\xff\x01",
    ],
)
def test_what_is_cut_short_or_unknown_is_an_error(data):
    with pytest.raises(CodecError):
        list(subframes(data))


def test_faults_and_modes_in_words():
    assert protocol.describe_fault(40) == "supply voltage too low"
    assert protocol.describe_fault(77) == "fault 77"
    assert (protocol.describe_mode(11), protocol.describe_mode(99)) == ("timeout", "mode 99")
    assert {mode.name: mode.value for mode in moteus.Mode} == {
        mode.name.replace("MEASURE_INDUCTANCE", "MEASURE_IND"): mode.value
        for mode in Mode
        if not Mode.ENABLING <= mode <= Mode.CALIBRATION_COMPLETE
    }
    numbers = {register.name: register.value for register in moteus.Register}
    alike = [register for register in Register if register.name in numbers]
    assert len(alike) > 10
    assert all(register.value == numbers[register.name] for register in alike)


def test_no_frame_is_longer_than_can_fd_allows():
    with pytest.raises(CodecError, match="at most 64"):
        frame((write(0x20, Resolution.FLOAT, *[0.0] * 16),))
