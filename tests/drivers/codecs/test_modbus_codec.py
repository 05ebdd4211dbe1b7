"""Modbus RTU against vectors from its specification and from a sensor's maker, and against pymodbus."""

from itertools import pairwise
from random import Random

import pytest
from crccheck.crc import CrcModbus
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadHoldingRegistersResponse

from norton_drivers.codecs.common import CodecError, crc16_modbus
from norton_drivers.codecs.modbus import (
    AnswerStream,
    ReadAnswer,
    ReadRequest,
    Refusal,
    describe_exception,
    is_sound,
    silence_s,
)

STATIONS = st.integers(1, 247)
REQUESTS = st.builds(ReadRequest, STATIONS, st.integers(0, 0xFFFF), st.integers(1, 12))
TORQUE = ReadRequest(1, 0, 2)


def answers_to(request: ReadRequest) -> st.SearchStrategy[ReadAnswer]:
    return st.binary(min_size=2 * request.count, max_size=2 * request.count).map(
        lambda data: ReadAnswer(request.station, data)
    )


@given(st.binary(max_size=64))
def test_the_crc_against_another_implementation(data):
    assert crc16_modbus(data) == CrcModbus.calc(data)


def test_the_makers_own_example():
    # ATO, "Wiring RS485 Port of Torque Sensor for Modbus Communication".
    assert TORQUE.encode() == bytes.fromhex("01 03 00 00 00 02 C4 0B")
    stream = AnswerStream()
    stream.expect(TORQUE)
    assert stream.feed(bytes.fromhex("01 03 04 00 00 00 00 FA 33")) == ReadAnswer(1, bytes(4))


@given(REQUESTS)
def test_a_request_as_pymodbus_makes_it(request):
    theirs = ReadHoldingRegistersRequest(address=request.register, count=request.count, dev_id=request.station)
    assert FramerRTU(DecodePDU(False)).buildFrame(theirs) == request.encode()
    assert ReadRequest.decode(request.encode()) == request


@given(st.data())
def test_an_answer_as_pymodbus_makes_it(data):
    request = data.draw(REQUESTS)
    answer = data.draw(answers_to(request))
    registers = [int.from_bytes(answer.data[k : k + 2], "big") for k in range(0, len(answer.data), 2)]
    theirs = ReadHoldingRegistersResponse(registers=registers, dev_id=request.station)
    frame = FramerRTU(DecodePDU(True)).buildFrame(theirs)
    assert frame == answer.encode()
    stream = AnswerStream()
    stream.expect(request)
    assert stream.feed(frame) == answer


@given(STATIONS, st.integers(1, 11))
def test_a_refusal_as_pymodbus_makes_it(station, code):
    theirs = ExceptionResponse(3, exception_code=code, device_id=station)
    frame = FramerRTU(DecodePDU(True)).buildFrame(theirs)
    assert frame == Refusal(station, code).encode()
    stream = AnswerStream()
    stream.expect(ReadRequest(station, 0, 2))
    assert stream.feed(frame) == Refusal(station, code)


@given(st.data())
def test_junk_before_and_any_cut(data):
    request = data.draw(REQUESTS)
    answer = data.draw(answers_to(request))
    junk = data.draw(st.binary(max_size=20))
    wire = junk + answer.encode()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(wire)), max_size=5)))
    stream = AnswerStream()
    stream.expect(request)
    found = [stream.feed(wire[a:b]) for a, b in pairwise([0, *cuts, len(wire)])]
    assert [each for each in found if each is not None] == [answer]
    assert (stream.discarded_bytes, stream.pending_bytes) == (len(junk), 0)


def test_the_echo_of_a_two_wire_line_and_other_stations_are_passed_over():
    answer = ReadAnswer(1, bytes.fromhex("00 00 03 E8"))
    stream = AnswerStream()
    stream.expect(TORQUE)
    others = TORQUE.encode() + ReadAnswer(2, bytes(4)).encode() + ReadAnswer(1, bytes(2)).encode()
    assert stream.feed(others + answer.encode() + b"\0\0") == answer
    assert (stream.discarded_bytes, stream.pending_bytes) == (len(others), 2)


def test_what_nobody_asked_for_is_no_answer():
    stream = AnswerStream()
    assert stream.feed(ReadAnswer(1, bytes(4)).encode()) is None
    assert stream.discarded_bytes == 9
    stream.expect(TORQUE)
    assert stream.feed(ReadAnswer(1, b"\1\2\3\4").encode()[:5]) is None
    stream.expect(TORQUE)  # it came too late
    assert stream.feed(ReadAnswer(1, b"\1\2\3\4").encode()[5:]) is None
    assert stream.feed(ReadAnswer(1, b"\5\6\7\x08").encode()) == ReadAnswer(1, b"\5\6\7\x08")


@given(st.integers(0, 8), st.integers(1, 255))
def test_one_wrong_byte_is_noticed(place, difference):
    wire = bytearray(ReadAnswer(1, b"\0\1\2\3").encode())
    wire[place] ^= difference
    stream = AnswerStream()
    stream.expect(TORQUE)
    assert stream.feed(bytes(wire)) is None


def test_a_million_random_bytes_hold_no_answer():
    stream = AnswerStream()
    stream.expect(TORQUE)
    random = Random(1)
    assert all(stream.feed(random.randbytes(1000)) is None for _ in range(1000))


@pytest.mark.parametrize(
    "make",
    [
        lambda: ReadRequest(300, 0, 2).encode(),
        lambda: ReadRequest(1, 0x10000, 2).encode(),
        lambda: ReadRequest.decode(bytes(8)),
        lambda: ReadRequest.decode(bytes.fromhex("01 04 00 00 00 02 71 CB")),
        lambda: ReadAnswer(1, b"").encode(),
        lambda: ReadAnswer(1, bytes(252)).encode(),
    ],
)
def test_what_cannot_be_is_refused(make):
    with pytest.raises(CodecError):
        make()


def test_words_and_silence():
    assert describe_exception(2) == "exception 02, illegal data address"
    assert describe_exception(99) == "exception 99, unknown"
    # Over the serial line specification's table: 3.5 characters of eleven bits, and 1.75 ms above 19200 baud.
    assert silence_s(9600) == pytest.approx(4.01e-3, rel=1e-3)
    assert silence_s(115_200) == 1.75e-3
    assert not is_sound(b"\xff\xff")
