"""Several loops run together, tick by tick in one thread: one for each joint of an arm, or a single one."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from norton_bench.errors import BenchError
from norton_bench.loop.segment_run import SegmentRun
from norton_bench.records import Measured, join
from norton_bench.segments import Segment
from norton_drivers.errors import DeviceError

if TYPE_CHECKING:
    from norton_bench.loop.loop import Loop


@dataclass
class RunningSegment:
    """A segment while it runs on one loop, with what was measured in it so far."""

    loop: "Loop"
    run: SegmentRun
    start_ns: int
    parts: list[Measured] = field(default_factory=list)

    @property
    def over(self) -> bool:
        return self.run.index >= self.run.ticks or self.run.fast

    def tick(self) -> None:
        if self.loop.tick(self.run):
            self.hand_on()

    def hand_on(self) -> None:
        self.parts.append(self.loop.outbox.hand_on(self.loop.info(self)).without_frames())

    def end(self) -> None:
        try:
            self.hand_on()
        finally:
            self.loop.end(self)


@contextmanager
def running_together(loops: "Sequence[Loop]") -> Iterator[None]:
    """The drives of all loops enabled inside, idle outside, whatever happens in between; they have one clock.

    Raises as :meth:`Loop.running`.
    """
    for loop in loops:
        loop.guard.permit()
    with loops[0].on_time():
        for loop in loops:
            loop.listen()
        enabled: list[Loop] = []
        why: BaseException | None = None
        try:
            for loop in loops:
                loop.devices.enable(meanwhile=partial(_feed, tuple(enabled)))
                enabled.append(loop)
            now_ns = loops[0].devices.clock.now_ns()
            for loop in loops:
                loop.start(now_ns)
            yield
        except BaseException as error:
            why = error
            if isinstance(error, BenchError | DeviceError):
                for loop in enabled:
                    loop.outbox.put_event(loop.devices.clock.now_ns(), "stop", str(error))
            raise
        finally:
            _idle(enabled, why)


def _feed(loops: "Sequence[Loop]") -> None:
    """Keep the drives of these loops at zero torque, and their watchdogs from acting, while others are enabled."""
    for loop in loops:
        loop.devices.link.poll()
        loop.devices.zero()


def _idle(loops: "Sequence[Loop]", why: BaseException | None) -> None:
    """All drives get zero before the first is told to idle, and all are told before one is waited for.

    Every step is taken on every loop, whatever fails. ``why`` is the error that ended the run, which is being raised;
    what fails here is added to it. Raises the first failure where there is none.
    """
    failures = _failures(
        [
            *(loop.devices.zero for loop in loops),
            *(loop.tell_idle for loop in loops),
            *(loop.await_idle for loop in loops),
            *(loop.outbox.hand_on for loop in loops),
        ]
    )
    if why is None and failures:
        raise failures[0]
    for failure in failures:
        assert why is not None
        why.add_note(str(failure))


def _failures(steps: Iterable[Callable[[], object]]) -> list[BaseException]:
    """Take every step; returns what was raised."""
    failures: list[BaseException] = []
    for step in steps:
        try:
            step()
        except BaseException as failure:  # also Ctrl-C: the drives of the other loops are still to be stopped
            failures.append(failure)
    return failures


def run_together(loops: "Sequence[Loop]", segments: Sequence[Segment]) -> tuple[Measured, ...]:
    """Run a segment on each of the loops at once, tick by tick, until the first of them ends; what each measured.

    They have the same ticks: one that a loop missed is skipped on all. Raises as :meth:`Loop.run`.
    """
    running = [loop.begin(segment) for loop, segment in zip(loops, segments, strict=True)]
    try:
        while not any(each.over for each in running):
            for each in running:
                each.tick()
            if len(running) > 1:
                _in_step(running)
    except BaseException as error:
        if len(loops) > 1:  # to hand on what was measured takes time
            for loop in loops:
                loop.devices.zero()
        for failure in _failures(each.end for each in running):
            error.add_note(str(failure))
        raise
    failures = _failures(each.end for each in running)
    if failures:
        raise failures[0]
    return tuple(join(each.parts) for each in running)


def _in_step(running: Sequence[RunningSegment]) -> None:
    """Skip on all loops what one of them has missed. Raises SafetyStopError."""
    latest_ns = max(each.loop.next_tick_ns for each in running)
    for each in running:
        if not each.over:
            each.loop.skip_to(each.run, latest_ns)
