"""slcan lines from the Lawicel manual, and streams cut and soiled anywhere."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs.can_frames import FD_LENGTHS
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.slcan import SlcanFrame, SlcanStream, decode_flags, encode_flags

TABLE = [
    (SlcanFrame(0x100, b"\x11\x22\x33", 3), b"t1003112233\r"),
    (SlcanFrame(0x10, b"\xff", 1, extended=True), b"T000000101FF\r"),
    (SlcanFrame(0x7FF, b"", 0), b"t7FF0\r"),
    (SlcanFrame(0x123, b"", 8, remote=True), b"r1238\r"),
    (SlcanFrame(0x1FFFFFFF, b"", 2, extended=True, remote=True), b"R1FFFFFFF2\r"),
    (SlcanFrame(0x100, bytes(12), 12, fd=True), b"d1009" + b"00" * 12 + b"\r"),
    (SlcanFrame(0x8001, bytes(64), 64, extended=True, fd=True), b"D00008001F" + b"00" * 64 + b"\r"),
    (SlcanFrame(0x100, b"\x50", 1, fd=True, switched=True), b"b100150\r"),
    (SlcanFrame(0x8001, bytes(24), 24, extended=True, fd=True, switched=True), b"B00008001C" + b"00" * 24 + b"\r"),
]
STANDARD = st.builds(lambda i, d: SlcanFrame(i, d, len(d)), st.integers(0, 0x7FF), st.binary(max_size=8))
EXTENDED = st.builds(
    lambda i, d: SlcanFrame(i, d, len(d), extended=True), st.integers(0, 0x1FFFFFFF), st.binary(max_size=8)
)
REMOTE = st.builds(lambda i, n: SlcanFrame(i, b"", n, remote=True), st.integers(0, 0x7FF), st.integers(0, 8))
FLEXIBLE = st.builds(
    lambda i, n, extended, switched: SlcanFrame(i, b"\xa5" * n, n, extended, fd=True, switched=switched),
    st.integers(0, 0x7FF),
    st.sampled_from(FD_LENGTHS),
    st.booleans(),
    st.booleans(),
)
FRAMES = st.one_of(STANDARD, EXTENDED, REMOTE, FLEXIBLE)


@pytest.mark.parametrize(("frame", "line"), TABLE)
def test_both_directions(frame, line):
    assert frame.encode() == line
    assert SlcanFrame.decode(line[:-1]) == frame


@pytest.mark.parametrize(
    "frame",
    [SlcanFrame(1, bytes(9), 9, fd=True), SlcanFrame(1, bytes(12), 12), SlcanFrame(0x800, b"", 0)],
    ids=["no length of CAN FD", "no length of classical CAN", "identifier"],
)
def test_what_no_bus_carries_is_not_sent(frame):
    with pytest.raises(CodecError, match="no such frame has"):
        frame.encode()


def test_an_adapters_time_stamp_is_passed_over():
    assert SlcanFrame.decode(b"t1001FF1A2B") == SlcanFrame(0x100, b"\xff", 1)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"x",
        b"t",
        b"t10",
        b"t1009",
        b"t100811",
        b"t1003zz2233",
        b"T0000001",
        b"t10011122334455",
        b"\xff\xfe",
        b"t1_0100",
        b"t+10100",
        b"t 10100",
        b"t8000",
        b"T200000000",
        b"d1009" + b"00" * 11,
        b"b8000",
        b"D00008001G",
    ],
)
def test_what_is_no_frame(line):
    with pytest.raises(CodecError):
        SlcanFrame.decode(line)


@given(st.lists(FRAMES, max_size=5), st.lists(st.integers(0, 200), max_size=6))
def test_any_cut_gives_the_same(frames, cuts):
    data = b"".join(frame.encode() for frame in frames)
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    stream = SlcanStream()
    for a, b in pairwise(places):
        stream.feed(data[a:b])
    assert (list(stream.frames), stream.malformed) == (frames, 0)


@given(st.lists(FRAMES, max_size=4), st.binary(max_size=200))
def test_junk_costs_no_frame_after_it(frames, junk):
    data = junk + b"\r" + b"".join(frame.encode() for frame in frames)
    at_once, by_byte = SlcanStream(), SlcanStream()
    at_once.feed(data)
    for byte in data:
        by_byte.feed(bytes([byte]))
    assert list(at_once.frames)[len(at_once.frames) - len(frames) :] == frames
    assert list(by_byte.frames)[len(by_byte.frames) - len(frames) :] == frames


def test_answers_to_commands_are_no_bad_lines():
    stream = SlcanStream()
    stream.feed(b"\r\a\rz\rV1013\rNA123\rF00\r")
    assert (len(stream.frames), stream.malformed) == (0, 0)


def test_a_line_without_end_does_not_grow():
    stream = SlcanStream()
    stream.feed(b"t" * 1000)
    stream.feed(b"\r" + SlcanFrame(1, b"", 0).encode())
    assert (list(stream.frames), stream.malformed) == ([SlcanFrame(1, b"", 0)], 1)


def test_the_end_of_a_line_too_long_is_no_frame():
    at_once, by_byte = SlcanStream(), SlcanStream()
    data = b"x" * 170 + b"t1000\rt2000\r"
    at_once.feed(data)
    for byte in data:
        by_byte.feed(bytes([byte]))
    for stream in (at_once, by_byte):
        assert (list(stream.frames), stream.malformed) == ([SlcanFrame(0x200, b"", 0)], 1)


@given(st.integers(0, 255))
def test_status_flags_both_ways(flags):
    assert decode_flags(encode_flags(flags)[:-1]) == flags


@pytest.mark.parametrize("line", [b"", b"F", b"F1", b"F1G", b"F123", b"X12", b"F+1"])
def test_what_are_no_status_flags(line):
    with pytest.raises(CodecError):
        decode_flags(line)


def test_status_flags_and_refusals_stand_among_the_frames():
    stream = SlcanStream()
    stream.feed(b"\a\rF80\rt1000\rF0Z\r\aF00\rF\r")
    assert (list(stream.flags), stream.refused, stream.malformed, stream.flags_asked) == ([0x80, 0], 2, 1, 1)
    assert list(stream.frames) == [SlcanFrame(0x100, b"", 0)]
