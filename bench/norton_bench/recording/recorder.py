"""Hands measurements to a process of its own, so that neither a slow disk nor a crash here costs the other anything."""

import json
import select
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Full, Queue
from threading import Thread
from types import TracebackType
from typing import Any, BinaryIO, Self, cast

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.recording import wire
from norton_bench.recording.contents import EstimatesLike, RecordedEstimates
from norton_bench.recording.disk import RESERVE_BYTES, Need, check_room, too_slow
from norton_bench.recording.frames import log_name
from norton_bench.records import Measured

Answer = dict[str, Any]
QUEUE_PARTS = 640  # of 40 to 100 ms each: a disk may stand still for 25 s before anything is lost
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
    ``patience_s``, how long :meth:`put` may wait for room before it drops a part: a real-time caller keeps it short;
    where time stands still meanwhile, it may be long. ``need`` is what there must be room for; ``candump`` asks for a
    log of the CAN frames beside it; ``reserve_bytes`` are kept back on the disk to end in good order by; in
    ``wall_time`` the recording process goes before all that is not real-time, where the machine permits it.

    Raises UsageError where a file is there already or cannot be made, ExperimentError where recording cannot start, or
    would not come to its end.
    """

    def __init__(
        self,
        path: Path,
        *,
        rig_text: str,
        metadata: Mapping[str, str],
        patience_s: float = 0.02,
        need: Need | None = None,
        candump: bool = False,
        reserve_bytes: int = RESERVE_BYTES,
        wall_time: bool = False,
    ) -> None:
        self.path = path
        self.dropped_parts = 0
        self._patience_s = patience_s
        self._end: Answer | None = None
        self._told = False
        self._queue: Queue[Measured | RecordedEstimates | wire.Stop] = Queue(QUEUE_PARTS)
        self._made = _create([path, log_name(path)] if candump else [path], need or Need())
        self._process = WriterProcess()
        log = str(log_name(path).absolute()) if candump else ""
        start = wire.Start(str(path.absolute()), rig_text, dict(metadata), log, reserve_bytes, wall_time)
        self._start(start, need or Need())
        self._feeder = Thread(target=self._feed, name="recorder", daemon=True)
        self._feeder.start()

    @property
    def writer_pid(self) -> int:
        """The recording process."""
        return self._process.pid

    def check(self) -> None:
        """Raises ExperimentError where recording is over or has broken down; to be asked before anything moves."""
        if self._end is not None:
            raise ExperimentError(f"the recording {self.path} is closed already")
        if not self._process.running:
            raise self._broken(self._process.finish(0.0))

    def put(self, part: Measured) -> None:
        """Record a part (of about 100 ms: a part is what a crash can cost).

        Never waits longer than ``patience_s``; what finds no room is dropped and counted. Raises ExperimentError where
        recording has broken down, and once where it had better end, so that the experiment can be stopped in good
        order; what is put then is still recorded.
        """
        self.check()
        if not self._offer(part, self._patience_s):
            self.dropped_parts += 1
        self._heed()

    def put_estimate(self, live: EstimatesLike) -> None:
        """Record the state of the live identification; waits as :meth:`put` does, and raises as it does."""
        self.check()
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

    def _start(self, start: wire.Start, need: Need) -> None:
        """Wait until the file has begun, so that a full or slow disk is found out before anything moves."""
        answer = self._process.start(start, START_TIMEOUT_S)
        error = answer.get("error") or too_slow(answer["bytes_s"], need)
        if error:
            self._process.kill()
            self._process.close_input()
            self._process.finish(STOP_TIMEOUT_S)
            for path in self._made:
                path.unlink(missing_ok=True)
            raise ExperimentError(f"cannot record to {self.path}: {error}")

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

    def _heed(self) -> None:
        """Tell once what the recording process has said."""
        if not self._told and (trouble := self._process.trouble()):
            self._told = True
            raise ExperimentError(f"recording to {self.path} has to end: {trouble}")

    def _broken(self, answer: Answer) -> ExperimentError:
        return ExperimentError(
            f"recording to {self.path} broke down: {answer.get('error', 'it ended too early')}; "
            f"rescue what was written with: norton-bench recover {self.path}"
        )


def _create(paths: Sequence[Path], need: Need) -> Sequence[Path]:
    """Make the empty files, and their folder, where there is room. Raises UsageError, ExperimentError."""
    for path in paths:
        if path.exists():
            raise UsageError(f"{path} is there already; record to another name, or move it away")
    folder, made = paths[0].parent, list[Path]()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_room(folder, need)
        for path in paths:
            path.open("xb").close()
            made.append(path)
    except OSError as error:
        for path in made:
            path.unlink()
        raise UsageError(f"cannot record to {paths[0]}: {error.strerror}; choose another place") from error
    return made


class WriterProcess:
    """The recording process as seen from outside: started, fed, and asked how it went.

    A fresh interpreter that imports only what writing needs; a session of its own spares it Ctrl-C.
    """

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "norton_bench.recording.writer"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,  # what was said must not hide in a buffer from whoever asks whether something was
            start_new_session=True,
        )
        self._input = cast(BinaryIO, self._process.stdin)
        self._output = cast(BinaryIO, self._process.stdout)
        self._last: Answer | None = None
        self._heard: Answer = {"error": "the recording process has died"}

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def start(self, start: wire.Start, timeout_s: float) -> Answer:
        """What it says once the file has begun: ``{"ready": True}``, or ``{"error": ...}``."""
        try:
            self.send(start)
        except OSError:
            return self.finish(0.0)
        if not select.select([self._output], [], [], timeout_s)[0]:
            return {"error": f"the recording process did not start within {timeout_s:g} s"}
        return _parse(self._output.readline())

    def trouble(self) -> str | None:
        """Why it had better not go on for long, if it has said so meanwhile; never waits."""
        if self._last is not None or not select.select([self._output], [], [], 0.0)[0]:
            return None
        if line := self._output.readline():  # nothing: it is at its end, and has said why
            self._heard = _parse(line)
        return self._heard.get("stop")

    def send(self, message: wire.Message) -> None:
        """Raises OSError where it is gone."""
        wire.send(self._input, message)

    def close_input(self) -> None:
        """Nothing more will be sent."""
        with suppress(OSError):
            self._input.close()

    def finish(self, timeout_s: float) -> Answer:
        """What it says at its end, for which it has ``timeout_s``; an error in words where it says nothing."""
        if self._last is None:
            late = self._end(timeout_s)
            lines = self._output.read().splitlines(keepends=True)
            self._output.close()
            heard = _parse(lines[-1]) if lines else self._heard
            self._last = {"error": late} if late else heard
        return self._last

    def kill(self) -> None:
        self._process.kill()

    def _end(self, timeout_s: float) -> str:
        """Returns what is to be said where it had to be killed."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return f"the recording process did not finish within {timeout_s:g} s"
        return ""


def _parse(line: bytes) -> Answer:
    """A half line is all that a killed process may leave."""
    if not line.endswith(b"\n"):
        return {"error": "the recording process has died"}
    return cast(Answer, json.loads(line))
