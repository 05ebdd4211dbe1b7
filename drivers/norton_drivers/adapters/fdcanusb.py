"""mjbots' adapters for CAN FD (fdcanusb, mjcanfd-usb-1x) on their serial port, or a moteus' own UART, as a bus."""

import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress

import can
import serial

from norton_drivers.adapters.mended_buses import frame_of, message_of
from norton_drivers.adapters.serial_line import open_line
from norton_drivers.codecs import fdcanusb as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.fdcanusb import FdcanusbFrame

# moteus, docs/integration/uart.md; an adapter on USB has no rate.
_BAUD = 921_600
_ANSWER_S = 0.5
_LOOK_S = 0.5e-3
# Some firmware does not know the question for its status; it is left alone after so many without an answer.
_UNANSWERED_MAX = 3


class FdcanusbBus(can.BusABC):
    """``uart``: a moteus itself is at the other end, which has no bit rates to be set, and whose lines have checksums.

    Raises CanInitializationError where nobody answers as such an adapter does, or where it refuses the bit rates.
    """

    def __init__(
        self, channel: str, bitrate: int, data_bitrate: int, *, baudrate: int = _BAUD, uart: bool = False
    ) -> None:
        self.channel_info = f"fdcanusb {channel}"
        self._uart = uart
        self._lines = protocol.line_stream()
        self._frames: deque[FdcanusbFrame] = deque()
        self._answers: deque[bytes] = deque(maxlen=16)
        self._malformed = self._refused = self._unanswered = 0
        self._status: dict[str, int] = {}
        self._seen: dict[str, int] = {}
        self._line = open_line(channel, baudrate)
        try:
            if not uart:
                self._set_up(bitrate, data_bitrate)
        except BaseException:
            self._line.close()
            raise
        super().__init__(channel)

    def _set_up(self, bitrate: int, data_bitrate: int) -> None:
        """Its bit rates, which it forgets when it is switched off; they can be set while it is off the bus."""
        self._asked(protocol.BUS_OFF)  # an error where it is off already
        for name, value in (
            (protocol.BITRATE, bitrate),
            (protocol.DATA_BITRATE, data_bitrate),
            (protocol.SEND_AGAIN, 1),  # what lost its turn on the bus is sent all the same
        ):
            self._expect(protocol.setting(name, value))
        self._expect(protocol.BUS_ON)
        self._refused = 0

    def _expect(self, command: bytes) -> None:
        answer = self._asked(command)
        if answer != protocol.OK:
            reason = answer.decode("ascii", "replace")
            raise can.CanInitializationError(f"the adapter refuses '{command.decode()}': {reason}")

    def _asked(self, command: bytes) -> bytes:
        self._fill()
        self._answers.clear()
        self._write(command)
        deadline_s = time.monotonic() + _ANSWER_S
        while not self._answers:
            if time.monotonic() > deadline_s:
                raise can.CanInitializationError(f"no answer to '{command.decode()}': it is no fdcanusb")
            time.sleep(_LOOK_S)
            self._fill()
        return self._answers.popleft()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """One frame. Raises CanOperationError, at the latest after a fifth of a second."""
        try:
            command = frame_of(msg, FdcanusbFrame).encode_command()
        except CodecError as error:
            raise can.CanOperationError(f"cannot send: {error}") from error
        self._write(command)

    def _write(self, command: bytes) -> None:
        try:
            self._line.write((protocol.with_checksum(command) if self._uart else command) + b"\n")
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"cannot send: {error}") from error

    def shutdown(self) -> None:
        """Close the port, also where the adapter has gone."""
        super().shutdown()
        with suppress(OSError):
            self._line.close()

    # ---- How it is -----------------------------------------------------------------------------------------------

    def ask(self) -> None:
        """Ask for its status; the answer comes among the frames. Raises CanOperationError."""
        if not self._uart and self._unanswered < _UNANSWERED_MAX:
            self._unanswered += 1
            self._write(protocol.ASK_STATUS)

    def troubles(self) -> Mapping[str, int]:
        """How often its status told of each error, how many lines were malformed, how many commands refused."""
        # An adapter that does not know the question refuses it, and that is no trouble.
        refused = max(0, self._refused - self._unanswered)
        return {"malformed lines": self._malformed, "commands refused by the adapter": refused, **self._seen}

    @property
    def off_bus(self) -> str | None:
        return "its status says bus-off" if self._status.get("busoff") else None

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while not self._frames:
            self._fill()
            if self._frames or (deadline_s is not None and time.monotonic() >= deadline_s):
                break
            time.sleep(_LOOK_S)
        return (message_of(self._frames.popleft()) if self._frames else None), False

    def _fill(self) -> None:
        try:
            waiting = self._line.in_waiting
            data = self._line.read(waiting) if waiting else b""
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"cannot receive: {error}") from error
        overlong = self._lines.overlong
        for line in self._lines.feed(data):
            try:
                self._take(protocol.checked(line.text))
            except CodecError:
                self._malformed += 1
        self._malformed += self._lines.overlong - overlong

    def _take(self, line: bytes) -> None:
        if line.startswith(b"rcv"):
            self._frames.append(FdcanusbFrame.decode_event(line))
        elif line == protocol.OK:
            self._answers.append(line)
        elif line.startswith(protocol.ERROR):
            self._refused += 1
            self._answers.append(line)
        elif (status := protocol.status_in(line)) is not None:
            self._unanswered, self._status = 0, status
            for words in protocol.status_words(status):
                self._seen[words] = self._seen.get(words, 0) + 1
        else:
            raise CodecError(f"unknown line: {line!r}")
