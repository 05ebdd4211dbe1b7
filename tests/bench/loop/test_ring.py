"""The ring: every record whole, once and in order, or counted as lost; with a writer in another process too."""

import multiprocessing
import struct
import time
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.loop import outbox
from norton_bench.loop.outbox import Ring, RingReader, RingWriter

SPAWN = multiprocessing.get_context("spawn")
NUMBER = struct.Struct("<Q")
# Longer than a cache line, and no multiple of one.
CHECKED = struct.Struct("<Q180sI")


def numbers(records: bytes) -> list[int]:
    return [number for (number,) in NUMBER.iter_unpack(records)]


@settings(deadline=None, max_examples=200)
@given(slots=st.integers(2, 9), bursts=st.lists(st.integers(0, 25), max_size=30))
def test_whatever_the_bursts_records_are_read_once_and_in_order_or_counted(slots: int, bursts: list[int]) -> None:
    ring = Ring(slots, NUMBER.size)
    writer, reader = RingWriter(ring), RingReader(ring)
    written = expected = 0
    for burst in bursts:
        for _ in range(burst):
            writer.put(NUMBER.pack(written))
            written += 1
        records, lost = reader.take()
        found = numbers(records)
        # One slot less than there are: the writer may be in it.
        assert lost == max(0, burst - (slots - 1))
        assert found == list(range(expected + lost, written))
        expected = written
    assert reader.written == written


def test_a_reader_begins_with_what_comes_next_and_may_skip() -> None:
    ring = Ring(8, NUMBER.size)
    writer = RingWriter(ring)
    writer.put(NUMBER.pack(0))
    reader = RingReader(ring)
    assert reader.take() == (b"", 0)
    writer.put(NUMBER.pack(1))
    reader.skip()
    writer.put(NUMBER.pack(2))
    assert numbers(reader.take().records) == [2]


@pytest.mark.parametrize("size", [NUMBER.size - 1, NUMBER.size + 1])
def test_a_record_of_another_size_is_refused(size: int) -> None:
    writer = RingWriter(Ring(4, NUMBER.size))
    with pytest.raises(ValueError, match="different structures"):
        writer.put(bytes(size))


def test_what_the_writer_overwrites_during_a_copy_is_thrown_away() -> None:
    ring = Ring(8, NUMBER.size)
    writer, reader = RingWriter(ring), RingReader(ring)
    for number in range(7):
        writer.put(NUMBER.pack(number))
    copy = reader._copy

    def copy_slowly(first: int, end: int) -> bytes:
        copied = copy(first, end)
        for number in range(7, 11):
            writer.put(NUMBER.pack(number))
        return copied

    reader._copy = copy_slowly  # type: ignore[method-assign]
    records, lost = reader.take()
    assert (numbers(records), lost) == ([4, 5, 6], 4)
    reader._copy = copy  # type: ignore[method-assign]
    assert reader.take().lost == 0


def test_machines_that_reorder_are_fenced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox.platform, "machine", lambda: "aarch64")
    ring = Ring(4, NUMBER.size)
    writer, reader = RingWriter(ring), RingReader(ring)
    writer.put(NUMBER.pack(5))
    assert numbers(reader.take().records) == [5]


def write_on(ring: Ring, count: int, burst: int) -> None:
    """Records that show whether they are whole; now and then the writer rests, as a loop does between ticks."""
    writer = RingWriter(ring)
    for number in range(count):
        text = bytes([number % 251]) * 180
        writer.put(CHECKED.pack(number, text, zlib.crc32(text + NUMBER.pack(number))))
        if burst and number % burst == 0:
            time.sleep(0.0005)


@pytest.mark.long
@pytest.mark.parametrize(("slots", "burst", "rest_s"), [(4096, 20, 0.005), (16, 0, 0.0), (64, 0, 0.002)])
def test_a_reader_in_another_process_never_sees_torn_or_reordered_records(
    slots: int, burst: int, rest_s: float
) -> None:
    ring, count = Ring(slots, CHECKED.size), 20_000 if burst else 200_000
    reader = RingReader(ring)
    writer = SPAWN.Process(target=write_on, args=(ring, count, burst))
    writer.start()
    following = seen = missed = 0
    try:
        while following < count:
            alive = writer.is_alive()
            records, lost = reader.take()
            following += lost
            missed += lost
            for number, text, checksum in CHECKED.iter_unpack(records):
                assert number == following
                assert zlib.crc32(text + NUMBER.pack(number)) == checksum
                following += 1
                seen += 1
            assert alive or records or lost
            time.sleep(rest_s)
    finally:
        writer.kill()
        writer.join()
    assert seen + missed == count
    assert (missed == 0) == (burst > 0)
