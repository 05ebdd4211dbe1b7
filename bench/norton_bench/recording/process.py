"""The recording process as seen from outside: started, fed, and asked how it went."""

import json
import select
import subprocess
import sys
from contextlib import suppress
from typing import Any, BinaryIO, cast

from norton_bench.recording import wire

Answer = dict[str, Any]


class WriterProcess:
    """A fresh interpreter that imports only what writing needs; a session of its own spares it Ctrl-C."""

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
