"""A recording played back: the events of a running session, in bench time times a speed."""

import multiprocessing
import signal
from bisect import bisect_right
from collections.abc import Callable, Iterator
from itertools import groupby
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter

from norton_bench.errors import ExitCode, UsageError
from norton_bench.events import (
    Ended,
    PartMeasured,
    Planned,
    PlannedStep,
    SessionEvent,
    SessionState,
    StateChanged,
    StepBegun,
)
from norton_bench.identification.results import LiveEstimate
from norton_bench.recording.contents import Recording
from norton_bench.recording.reader import read_recording
from norton_bench.records import Measured

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
# The recorded event that ended a session before its time.
STOP = "stop"
# Measurements come in pieces no longer than this, and wherever the estimates changed.
PIECE_NS = 500_000_000


class Replay:
    """A recording, played back from the current time on. ``clock`` gives seconds, from any origin."""

    def __init__(self, recording: Recording, *, clock: Callable[[], float] = perf_counter) -> None:
        """Raises UsageError for a recording without a single tick."""
        self.measured, self._clock = recording.measured, clock
        if not len(self.measured.ticks):
            raise UsageError("the recording holds no tick: nothing was measured, so there is nothing to replay")
        ticks = self.measured.ticks["tick_ns"]
        self._first_ns, self._last_ns = int(ticks[0]), int(ticks[-1])
        self._live = _changes(recording)
        self._stamps = [live.stamp_ns for live in self._live]
        self._cuts = sorted({*self._stamps, *range(self._first_ns + PIECE_NS, self._last_ns, PIECE_NS)})
        self._steps = _steps(self.measured, self._last_ns)
        self.speed, self.paused = 1.0, False
        self._from_s, self._since = 0.0, clock()
        self._emitted_ns, self._emitted_steps, self._emitted_end = 0, 0, False

    @property
    def duration_s(self) -> float:
        return (self._last_ns - self._first_ns) * 1e-9

    @property
    def now_s(self) -> float:
        """The current time of the replay: bench time since the first tick [s]."""
        moved_s = 0.0 if self.paused else (self._clock() - self._since) * self.speed
        return min(max(self._from_s + moved_s, 0.0), self.duration_s)

    @property
    def ended(self) -> bool:
        return self.now_s >= self.duration_s

    def pause(self) -> None:
        self._stand_at(self.now_s)
        self.paused = True

    def resume(self) -> None:
        """Continue after a pause."""
        self._stand_at(self.now_s)
        self.paused = False

    def set_speed(self, speed: float) -> None:
        """Set the speed as a multiple of bench time; greater than 0."""
        self._stand_at(self.now_s)
        self.speed = speed

    def faster(self, steps: int) -> None:
        """Change the speed by so many steps of ``SPEEDS``; negative: slower."""
        place = min(range(len(SPEEDS)), key=lambda index: abs(SPEEDS[index] - self.speed))
        self.set_speed(SPEEDS[min(max(place + steps, 0), len(SPEEDS) - 1)])

    def seek(self, to_s: float) -> None:
        """Go to ``to_s``. All events up to there come again, so the watcher must start anew."""
        self._stand_at(min(max(to_s, 0.0), self.duration_s))
        self._emitted_ns, self._emitted_steps, self._emitted_end = 0, 0, False

    def events(self) -> Iterator[SessionEvent]:
        """The events since the last call, in order. Never waits."""
        until_ns = self._first_ns + round(self.now_s * 1e9) + 1
        if not self._emitted_ns:
            self._emitted_ns = self._first_ns
            steps = (PlannedStep(name, (end_ns - start_ns) * 1e-9) for name, start_ns, end_ns in self._steps)
            yield Planned(tuple(steps))
            yield StateChanged(SessionState.RUNNING)
        for index, (name, start_ns, _) in enumerate(self._steps):
            if self._emitted_ns <= start_ns < until_ns and index >= self._emitted_steps:
                yield from self._parts(start_ns)
                yield StepBegun(index, name)
                self._emitted_steps = index + 1
        yield from self._parts(until_ns)
        if self.ended and not self._emitted_end:
            self._emitted_end = True
            yield StateChanged(SessionState.FAILED if self._stopped else SessionState.DONE)

    @property
    def _stopped(self) -> bool:
        return any(event.kind == STOP for event in self.measured.events)

    def _parts(self, until_ns: int) -> Iterator[PartMeasured]:
        """The measurements up to ``until_ns``, in pieces, each with the live estimates of that time."""
        for cut_ns in self._cuts[bisect_right(self._cuts, self._emitted_ns) : bisect_right(self._cuts, until_ns - 1)]:
            yield PartMeasured(self._piece(cut_ns + 1), self._known(cut_ns))
        if until_ns > self._emitted_ns:
            yield PartMeasured(self._piece(until_ns), self._known(until_ns - 1))

    def _known(self, at_ns: int) -> LiveEstimate:
        known = bisect_right(self._stamps, at_ns)
        return self._live[known - 1] if known else LiveEstimate(0)

    def _piece(self, until_ns: int) -> Measured:
        # Events before the first tick come with the first piece.
        since_ns = 0 if self._emitted_ns == self._first_ns else self._emitted_ns
        piece = self.measured.between(since_ns, until_ns)
        self._emitted_ns = until_ns
        return piece

    def _stand_at(self, now_s: float) -> None:
        self._from_s, self._since = now_s, self._clock()


def load_replay(path: Path) -> tuple[Replay, Recording]:
    """Raises UsageError for a file that cannot be read, or that holds nothing to replay."""
    recording = read_recording(path, raw_frames=False)
    try:
        return Replay(recording), recording
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def _steps(measured: Measured, last_ns: int) -> list[tuple[str, int, int]]:
    """Name, begin and end of every recorded procedure; each ends where the next begins."""
    segments = sorted(measured.segments, key=lambda segment: segment.start_ns)
    begun = [(name, next(iter(group)).start_ns) for name, group in groupby(segments, lambda one: one.procedure)]
    ends = [start_ns for _, start_ns in begun[1:]] + [last_ns]
    return [(name, start_ns, end_ns) for (name, start_ns), end_ns in zip(begun, ends, strict=True)]


def _changes(recording: Recording) -> list[LiveEstimate]:
    """The live estimates, without those that repeat the one before."""
    changes: list[LiveEstimate] = []
    for state in recording.live:
        if state.estimates and (not changes or changes[-1].estimates != state.estimates):
            changes.append(LiveEstimate(state.stamp_ns, state.estimates, None, state.samples))
    return changes


READING = "reading the recording"


class Refit:
    """The result of a recording, from a fit in a process of its own: it takes seconds, and must not hold up the screen.

    The constructor starts it. Network and report are written beside the recording, as by ``norton-bench fit``.
    """

    def __init__(self, recording: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, emulated = context.Pipe(duplex=False)
        self._process = context.Process(target=_refit, args=(recording, emulated), name="refit", daemon=True)
        self._process.start()
        emulated.close()
        self._summary: Ended | None = None
        self._doing = READING

    def summary(self) -> Ended | None:
        """The result, None before it is known. Returns at once."""
        while self._summary is None and self._pipe.poll():
            try:
                came: str | Ended = self._pipe.recv()
            except EOFError:
                came = Ended(ExitCode.EXPERIMENT_FAILED, "the fit ended unexpectedly; run norton-bench fit")
            if isinstance(came, Ended):
                self._summary = came
            else:
                self._doing = came
        return self._summary

    @property
    def doing(self) -> str:
        """The stage of the fit, as of the last call of :meth:`summary`."""
        return self._doing

    def close(self) -> None:
        """Abandon the fit if it still runs."""
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _refit(recording: Path, pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the watcher handles Ctrl-C
    from norton_bench.session.conclusion import ended, ended_by  # noqa: PLC0415  (its imports take seconds)

    try:
        from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

        pipe.send(ended(conclude_recording(recording, on_stage=pipe.send)))
    except BaseException as error:  # sent to the watcher
        pipe.send(ended_by(error, [recording]))
