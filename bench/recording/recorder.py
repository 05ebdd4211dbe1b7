"""Hands measurements to a process of its own, so that neither a slow disk nor a crash here costs the other anything."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from queue import Full, Queue
from threading import Thread
from types import TracebackType
from typing import Self

from bench.errors import ExperimentError, UsageError
from bench.recording import wire
from bench.recording.contents import EstimatesLike, RecordedEstimates
from bench.recording.process import Answer, WriterProcess
from bench.records import Measured

QUEUE_PARTS = 256  # of about 100 ms each: a disk may stand still for 25 s before anything is lost
START_TIMEOUT_S = 30.0
STOP_TIMEOUT_S = 60.0


@dataclass(frozen=True)
class RecordingSummary:
    """How a recording ended."""

    path: Path
    messages: int
    size_bytes: int
    dropped_parts: int


class Recorder:
    """Records to a new file at ``path`` (MCAP; docs/recording-format.md) until :meth:`close`.

    Parameters: the rig file's text; ``metadata`` that explains the data (seed, command unit, tick, ...);
    ``patience_s``, how long :meth:`put` may wait for room before it drops a part. A real-time caller keeps it short;
    where time stands still meanwhile, it may be long.

    Raises UsageError where the file is there already or cannot be made, ExperimentError where recording cannot start.
    """

    def __init__(self, path: Path, *, rig_text: str, metadata: Mapping[str, str], patience_s: float = 0.02) -> None:
        self.path = path
        self.dropped_parts = 0
        self._patience_s = patience_s
        self._end: Answer | None = None
        self._queue: Queue[Measured | RecordedEstimates | wire.Stop] = Queue(QUEUE_PARTS)
        _create(path)
        self._process = WriterProcess()
        self._start(wire.Start(str(path.resolve()), rig_text, dict(metadata)))
        self._feeder = Thread(target=self._feed, name="recorder", daemon=True)
        self._feeder.start()

    @property
    def writer_pid(self) -> int:
        """The recording process."""
        return self._process.pid

    def put(self, part: Measured) -> None:
        """Record a part (of about 100 ms: a part is what a crash can cost).

        Never waits longer than ``patience_s``; what finds no room is dropped and counted. Raises ExperimentError where
        recording has broken down, so that the experiment can be stopped in good order.
        """
        self._check()
        if not self._offer(part, self._patience_s):
            self.dropped_parts += 1

    def put_estimate(self, live: EstimatesLike) -> None:
        """Record the state of the live identification; waits as :meth:`put` does, and raises as it does."""
        self._check()
        self._offer(wire.estimates_of(live), self._patience_s)

    def close(self) -> RecordingSummary:
        """Write what is still waiting, finish the file, and say how it went; may be called twice.

        Raises ExperimentError where the recording broke down on the way.
        """
        if self._end is None:
            self._end = self._stop()
        if "messages" not in self._end:
            raise self._broken(self._end)
        return RecordingSummary(self.path, self._end["messages"], self._end["bytes"], self.dropped_parts)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except ExperimentError as broken:
            if error is None:
                raise
            error.add_note(str(broken))

    def _start(self, start: wire.Start) -> None:
        """Wait until the file has begun, so that a full disk is found out before anything moves."""
        answer = self._process.start(start, START_TIMEOUT_S)
        if "error" in answer:
            self._process.close_input()
            self._process.finish(0.0)
            self.path.unlink(missing_ok=True)
            raise ExperimentError(f"cannot record to {self.path}: {answer['error']}")

    def _feed(self) -> None:
        """In a thread: pass on what waits, until Stop. After a failure, whatever still comes is let go."""
        failed = False
        while True:
            item = self._queue.get()
            try:
                if not failed:
                    self._process.send(wire.part_of(item) if isinstance(item, Measured) else item)
            except OSError:
                failed = True
            if isinstance(item, wire.Stop):
                break
        self._process.close_input()

    def _stop(self) -> Answer:
        """Queue the end behind what waits, and wait until all of it is written, or it is clear that it never will."""
        if not self._offer(wire.Stop(self.dropped_parts), STOP_TIMEOUT_S):
            self._process.kill()  # it takes nothing any more; now the queue can run empty
            self._queue.put(wire.Stop(self.dropped_parts))
        answer = self._process.finish(STOP_TIMEOUT_S)
        self._feeder.join()
        return answer

    def _offer(self, item: Measured | RecordedEstimates | wire.Stop, patience_s: float) -> bool:
        try:
            self._queue.put(item, block=patience_s > 0.0, timeout=patience_s or None)
        except Full:
            return False
        return True

    def _check(self) -> None:
        if self._end is not None:
            raise ExperimentError(f"the recording {self.path} is closed already")
        if not self._process.running:
            raise self._broken(self._process.finish(0.0))

    def _broken(self, answer: Answer) -> ExperimentError:
        return ExperimentError(
            f"recording to {self.path} broke down: {answer.get('error', 'it ended too early')}; "
            f"rescue what was written with: norton-bench recover {self.path}"
        )


def _create(path: Path) -> None:
    """Make the empty file, and its folder. Raises UsageError."""
    if path.exists():
        raise UsageError(f"{path} is there already; record to another name, or move it away")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("xb").close()
    except OSError as error:
        raise UsageError(f"cannot record to {path}: {error.strerror}; choose another place") from error
