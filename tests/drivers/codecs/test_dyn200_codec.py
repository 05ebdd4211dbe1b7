"""The frames that a DYN-200 pushes: no byte marks their beginning, so they must be found, and found rightly."""

from itertools import pairwise
from random import Random

import pytest
from crccheck.crc import CrcModbus
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.dyn200 import FRAME_LENGTH, FRAMES_TO_LOCK, PushFrame, PushStream, number_of, number_value

FRAMES = st.builds(PushFrame, st.integers(-0xFFFF, 0xFFFF), st.integers(0, 0x7FFF))
STREAMS = st.lists(FRAMES, min_size=FRAMES_TO_LOCK + 1, max_size=12)


def wire(frames: list[PushFrame]) -> bytes:
    return b"".join(frame.encode() for frame in frames)


def by_byte(stream: PushStream, data: bytes) -> list[PushFrame]:
    return [frame for byte in data for frame in stream.feed(bytes([byte]))]


def test_a_published_vector():
    # The test of a C library for the sensor: 00 7B 80 64 is -123 digits at 100 revolutions a minute.
    payload = bytes.fromhex("00 7B 80 64")
    frame = payload + CrcModbus.calc(payload).to_bytes(2, "little")
    assert PushFrame.decode(frame) == PushFrame(-123, 100)
    assert PushFrame(-123, 100).encode() == frame


@given(FRAMES)
def test_round_trip(frame):
    assert PushFrame.decode(frame.encode()) == frame


@given(st.integers(-(2**31), 2**31 - 1))
def test_numbers_in_registers(number):
    assert number_of(number_value(number)) == number
    assert number_value(number) == number.to_bytes(4, "big", signed=True)


@pytest.mark.parametrize("frame", [PushFrame(0x10000, 0), PushFrame(0, 0x8000), PushFrame(0, -1)])
def test_what_fits_no_frame_is_refused(frame):
    with pytest.raises(CodecError):
        frame.encode()
    with pytest.raises(CodecError):
        number_value(2**31)


@given(FRAMES, st.integers(0, FRAME_LENGTH - 1), st.integers(1, 255))
def test_one_wrong_byte_is_noticed(frame, place, difference):
    data = bytearray(frame.encode())
    data[place] ^= difference
    with pytest.raises(CodecError):
        PushFrame.decode(data)


@given(STREAMS, st.lists(st.integers(0, 100), max_size=6))
def test_any_cut_gives_the_same(frames, cuts):
    data = wire(frames)
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    at_once, cut = PushStream(), PushStream()
    found = at_once.feed(data)
    assert [frame for a, b in pairwise(places) for frame in cut.feed(data[a:b])] == found
    assert (cut.discarded_bytes, cut.crc_errors, cut.pending_bytes) == (
        at_once.discarded_bytes,
        at_once.crc_errors,
        at_once.pending_bytes,
    )


def varied(count: int, seed: int = 1) -> list[PushFrame]:
    """Frames as those of a sensor with noise."""
    random = Random(seed)
    return [PushFrame(random.randrange(-900, 900), random.randrange(100)) for _ in range(count)]


@given(st.binary(max_size=40), st.integers(0, 1000))
def test_it_locks_after_junk_and_loses_no_frame_afterwards(junk, seed):
    frames = varied(40, seed)
    stream = PushStream()
    found = stream.feed(junk + wire(frames))
    # Junk may look like a frame at some place, which delays the lock until it no longer does.
    assert stream.locked
    assert found == frames[-len(found) :]
    assert len(found) >= len(frames) - FRAMES_TO_LOCK - 2
    assert stream.discarded_bytes == len(junk) + FRAME_LENGTH * (len(frames) - len(found))


@given(st.integers(0, 30 * FRAME_LENGTH - 1), st.integers(1, 255))
def test_a_wrong_byte_unlocks_and_gives_no_wrong_reading(place, difference):
    frames = varied(30)
    data = bytearray(wire(frames))
    data[place] ^= difference
    stream = PushStream()
    found = by_byte(stream, bytes(data))
    assert set(found) <= set(frames)
    assert len(found) >= len(frames) - 2 * FRAMES_TO_LOCK - 2


@given(st.integers(FRAME_LENGTH * FRAMES_TO_LOCK, 30 * FRAME_LENGTH - 1))
def test_a_lost_byte_gives_no_wrong_reading(place):
    frames = varied(40)
    data = wire(frames)
    stream = PushStream()
    found = stream.feed(data[:place] + data[place + 1 :])
    assert set(found) <= set(frames)
    assert found[-5:] == frames[-5:]


def shifted_frame() -> PushFrame:
    """One that, repeated, looks like frames at another place too, as one in thirteen thousand does."""
    for torque in range(0x10000):
        frame = PushFrame(torque, 0)
        twice = frame.encode() * 2
        for place in range(1, FRAME_LENGTH):
            try:
                PushFrame.decode(twice[place : place + FRAME_LENGTH])
            except CodecError:
                continue
            return frame
    raise AssertionError("there is none")


def test_a_sensor_at_rest_that_looks_like_frames_at_two_places_is_not_believed_until_it_moves():
    frame = shifted_frame()
    stream = PushStream()
    # Opened within a frame: the wrong place comes first.
    assert stream.feed(wire([frame] * 50)[1:]) == []
    frames = varied(20)
    found = stream.feed(wire(frames))
    assert len(found) >= 15
    assert found == frames[-len(found) :]


def test_a_million_random_bytes_hold_no_reading():
    stream, random = PushStream(), Random(2)
    assert sum(len(stream.feed(random.randbytes(1000))) for _ in range(1000)) == 0
    assert stream.discarded_bytes >= 1_000_000 - FRAME_LENGTH


def test_random_bytes_after_a_lock_give_nothing_either():
    # The place is known, and one stretch in 65536 ends in its CRC by chance: it must have unlocked by then.
    false = 0
    for seed in range(200):
        stream = PushStream()
        stream.feed(wire(varied(10, seed)))
        false += len(stream.feed(Random(seed).randbytes(5000)))
    assert false == 0
