"""The state of a session as a screen needs it. It takes the events of the session, and draws nothing."""

from collections import deque
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.events import (
    Ended,
    Note,
    PartMeasured,
    Planned,
    Prompt,
    Question,
    SessionEvent,
    SessionState,
    StateChanged,
    StepBegun,
)
from norton_bench.identification.results import LiveEstimate
from norton_bench.jog.signals import BenchSignals
from norton_bench.records import FOR_PROGRAMS, TICK, Measured, SegmentInfo, Table
from norton_bench.rig.rig import Rig
from norton_bench.screen.picture.parts import BenchHealth, EstimateHistory, StepList, Tabulated


class RecentTicks:
    """The last ``length`` ticks; :meth:`rows` gives them in one piece, without copying."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._rows: Table = np.zeros(2 * length, TICK)
        self._end = 0

    def append(self, ticks: Table) -> None:
        """Append rows; of more than ``length`` the last ones."""
        ticks = ticks[-self._length :]
        if self._end + len(ticks) > len(self._rows):
            kept = self.rows()[-self._length :].copy()
            self._rows[: len(kept)] = kept
            self._end = len(kept)
        self._rows[self._end : self._end + len(ticks)] = ticks
        self._end += len(ticks)

    def rows(self) -> Table:
        """The rows, oldest first: a view, valid until the next append."""
        return self._rows[max(0, self._end - self._length) : self._end]

    def since(self, stamp_ns: int) -> Table:
        """The rows from ``stamp_ns`` on."""
        rows = self.rows()
        return rows[np.searchsorted(rows["tick_ns"], stamp_ns) :]


PROCEDURE, STAIRCASE, SWEEP = "free", "staircase", "search"
# The velocity of a level is taken at the end of its dwell.
SETTLED_SHARE = 0.5
SHORTEST_DWELL_TICKS = 20
CLOUD_EVERY_TICKS = 10
LONGEST_CLOUD = 6000


@dataclass
class SourceSeen:
    """The measured motion source: velocity against command while zero torque is imposed.

    ``levels``: by staircase, the command and the settled velocity [rad/s] of each level, shape (levels, 2).

    ``cloud`` holds the sweeps, likewise, shape (points, 2).
    """

    levels: dict[int, FloatArray] = field(default_factory=dict)
    cloud: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    _rising: dict[int, bool] = field(default_factory=dict)
    _stairs: dict[int, list[Table]] = field(default_factory=dict)

    def take(self, part: Measured) -> None:
        """Add a part: sweeps point by point, staircases level by level."""
        for segment in part.segments:
            if segment.procedure == PROCEDURE and len(part.ticks):
                rows = part.ticks[part.ticks["segment"] == segment.index]
                if segment.name.startswith(STAIRCASE):
                    self._step(segment, rows)
                elif segment.name.startswith(SWEEP):
                    self._sweep(rows)

    def branch(self, *, rising: bool) -> FloatArray:
        """The levels approached from below, or from above."""
        levels = [self.levels[index] for index, up in self._rising.items() if up is rising and len(self.levels[index])]
        return np.concatenate(levels) if levels else np.empty((0, 2))

    def _sweep(self, rows: Table) -> None:
        thin = rows[::CLOUD_EVERY_TICKS]
        self.cloud = np.concatenate([self.cloud, _pairs(thin)])[-LONGEST_CLOUD:]

    def _step(self, segment: SegmentInfo, rows: Table) -> None:
        pieces = self._stairs.setdefault(segment.index, [])
        pieces.append(rows)
        stairs = np.concatenate(pieces)
        edges = np.flatnonzero(np.diff(stairs["command"])) + 1
        dwells = [dwell for dwell in np.split(stairs, edges) if len(dwell) >= SHORTEST_DWELL_TICKS]
        settled = [_pairs(dwell[round(SETTLED_SHARE * len(dwell)) :]).mean(axis=0) for dwell in dwells]
        self.levels[segment.index] = np.array(settled).reshape(-1, 2)
        self._rising[segment.index] = "falling" not in segment.name


def _pairs(rows: Table) -> FloatArray:
    return np.column_stack([rows["command"], rows["velocity_rad_s"]])


KEPT = 400
STEP, OPERATOR = "step", "operator"


@dataclass(frozen=True)
class LogLine:
    """A line of the log. ``time_s`` is bench time, None before the first tick. ``kind`` as of an event, or "note"."""

    time_s: float | None
    kind: str
    text: str


class EventLog:
    """The last lines; ``total`` counts all there ever were."""

    def __init__(self) -> None:
        self.lines: deque[LogLine] = deque(maxlen=KEPT)
        self.total = 0

    def add(self, line: LogLine) -> None:
        """Append a line, unless it repeats the text of an event; steps and answers to an operator may repeat."""
        if line.kind not in (STEP, OPERATOR) and any(line.text == before.text for before in list(self.lines)[-8:]):
            return
        self.lines.append(line)
        self.total += 1


RECENT_S = 40.0
PACE_OVER_S = 2.0
# Kinds of events for a session that resumes this one; the list of steps shows the same.
FINISHED_STEP = "step"
OVER = (SessionState.DONE, SessionState.FAILED)
# Drives may be enabled.
LIVE = (SessionState.RUNNING, SessionState.PAUSING)


class Picture:
    """The state of one session. ``state`` is None until it has begun; :meth:`take` gets its events."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.state: SessionState | None = None
        self.steps = StepList()
        self.recent = RecentTicks(round(RECENT_S / rig.tick_s))
        self.source = SourceSeen()
        self.tabulated = Tabulated()
        self.known = EstimateHistory()
        self.health = BenchHealth(rig)
        self.signals = BenchSignals(rig)
        self.log = EventLog()
        self.segment: SegmentInfo | None = None
        self.prompt: Prompt | None = None
        self.summary: Ended | None = None
        self.fitting = ""  # the running stage of the final fit
        self.changes = 0  # grows with every event
        self._first_ns: int | None = None
        self._now_ns = 0
        self._paces: list[tuple[float, float]] = []
        self._fit_began = 0.0
        self.fit_took_s = 0  # whole seconds since the final fit began

    @property
    def now_s(self) -> float:
        """Bench time since the first tick."""
        return 0.0 if self._first_ns is None else (self._now_ns - self._first_ns) * 1e-9

    @property
    def in_situ(self) -> bool:
        """Whether only the step in situ is possible: there is a load drive, but no torque sensor."""
        return self.rig.wiring.load is not None and self.rig.wiring.torque_sensor is None

    @property
    def concluding(self) -> bool:
        """Whether the final fit runs: the drives stay idle, and orders have no effect."""
        return self.state is SessionState.CONCLUDING

    @property
    def first_ns(self) -> int:
        return self._first_ns or 0

    @property
    def pace(self) -> float:
        """Bench time over wall time, lately; 0 while nothing runs."""
        if len(self._paces) < 2:
            return 0.0
        (began, began_s), (ended, ended_s) = self._paces[0], self._paces[-1]
        return (ended_s - began_s) / (ended - began) if ended > began else 0.0

    def take(self, event: SessionEvent) -> None:
        """Take an event."""
        self.changes += 1
        match event:
            case Planned(steps):
                self.steps.plan(steps)
            case StepBegun(index, name):
                self.steps.begin(index, self.now_s)
                self.log.add(LogLine(self._log_s, STEP, f"{name} begins"))
            case PartMeasured(measured, live):
                self._take_part(measured, live)
            case Note(text):
                self.fitting = text if self.concluding else self.fitting
                self.log.add(LogLine(self._log_s, "note", text))
            case StateChanged(state):
                self._take_state(state)
            case Question(prompt):
                self.prompt = prompt
            case Ended():
                self._take_end(event)

    def _take_part(self, measured: Measured, live: LiveEstimate) -> None:
        if len(measured.ticks):
            if self._first_ns is None:
                self._first_ns = int(measured.ticks["tick_ns"][0])
            self._now_ns = int(measured.ticks["tick_ns"][-1])
        self.segment = measured.segments[-1] if measured.segments else self.segment
        self.recent.append(measured.ticks)
        self.source.take(measured)
        self.tabulated.take(measured)
        self.health.take(measured)
        self.signals.take(measured)
        self.known.take(live)
        self.steps.advance(self.now_s)
        for event in measured.events:
            if event.kind in (FINISHED_STEP, *FOR_PROGRAMS):
                continue
            stamp_s = None if self._first_ns is None else (event.stamp_ns - self._first_ns) * 1e-9
            self.log.add(LogLine(stamp_s, event.kind, event.text))

    def _take_state(self, state: SessionState) -> None:
        self.state = state
        if state is not SessionState.ASKING:
            self.prompt = None
        if state is SessionState.CONCLUDING:
            self.fitting, self._fit_began, self.fit_took_s = "final fit", perf_counter(), 0
        if state in (SessionState.CONCLUDING, *OVER):
            self.steps.end(self.now_s, whole=state is not SessionState.FAILED)

    def _take_end(self, summary: Ended) -> None:
        self.summary = summary
        self.known.settle(summary.estimates)
        if summary.failure:
            self.log.add(LogLine(self._log_s, "stop", summary.failure))

    def look_at_clock(self) -> None:
        """Update the pace and the duration of the final fit; called with every frame."""
        now = perf_counter()
        if self.concluding and int(now - self._fit_began) > self.fit_took_s:
            self.fit_took_s = int(now - self._fit_began)
            self.changes += 1
        self._paces.append((now, self.now_s))
        while self._paces[0][0] < now - PACE_OVER_S:
            self._paces.pop(0)

    @property
    def _log_s(self) -> float | None:
        return None if self._first_ns is None else self.now_s
