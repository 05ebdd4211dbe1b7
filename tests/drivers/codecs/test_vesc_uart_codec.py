"""VESC's packets on serial lines against a manual's vectors and PyVESC, however the stream is cut."""

from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_drivers.codecs import vesc, vesc_uart
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc_uart import PacketStream, Say, Value, mask_of
from tests.drivers.peer_pyvesc import pyvesc

# CubeMars, AK Series Actuator Driver Manual V1.0.8, section 5.2.2, whose drives speak VESC's packets on a serial line.
MANUAL = [
    (bytes((Say.SET_DUTY,)) + vesc.duty_value(0.2), "02 05 05 00 00 4E 20 29 F6 03"),
    (bytes((Say.SET_DUTY,)) + vesc.duty_value(-0.2), "02 05 05 FF FF B1 E0 77 85 03"),
    (bytes((Say.SET_CURRENT,)) + vesc.current_value(5.0), "02 05 06 00 00 13 88 8B 25 03"),
    (bytes((Say.SET_CURRENT,)) + vesc.current_value(-5.0), "02 05 06 FF FF EC 78 E3 05 03"),
    (bytes((Say.GET_VALUES,)), "02 01 04 40 84 03"),
]
PAYLOADS = st.binary(min_size=1, max_size=300)


@pytest.mark.parametrize(("payload", "line"), MANUAL)
def test_the_manuals_packets(payload, line):
    assert vesc_uart.packet(payload) == bytes.fromhex(line)
    assert PacketStream().feed(bytes.fromhex(line)) == [(payload, 0)]


@settings(max_examples=30)
@given(PAYLOADS)
def test_pyvesc_packs_and_unpacks_alike(payload):
    codec = pyvesc("protocol.packet.codec")
    assert bytes(codec.frame(payload)) == vesc_uart.packet(payload)
    assert codec.unframe(vesc_uart.packet(payload)) == (payload, len(vesc_uart.packet(payload)))


def test_pyvesc_commands_and_asks_alike():
    interface, setters = pyvesc("protocol.interface"), pyvesc("VESC.messages.setters")
    getters = pyvesc("VESC.messages.getters")
    current = bytes((Say.SET_CURRENT,)) + vesc.current_value(-1.234)
    assert bytes(interface.encode(setters.SetCurrent(-1.234))) == vesc_uart.packet(current)
    duty = bytes((Say.SET_DUTY,)) + vesc.duty_value(0.12345)
    assert bytes(interface.encode(setters.SetDutyCycle(0.12345))) == vesc_uart.packet(duty)
    assert bytes(interface.encode(setters.Alive())) == vesc_uart.packet(bytes((Say.ALIVE,)))
    assert bytes(interface.encode_request(getters.GetVersion)) == vesc_uart.packet(vesc.ask_version())
    assert bytes(interface.encode_request(getters.GetValues)) == vesc_uart.packet(bytes((Say.GET_VALUES,)))


def test_values_by_hand():
    mask = mask_of(Value.Q_A, Value.ERPM, Value.FAULT, Value.POSITION_DEG, Value.STATUS)
    told = {Value.Q_A: -1.23, Value.ERPM: 4567.0, Value.FAULT: 3, Value.POSITION_DEG: 359.5, Value.STATUS: 1}
    payload = vesc_uart.values_value(told, mask)
    assert payload.hex() == "32" + "002180a0" + "ffffff85" + "000011d7" + "03" + "156d88e0" + "01"
    assert vesc_uart.values_of(payload) == told
    assert vesc_uart.answer_length(mask) == len(vesc_uart.packet(payload))
    assert vesc_uart.mask_in(payload) == mask
    del told[Value.STATUS]
    assert vesc_uart.values_of(payload[:-1]) == told, "firmware that does not know the bit leaves the byte out"


@pytest.mark.parametrize("payload", [b"\x04", b"\x32\0\0", vesc_uart.ask_values(1 << 7) + b"\0\0\0"])
def test_what_is_no_answer_is_refused(payload):
    with pytest.raises(CodecError):
        vesc_uart.values_of(payload)
    with pytest.raises(CodecError):
        vesc_uart.values_of(vesc_uart.ask_values(1 << 15) + b"\0\0")


def test_forwarded_to_another_controller():
    assert vesc_uart.forwarded(b"\x04", 23) == bytes((34, 23, 4))
    assert vesc_uart.unforwarded(bytes((34, 23, 4))) == (23, b"\x04")
    assert vesc_uart.unforwarded(vesc_uart.forwarded(b"\x04", None)) == (None, b"\x04")
    with pytest.raises(CodecError):
        vesc_uart.forwarded(b"\x04", 255)
    with pytest.raises(CodecError):
        vesc_uart.packet(b"")


@settings(max_examples=60)
@given(st.lists(PAYLOADS, min_size=1, max_size=4), st.binary(max_size=20), st.data())
def test_a_stream_is_read_alike_however_it_is_cut(payloads, junk, data):
    # Junk that could begin a packet hides what follows until its length is over, as in the firmware.
    wire = junk.translate(None, b"\2\3") + b"".join(map(vesc_uart.packet, payloads))
    stream, found = PacketStream(), []
    while wire:
        count = data.draw(st.integers(1, len(wire)))
        found += [received.payload for received in stream.feed(wire[:count])]
        wire = wire[count:]
    assert found == payloads
    assert stream.malformed == 0


@settings(max_examples=60)
@given(st.binary(max_size=700))
def test_nothing_makes_it_raise(data):
    for received in PacketStream().feed(data + vesc_uart.packet(b"\x04")):
        with suppress(CodecError):
            vesc_uart.values_of(received.payload)


def test_after_damage_it_goes_on():
    stream = PacketStream()
    damaged = bytearray(vesc_uart.packet(b"\x04" * 20))
    damaged[7] ^= 1
    assert [each.payload for each in stream.feed(bytes(damaged) + vesc_uart.packet(b"\x1e"))] == [b"\x1e"]
    assert stream.malformed >= 1
