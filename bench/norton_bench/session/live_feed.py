"""The live identifier takes the loop's parts: in the same process in lock step, in its own process in real time."""

import multiprocessing
import queue
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.queues import Queue
from typing import Protocol

from norton_bench.events import Note, Watcher
from norton_bench.identification.results import LiveEstimate
from norton_bench.on_demand import deferred
from norton_bench.recording.contents import Recording, parts_of
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig

# A minute of parts, for a fit of the whole recording takes seconds. A worker that is further behind loses parts, which
# is reported; it never delays the loop.
GREATEST_BACKLOG = 600
READY_WITHIN_S = 60.0

identifier_of = deferred("norton_bench.identification.live:LiveIdentifier")


class LiveFeed(Protocol):
    """Takes measured parts; has the newest estimate."""

    latest: LiveEstimate
    dropped: int

    def __call__(self, part: Measured) -> None: ...
    def close(self) -> None: ...


@contextmanager
def feeding(rig: Rig, emit: Watcher, *, lock_step: bool) -> Iterator[LiveFeed]:
    """The feed for this rig, until the end: none without a model, in this process in lock step, else in another one."""
    feed: LiveFeed = NoFeed()
    if rig.modelled:
        feed = (InlineFeed if lock_step else ProcessFeed)(rig.command.unit, rig.tick_s)
    try:
        yield feed
    finally:
        feed.close()
        if feed.dropped:
            emit(Note(f"{feed.dropped} parts were not used live; the final fit has them all"))


class NoFeed:
    """For an actuator without a model: estimates nothing."""

    def __init__(self) -> None:
        self.latest = LiveEstimate(0)
        self.dropped = 0

    def __call__(self, part: Measured) -> None:
        """Ignore it."""

    def close(self) -> None:
        """Nothing to release."""


class InlineFeed:
    """For lock-step runs: the same parts give the same estimates at the same ticks, every time."""

    def __init__(self, command_unit: str, tick_s: float) -> None:
        self.latest = LiveEstimate(0)
        self.dropped = 0
        self._identifier = identifier_of(command_unit, tick_s)

    def __call__(self, part: Measured) -> None:
        self.latest = self._identifier.update(part)

    def close(self) -> None:
        """Nothing to release."""


class ProcessFeed:
    """For wall time: the identifier runs on another core and can never delay a tick."""

    def __init__(self, command_unit: str, tick_s: float) -> None:
        context = multiprocessing.get_context("spawn")
        self.latest = LiveEstimate(0)
        self.dropped = 0
        self._parts: Queue[Measured | None] = context.Queue(GREATEST_BACKLOG)
        self._estimates: Queue[LiveEstimate] = context.Queue()
        self._worker = context.Process(
            target=_identify, args=(command_unit, tick_s, self._parts, self._estimates), daemon=True
        )
        self._worker.start()
        # Its imports would take processor time from the loop.
        with suppress(queue.Empty):
            self.latest = self._estimates.get(timeout=READY_WITHIN_S)

    def __call__(self, part: Measured) -> None:
        try:
            self._parts.put_nowait(replace(part, frames=(), events=()))
        except queue.Full:
            self.dropped += 1
        with suppress(queue.Empty):
            while True:
                self.latest = self._estimates.get_nowait()

    def close(self) -> None:
        """End the worker, also where parts are waiting."""
        self._parts.cancel_join_thread()
        self._worker.terminate()
        self._worker.join()
        for channel in (self._parts, self._estimates):
            channel.close()


def replayed(recording: Recording) -> Iterator[LiveEstimate]:
    """The estimates of the live identifier for a recording, part by part: those that it gave in the session."""
    metadata = recording.metadata
    identifier = identifier_of(metadata["command_unit"], float(metadata["tick_s"]))
    return map(identifier.update, parts_of(recording))


def _identify(
    command_unit: str, tick_s: float, parts: "Queue[Measured | None]", estimates: "Queue[LiveEstimate]"
) -> None:
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C on a terminal reaches every process; the session ends this one
    identifier = identifier_of(command_unit, tick_s)
    estimates.put(LiveEstimate(0))
    while (part := parts.get()) is not None:
        estimates.put(identifier.update(part))
