"""The loop's timing: figures from a tick table."""

import numpy as np
import pytest

from norton_bench.loop.timing import STAGES, loop_timing, timing_rows, timing_sentence
from norton_bench.records import NO_SEGMENT, TICK, Table

TICK_NS = 1_000_000


def ticks_at(places: list[int], segment: int = 0) -> Table:
    """On time at these places of the grid, and of no duration."""
    ticks = np.zeros(len(places), TICK)
    ticks["tick_ns"], ticks["segment"] = np.array(places) * TICK_NS, segment
    return ticks


def test_what_is_missed_inside_a_segment_was_skipped_and_between_segments_nothing_was_due() -> None:
    held = [ticks_at([7, 8], NO_SEGMENT), ticks_at([990, 991], NO_SEGMENT)]  # drives were idle in between
    ticks = np.concatenate([ticks_at([0, 1, 2, 5, 6]), *held, ticks_at([1000, 1001, 1003], segment=1)])
    ticks["work_ns"] = 1000
    timing = loop_timing(ticks)
    assert timing is not None
    assert (timing.tick_ns, timing.ticks, timing.skipped) == (TICK_NS, 8, 3)
    assert timing.share_run == pytest.approx(8 / 11)
    assert timing.period.most_ns == 3 * TICK_NS
    assert timing_sentence(timing) == "8 ticks at 1000 a second, 72.73 % of those that were due; 3 were skipped."


def test_a_stall_is_as_late_as_it_was_long() -> None:
    ticks = ticks_at([0, 1, 5, 6])
    ticks["lateness_ns"] = [0, 1000, 300_000, 2000]
    timing = loop_timing(ticks)
    assert timing is not None
    assert timing.lateness.most_ns == 3 * TICK_NS + 300_000
    assert timing.lateness.median_ns == 1500.0


def test_work_slack_and_stages_are_told() -> None:
    ticks = ticks_at(list(range(1000)))
    for number, (column, _) in enumerate(STAGES, 1):
        ticks[column] = 10_000 * number
    ticks["work_ns"], ticks["lateness_ns"] = 100_000, 5_000
    ticks["work_ns"][-1] = 999_000
    timing = loop_timing(ticks)
    assert timing is not None
    assert timing.work.median_ns == 100_000
    assert (timing.slack.median_ns, timing.slack.most_ns) == (895_000, -4_000)
    assert [(name, spread.median_ns) for name, spread in timing.stages] == [
        (name, 10_000.0 * number) for number, (_, name) in enumerate(STAGES, 1)
    ]
    head, rows = timing_rows(timing)
    assert all(len(row) == len(head) for row in rows)
    assert rows[-1] == ("slack (least)", "895.0", "895.0", "894.1", "-4.0")


def test_lock_step_has_nothing_to_tell_and_one_tick_too_little() -> None:
    timing = loop_timing(ticks_at([3, 4, 5]))
    assert timing is not None
    assert timing.in_lock_step
    assert timing.stages == ()
    assert "lock step" in timing_sentence(timing)
    assert loop_timing(ticks_at([3])) is None
    assert loop_timing(ticks_at([])) is None
