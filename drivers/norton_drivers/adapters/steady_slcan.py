"""slcan (a serial line of ASCII frames): python-can's own, fit for a fast loop and alive after a malformed line."""

import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import can
import serial
from can.interfaces.slcan import slcanBus

from norton_drivers.codecs.slcan import ASK_FLAGS, FLAG_BUS_OFF, FLAG_WORDS, SlcanFrame, SlcanStream

# Many adapters do not know the question for their status; those are left alone after so many without an answer.
_UNANSWERED_MAX = 3
# An adapter that takes no more bytes must not hold up the loop.
_WRITE_TIMEOUT_S = 0.2


class SteadySlcanBus(slcanBus):
    """Read in whole chunks, never raising for a line that it cannot parse, and asking the adapter how it is.

    python-can reads byte by byte, with two system calls each.
    """

    def __init__(self, channel: str, **options: Any) -> None:
        self._stream = SlcanStream()
        self._flags = 0
        self._flagged: dict[str, int] = {}
        self._unanswered = 0
        try:
            super().__init__(channel, **{"sleep_after_open": 0.0, **options})
        except Exception:
            self._is_shutdown = True  # else python-can complains on standard error that it was not shut down
            raise
        self.serialPortOrig.write_timeout = _WRITE_TIMEOUT_S
        if "://" not in channel:
            self._take_alone()

    def shutdown(self) -> None:
        """Close the channel and the port, also where the adapter has gone."""
        can.BusABC.shutdown(self)
        with suppress(can.CanError):
            self.close()
        self.serialPortOrig.close()

    def _take_alone(self) -> None:
        """Two programs on one adapter would each get half of the frames. Raises CanInitializationError."""
        try:
            self.serialPortOrig.exclusive = True
        except serial.SerialException as error:
            self.shutdown()
            raise can.CanInitializationError(str(error)) from error

    @property
    def malformed(self) -> int:
        """Lines that are nothing that slcan knows."""
        return self._stream.malformed

    def ask(self) -> None:
        """Ask for the status flags; the answer comes among the frames. Raises CanOperationError."""
        if self._unanswered < _UNANSWERED_MAX:
            self._unanswered += 1
            self._write_line(ASK_FLAGS)

    def troubles(self) -> Mapping[str, int]:
        """How often each status flag rose, how many lines were malformed, how many commands refused."""
        # Adapters that do not know the question refuse it, and that is no trouble.
        refused = max(0, self._stream.refused - self._unanswered)
        return {
            "malformed lines": self._stream.malformed,
            "commands refused by the adapter": refused,
            **self._flagged,
        }

    @property
    def off_bus(self) -> str | None:
        return "its status flags say bus-off" if self._flags & FLAG_BUS_OFF else None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """One classic frame. Raises CanOperationError, at the latest after a fifth of a second."""
        data = b"" if msg.is_remote_frame else bytes(msg.data)
        frame = SlcanFrame(msg.arbitration_id, data, msg.dlc, msg.is_extended_id, msg.is_remote_frame)
        self._write_line(frame.encode())

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._stream.frames:
            self._fill(timeout)
        if not self._stream.frames:
            return None, False
        return _message(self._stream.frames.popleft()), False

    def _fill(self, timeout: float | None) -> None:
        line = self.serialPortOrig
        try:
            if timeout != 0:
                line.timeout = timeout
                self._stream.feed(line.read(1))
            self._stream.feed(line.read(line.in_waiting))
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"cannot receive: {error}") from error
        while self._stream.flags:
            self._note(self._stream.flags.popleft())

    def _note(self, flags: int) -> None:
        """Count flags as they rise: some adapters clear them when they are read, some when the cause has gone."""
        self._unanswered = 0
        risen, self._flags = flags & ~self._flags, flags
        for bit, words in FLAG_WORDS:
            if risen & bit:
                self._flagged[words] = self._flagged.get(words, 0) + 1

    def _write(self, string: str) -> None:
        self._write_line(string.encode() + self.LINE_TERMINATOR)

    def _write_line(self, line: bytes) -> None:
        # Without python-can's flush: it waits until the last byte has left, which is an adapter's latency each frame.
        try:
            self.serialPortOrig.write(line)
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"cannot send: {error}") from error


def _message(frame: SlcanFrame) -> can.Message:
    return can.Message(
        timestamp=time.time(),
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )
