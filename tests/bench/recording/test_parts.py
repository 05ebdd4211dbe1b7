"""A recording falls into the parts that it was put together from, to the last reading."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.recording.contents import parts_of
from norton_bench.recording.reader import read_recording, read_so_far
from norton_bench.recording.recorder import Recorder
from norton_bench.records import MOTION, TABLES, TICK, Measured, SegmentInfo
from norton_bench.segments import Use

TICK_NS = 1_000_000


def part(first: int, count: int, late_ns: int) -> Measured:
    """Ticks that begin late, and a reading just before each of them."""
    ticks, motion = np.zeros(count, TICK), np.zeros(count, MOTION)
    ticks["tick_ns"] = (first + np.arange(count)) * TICK_NS
    ticks["lateness_ns"] = late_ns
    motion["arrival_ns"] = ticks["tick_ns"] + late_ns
    motion["sequence"] = first + np.arange(count)
    segment = SegmentInfo(0, "free", "x", Use.IDENTIFY, "admittance", 0, (first + count) * TICK_NS)
    return Measured(ticks=ticks, motion=motion, segments=(segment,))


@pytest.mark.parametrize("late_ns", [0, 700_000])
def test_parts_come_back_as_they_were_put(tmp_path: Path, late_ns: int) -> None:
    starts = [0, 40, 100, 101, 250]
    put = [part(first, last - first, late_ns) for first, last in zip(starts, [*starts[1:], 300], strict=True)]
    with Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=10.0) as recorder:
        for each in put:
            recorder.put(each)
    found = list(parts_of(read_recording(tmp_path / "r.mcap")))
    assert len(found) == len(put)
    for one, other in zip(found, put, strict=True):
        for stream in TABLES:
            assert getattr(one, stream.name).tobytes() == getattr(other, stream.name).tobytes(), stream.name
        assert one.segments == (replace(other.segments[0], end_ns=300 * TICK_NS),)


def test_a_recording_can_be_read_while_it_grows(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=10.0)
    seen = 0
    for first in range(0, 500, 50):
        recorder.put(part(first, 50, 0))
        growing = read_so_far(tmp_path / "r.mcap")
        assert not growing.complete
        assert seen <= len(growing.measured.ticks) <= first + 50
        np.testing.assert_array_equal(np.diff(growing.measured.ticks["tick_ns"]), TICK_NS)
        seen = len(growing.measured.ticks)
    recorder.close()
    assert len(read_so_far(tmp_path / "r.mcap").measured.ticks) == 500
