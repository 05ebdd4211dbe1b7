"""Bota's serial frames: a CRC checked against others', and a stream that may be cut and soiled anywhere."""

from itertools import pairwise
from random import Random
from struct import pack

import pytest
from crccheck.crc import CrcX25
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs.bota import FRAME_LENGTH, BotaFrame, BotaStream
from norton_drivers.codecs.common import CodecError, crc16_x25

F32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
U32 = st.integers(0, 0xFFFFFFFF)
FRAMES = st.builds(BotaFrame, st.integers(0, 0xFFFF), F32, F32, F32, F32, F32, F32, U32, F32)


def test_the_published_check_value():
    assert crc16_x25(b"123456789") == 0x906E


@given(st.binary(max_size=64))
def test_the_crc_against_another_implementation(data):
    assert crc16_x25(data) == CrcX25.calc(data)


def test_a_frame_laid_out_by_hand():
    frame = BotaFrame(0x0002, 1.0, -2.0, 3.0, 0.5, -0.25, 0.125, 0x01020304, 25.0)
    payload = bytes.fromhex(
        "0200 0000803F 000000C0 00004040 0000003F 000080BE 0000003E 04030201 0000C841".replace(" ", "")
    )
    data = b"\xaa" + payload + pack("<H", CrcX25.calc(payload))
    assert frame.encode() == data
    assert len(data) == FRAME_LENGTH
    assert BotaFrame.decode(data) == frame


@given(FRAMES)
def test_round_trip(frame):
    assert BotaFrame.decode(frame.encode()) == frame
    assert BotaStream().feed(frame.encode()) == [frame]


@given(FRAMES, st.integers(0, FRAME_LENGTH - 1), st.integers(1, 255))
def test_one_wrong_byte_is_noticed(frame, place, difference):
    data = bytearray(frame.encode())
    data[place] ^= difference
    with pytest.raises(CodecError):
        BotaFrame.decode(data)


def test_a_value_that_fits_no_field():
    with pytest.raises(CodecError):
        BotaFrame(0, 1e300, 0, 0, 0, 0, 0, 0, 0).encode()


@given(st.lists(FRAMES, max_size=4), st.lists(st.integers(0, 200), max_size=6))
def test_any_cut_gives_the_same(frames, cuts):
    data = b"".join(frame.encode() for frame in frames)
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    stream = BotaStream()
    found = [frame for a, b in pairwise(places) for frame in stream.feed(data[a:b])]
    assert found == frames
    assert stream.discarded_bytes == stream.crc_errors == 0


@given(st.lists(st.one_of(FRAMES, st.binary(max_size=50)), max_size=6))
def test_junk_anywhere_byte_by_byte_or_at_once_is_the_same(parts):
    data = b"".join(part if isinstance(part, bytes) else part.encode() for part in parts) + bytes(FRAME_LENGTH)
    at_once, by_byte = BotaStream(), BotaStream()
    found = at_once.feed(data)
    assert [frame for byte in data for frame in by_byte.feed(bytes([byte]))] == found
    assert (at_once.discarded_bytes, at_once.crc_errors) == (by_byte.discarded_bytes, by_byte.crc_errors)
    assert at_once.discarded_bytes + FRAME_LENGTH * len(found) <= len(data)


@given(st.lists(FRAMES, min_size=1, max_size=3), st.binary(max_size=60))
def test_every_frame_after_junk_is_found(frames, junk):
    # Junk may by chance look like the start of a frame, but a CRC that matches by chance is one in 65536.
    stream = BotaStream()
    data = junk + b"".join(frame.encode() for frame in frames)
    assert stream.feed(data) == frames
    assert stream.discarded_bytes == len(junk)


def test_a_million_random_bytes_hold_no_frame():
    # By chance, one in 256 times 65536 stretches is one: with this seed none of a million.
    stream, random = BotaStream(), Random(1)
    assert sum(len(stream.feed(random.randbytes(1000))) for _ in range(1000)) == 0


def test_a_false_start_costs_no_frame():
    frame = BotaFrame(0, 0, 0, 0, 0, 0, 1.0, 7, 20.0)
    stream = BotaStream()
    assert stream.feed(b"\xaa\xaa\xaa" + frame.encode()) == [frame]
    assert (stream.discarded_bytes, stream.crc_errors) == (3, 3)
