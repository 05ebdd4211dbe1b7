"""socketcand's texts: those of its documentation, python-can's reading of ours, and streams cut and soiled anywhere."""

from itertools import pairwise

import can
import pytest
from can.interfaces.socketcand.socketcand import (
    convert_ascii_message_to_can_message,
    convert_can_message_to_ascii_message,
)
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.socketcand import BracketStream, SocketcandFrame, decode_event, decode_request

STAMPS = st.integers(0, 2**31).map(lambda micros: micros / 64)  # exact in six digits
DATA = st.binary(max_size=8)
STANDARD = st.builds(
    lambda i, d, s: SocketcandFrame(i, d, length=len(d), stamp_s=s), st.integers(0, 0x7FF), DATA, STAMPS
)
EXTENDED = st.builds(
    lambda i, d, s: SocketcandFrame(i, d, extended=True, length=len(d), stamp_s=s),
    st.integers(0, 0x1FFFFFFF),
    DATA,
    STAMPS,
)
REMOTE = st.builds(
    lambda i, n, s: SocketcandFrame(i, remote=True, length=n, stamp_s=s),
    st.integers(0, 0x7FF),
    st.integers(0, 8),
    STAMPS,
)
ERROR = st.builds(lambda i, s: SocketcandFrame(i, error=True, stamp_s=s), st.integers(0, 0x3FF), STAMPS)


def inside(text: bytes) -> str:
    return text.decode().strip("<> ")


@given(st.one_of(STANDARD, EXTENDED, REMOTE, ERROR))
def test_events_both_ways(frame):
    assert decode_event(inside(frame.encode_event())) == frame


@given(st.one_of(STANDARD, EXTENDED, REMOTE))
def test_requests_both_ways(frame):
    again = decode_request(inside(frame.encode_request()))
    assert (again.arbitration_id, again.data, again.extended, again.remote, again.length) == (
        frame.arbitration_id,
        frame.data,
        frame.extended,
        frame.remote,
        frame.length,
    )


@given(st.one_of(STANDARD, EXTENDED, ERROR))
def test_python_can_reads_our_events_the_same(frame):
    message = convert_ascii_message_to_can_message(frame.encode_event().decode())
    assert (message.arbitration_id, message.is_error_frame, message.timestamp) == (
        frame.arbitration_id,
        frame.error,
        frame.stamp_s,
    )
    if not frame.error:
        assert (bytes(message.data), message.is_extended_id) == (frame.data, frame.extended)


@given(st.one_of(STANDARD, EXTENDED))
def test_we_read_python_cans_requests_the_same(frame):
    message = can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=frame.extended)
    request = decode_request(inside(convert_can_message_to_ascii_message(message).encode()))
    assert (request.arbitration_id, request.data, request.extended) == (
        frame.arbitration_id,
        frame.data,
        frame.extended,
    )


def test_the_documentations_examples():
    assert decode_event("frame 123 23.424242 11 22 33 44") == SocketcandFrame(
        0x123, b"\x11\x22\x33\x44", length=4, stamp_s=23.424242
    )
    assert decode_event("rtr 123 23.424242 4") == SocketcandFrame(0x123, remote=True, length=4, stamp_s=23.424242)
    assert decode_request("send 1AAAAAAA 2 1 F1") == SocketcandFrame(0x1AAAAAAA, b"\x01\xf1", extended=True, length=2)
    assert decode_request("sendrtr 123 0") == SocketcandFrame(0x123, remote=True)


@pytest.mark.parametrize(
    "text",
    ["", "ok", "frame", "frame 12 1.0 00", "frame 123 nan 00", "frame 123 1.0 0", "frame 1_3 1.0 00",
     "frame FFF 1.0 00", "frame 123 1.0 001122334455667788", "rtr 123 1.0 9", "error unknown command", "send 123 1 00"],
)  # fmt: skip
def test_what_is_no_event(text):
    with pytest.raises(CodecError):
        decode_event(text)


@given(st.lists(STANDARD, max_size=5), st.lists(st.integers(0, 400), max_size=6))
def test_any_cut_gives_the_same(frames, cuts):
    data = b"".join(frame.encode_event() for frame in frames)
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    stream = BracketStream()
    for a, b in pairwise(places):
        stream.feed(data[a:b])
    assert ([decode_event(text) for text in stream.texts], stream.malformed) == (frames, 0)


@given(st.lists(STANDARD, max_size=4), st.binary(max_size=300))
def test_junk_costs_no_frame_after_it(frames, junk):
    data = junk + b">" + b"".join(frame.encode_event() for frame in frames)
    at_once, by_byte = BracketStream(), BracketStream()
    at_once.feed(data)
    for byte in data:
        by_byte.feed(bytes([byte]))
    for stream in (at_once, by_byte):
        assert [decode_event(text) for text in list(stream.texts)[len(stream.texts) - len(frames) :]] == frames
