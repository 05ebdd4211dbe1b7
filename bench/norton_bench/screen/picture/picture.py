"""Everything that is known of a session by whoever watches it. It takes the session's news, and draws nothing."""

from collections.abc import Sequence
from time import perf_counter

from norton_bench.identification.results import LiveEstimate
from norton_bench.jog.signals import Signals
from norton_bench.records import FOR_PROGRAMS, Measured, SegmentInfo
from norton_bench.rig.rig import Rig
from norton_bench.screen.picture.health import Health
from norton_bench.screen.picture.known import Known
from norton_bench.screen.picture.log import STEP, Line, Log
from norton_bench.screen.picture.source_seen import SourceSeen
from norton_bench.screen.picture.steps import Steps
from norton_bench.screen.picture.tabulated import Tabulated
from norton_bench.screen.picture.tape import Tape
from norton_bench.session.progress import PlannedStep, Prompt, SessionState, Summary

TAPE_S = 40.0
PACE_OVER_S = 2.0
# What a recording says of a step that is done, for whoever resumes it; the steps show that already.
FINISHED_STEP = "step"
OVER = (SessionState.DONE, SessionState.FAILED)
# Drives may be enabled.
LIVE = (SessionState.RUNNING, SessionState.PAUSING)


class Picture:
    """A :class:`norton_bench.session.progress.Progress`. ``state`` is None until a session has begun."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.state_now: SessionState | None = None
        self.steps = Steps()
        self.tape = Tape(round(TAPE_S / rig.tick_s))
        self.source = SourceSeen()
        self.tabulated = Tabulated()
        self.known = Known()
        self.health = Health(rig)
        self.signals = Signals(rig)
        self.log = Log()
        self.segment: SegmentInfo | None = None
        self.prompt: Prompt | None = None
        self.summary: Summary | None = None
        self.fitting = ""  # which part of the final fit goes on
        self.changes = 0  # grows with every piece of news
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
        """Whether nothing but the steps in situ can tell anything: there is a load, and nothing reads the torque."""
        return self.rig.wiring.load is not None and self.rig.wiring.torque_sensor is None

    @property
    def concluding(self) -> bool:
        """Whether the final fit goes on: the drives are idle for good, and there is nothing left to order."""
        return self.state_now is SessionState.CONCLUDING

    @property
    def first_ns(self) -> int:
        return self._first_ns or 0

    @property
    def pace(self) -> float:
        """Bench time over time, lately; 0 where nothing moves."""
        if len(self._paces) < 2:
            return 0.0
        (began, began_s), (ended, ended_s) = self._paces[0], self._paces[-1]
        return (ended_s - began_s) / (ended - began) if ended > began else 0.0

    def plan(self, steps: Sequence[PlannedStep]) -> None:
        self.changes += 1
        self.steps.plan(steps)

    def step(self, index: int, name: str) -> None:
        self.changes += 1
        self.steps.begin(index, self.now_s)
        self.log.add(Line(self._log_s, STEP, f"{name} begins"))

    def part(self, measured: Measured, live: LiveEstimate) -> None:
        self.changes += 1
        if len(measured.ticks):
            if self._first_ns is None:
                self._first_ns = int(measured.ticks["tick_ns"][0])
            self._now_ns = int(measured.ticks["tick_ns"][-1])
        self.segment = measured.segments[-1] if measured.segments else self.segment
        self.tape.append(measured.ticks)
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
            self.log.add(Line(stamp_s, event.kind, event.text))

    def note(self, text: str) -> None:
        self.changes += 1
        if self.concluding:
            self.fitting = text
        self.log.add(Line(self._log_s, "note", text))

    def state(self, state: SessionState) -> None:
        self.changes += 1
        self.state_now = state
        if state is not SessionState.ASKING:
            self.prompt = None
        if state is SessionState.CONCLUDING:
            self.fitting, self._fit_began, self.fit_took_s = "final fit", perf_counter(), 0
        if state in (SessionState.CONCLUDING, *OVER):
            self.steps.end(self.now_s, whole=state is not SessionState.FAILED)

    def ask(self, prompt: Prompt) -> None:
        self.changes += 1
        self.prompt = prompt

    def result(self, summary: Summary) -> None:
        self.changes += 1
        self.summary = summary
        self.known.settle(summary.estimates)
        if summary.failure:
            self.log.add(Line(self._log_s, "stop", summary.failure))

    def look_at_clock(self) -> None:
        """Called with every frame, so that the pace is known, and how long the final fit has taken."""
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
