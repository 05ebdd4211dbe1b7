"""How a loop kept time, from its tick table: for screens, reports and whoever opens a recording."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.records import NO_SEGMENT, Table

# The table's column of each stage, in the order of a tick, and what is done in it.
STAGES = (
    ("receive_ns", "receive"),
    ("control_ns", "sample and control"),
    ("guard_ns", "guard"),
    ("send_ns", "send"),
    ("put_ns", "put away"),
)
PERCENTILES = (50.0, 99.0, 99.9, 100.0)


@dataclass(frozen=True)
class Spread:
    """Of one duration [ns] over many ticks."""

    median_ns: float
    p99_ns: float
    p999_ns: float
    most_ns: float


@dataclass(frozen=True)
class LoopTiming:
    """Of the ticks of a table.

    ``lateness`` is counted from the first deadline that was missed, so that a stall is as long as it was however many
    ticks it cost; ``skipped`` are those. ``period`` is from one beginning to the next. ``slack`` is what was left of
    the period when a tick's commands had gone; its least shows trouble first, so its percentiles count from
    above. ``stages`` is empty where nobody measured them: in lock step, and in recordings from before they were.
    """

    tick_ns: int
    ticks: int
    skipped: int
    period: Spread
    lateness: Spread
    work: Spread
    slack: Spread
    stages: tuple[tuple[str, Spread], ...]

    @property
    def in_lock_step(self) -> bool:
        """Nothing takes any time."""
        return self.work.most_ns == 0.0

    @property
    def share_run(self) -> float:
        """Of the ticks that were due."""
        return self.ticks / (self.ticks + self.skipped)


def loop_timing(ticks: Table) -> LoopTiming | None:
    """The timing of a table of kind TICK, in time order; None for one that is too short to tell.

    Between segments nothing is due: only what was missed inside one counts as skipped.
    """
    ticks = ticks[ticks["segment"] != NO_SEGMENT]
    deadline_ns, lateness_ns, work_ns = ticks["tick_ns"], ticks["lateness_ns"], ticks["work_ns"]
    within = np.diff(ticks["segment"]) == 0
    if not within.any():
        return None
    tick_ns = int(np.diff(deadline_ns)[within].min())
    missed = np.where(within, np.diff(deadline_ns) // tick_ns - 1, 0)
    return LoopTiming(
        tick_ns,
        len(ticks),
        int(missed.sum()),
        _spread(np.diff(deadline_ns + lateness_ns)[within]),
        _spread(lateness_ns + np.concatenate(([0], missed)) * tick_ns),
        _spread(work_ns),
        _least(tick_ns - lateness_ns - work_ns),
        tuple((name, _spread(ticks[column])) for column, name in STAGES) if ticks["receive_ns"].any() else (),
    )


def timing_rows(timing: LoopTiming) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Head and rows of one table for people, in microseconds."""
    head = ("loop", "median [µs]", "99 % [µs]", "99.9 % [µs]", "most [µs]")
    spreads = [("period", timing.period), ("lateness", timing.lateness), ("work", timing.work)]
    spreads += [(f"- {name}", spread) for name, spread in timing.stages]
    rows = [(name, *(_us(each) for each in (s.median_ns, s.p99_ns, s.p999_ns, s.most_ns))) for name, s in spreads]
    least = timing.slack
    rows.append(("slack (least)", *map(_us, (least.median_ns, least.p99_ns, least.p999_ns, least.most_ns))))
    return head, tuple(rows)


def timing_sentence(timing: LoopTiming) -> str:
    """How many ticks there were, and how many were missed."""
    count = f"{timing.ticks:,} ticks at {1e9 / timing.tick_ns:g} a second".replace(",", " ")
    if timing.in_lock_step:
        return f"{count}, in lock step: time waited for each of them."
    if not timing.skipped:
        return f"{count}; none was skipped."
    return f"{count}, {100 * timing.share_run:.2f} % of those that were due; {timing.skipped} were skipped."


def _spread(values: npt.NDArray[np.int64]) -> Spread:
    return Spread(*(float(each) for each in np.percentile(values, PERCENTILES)))


def _least(values: npt.NDArray[np.int64]) -> Spread:
    return Spread(*(float(each) for each in np.percentile(values, [100.0 - each for each in PERCENTILES])))


def _us(duration_ns: float) -> str:
    return f"{duration_ns * 1e-3:.1f}"
