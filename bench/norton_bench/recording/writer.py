"""The recording process: takes parts from its standard input and brings them to disk, whatever happens to the sender.

Run as ``python -m norton_bench.recording.writer``. It answers on standard output, one JSON object a line:
``{"ready": true, "bytes_s": ...}`` once the file has begun, with how fast the disk takes it; ``{"stop": ...}`` where
the experiment had better end, while it goes on recording; then ``{"messages": ..., "bytes": ...}`` at the end, or
``{"error": ...}`` when it gives up.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

from norton_bench.recording import candump, wire
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.place import Place
from norton_bench.recording.recording_file import RecordingFile
from norton_bench.recording.reserve import Reserve
from norton_bench.recording.syncing import Syncing

# Of Linux' real-time priorities: below the loop and its helpers (drivers/norton_drivers/punctual.py).
PRIORITY = 5


def record(pipe: BinaryIO) -> dict[str, object]:
    """Record what comes through ``pipe`` until its end. Raises OSError where the files cannot be written."""
    start = wire.receive(pipe)
    if not isinstance(start, wire.Start):
        return {"error": "nothing to record"}
    if start.wall_time:
        _go_first()
    path = Path(start.path)
    with ExitStack() as stack:
        reserve = Reserve(path.parent, start.reserve_bytes)
        spool = stack.enter_context(TemporaryFile(dir=path.parent, buffering=0))
        file = stack.enter_context(FileIO(path, "r+b"))
        log = stack.enter_context(FileIO(start.candump, "r+b")) if start.candump else None
        recording = RecordingFile(file, start.rig_text, start.metadata, make_room=reserve.release, spool=spool)
        say({"ready": True, "bytes_s": reserve.bytes_s})
        place = Place(path, file)
        with Syncing([file] if log is None else [file, log]) as syncing:
            ended = _Desk(recording, log, reserve, syncing, place).work(pipe)
        recording.finish(ended)
        place.restore()
        return {"messages": recording.messages, "bytes": recording.size}


def _go_first() -> None:
    """On a busy machine, parts would wait a tenth of a second for a core; they take one per cent of it."""
    with suppress(OSError, AttributeError):  # AttributeError: no such thing on this system
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


@dataclass
class _Desk:
    """Where parts come in, and what may go wrong with the place that they go to."""

    recording: RecordingFile
    log: FileIO | None
    reserve: Reserve
    syncing: Syncing
    place: Place
    told: bool = False

    def work(self, pipe: BinaryIO) -> dict[str, str]:
        """Take parts until the end; returns how it ended."""
        while (message := wire.receive(pipe)) is not None:
            if isinstance(message, wire.Part):
                self._take(message)
            elif isinstance(message, RecordedEstimates):
                self.recording.add_estimates(message)
            trouble = self._trouble()
            if isinstance(message, wire.Stop):
                return {"ended": trouble or "in good order", "dropped_parts": str(message.dropped_parts)}
            if trouble and not self.told:
                say({"stop": trouble})
                self.told = True
        return {"ended": "the experiment's process went away", "dropped_parts": "unknown"}

    def _take(self, part: wire.Part) -> None:
        self.recording.add(part)
        if self.log is not None and (lines := candump.log_lines(part.frames)):
            self._write_log(self.log, lines)

    def _write_log(self, log: FileIO, lines: bytes) -> None:
        view = memoryview(lines)
        while view:
            try:
                view = view[log.write(view) :]
            except OSError:
                if not self.reserve.release():
                    raise

    def _trouble(self) -> str | None:
        """Why the experiment had better end; what is in the file by then is safe."""
        if self.reserve.used:
            return "the disk is full; what was measured until then is whole; make room and run again"
        return self.syncing.trouble or self.place.trouble()


def say(answer: Mapping[str, object]) -> None:
    """Tell the experiment's process, which may be gone."""
    try:
        print(json.dumps(answer), flush=True)
    except BrokenPipeError:
        sys.stdout = None  # nothing left to flush at exit


def main() -> int:
    try:
        answer = record(sys.stdin.buffer)
    except OSError as error:
        answer = {"error": error.strerror or str(error)}
    say(answer)
    return 1 if "error" in answer else 0


if __name__ == "__main__":
    sys.exit(main())
