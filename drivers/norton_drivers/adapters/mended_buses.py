"""Buses of python-can's that are mended here where its own will not do in a real-time loop."""

import select
import socket
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, TypeVar

import can
import serial
from can.interfaces.slcan import slcanBus

from norton_drivers.codecs.can_frames import LineFrame
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.slcan import ASK_FLAGS, FLAG_BUS_OFF, FLAG_WORDS, SlcanFrame, SlcanStream
from norton_drivers.codecs.socketcand import HELLO, OK, RAW_MODE, BracketStream, SocketcandFrame, decode_event, open_bus
from norton_drivers.errors import reason_of

_LOOK_S = 0.1

Framed = TypeVar("Framed", bound=LineFrame)


class ThreadedBus(can.BusABC):
    """A bus whose reader insists on waiting, read by a thread so that the loop never does.

    Owns ``slow``, whose ``recv`` blocks however short its timeout; here ``recv(0)`` returns at once.

    What arrives is stamped with the time at which the thread had it. A failure of the thread is raised by the next
    ``recv``.
    """

    def __init__(self, slow: can.BusABC) -> None:
        self.channel_info = slow.channel_info
        self._slow = slow
        self._arrived: deque[can.Message] = deque()
        self._signal = threading.Event()
        self._stop = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._read, name=f"reader of {slow.channel_info}", daemon=True)
        super().__init__(slow.channel_info)
        self._thread.start()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._slow.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._arrived and timeout != 0:
            self._signal.wait(timeout)
        self._signal.clear()
        if self._arrived:
            return self._arrived.popleft(), False
        if self._failure is not None:
            raise can.CanOperationError(f"cannot receive: {self._failure}") from self._failure
        return None, False

    def _read(self) -> None:
        while not self._stop.is_set():
            try:
                message = self._slow.recv(_LOOK_S)
            except Exception as error:  # the adapter's library may raise anything; whoever asks next is told
                self._failure = error
                self._signal.set()
                return
            if message is not None:
                message.timestamp = time.time()
                self._arrived.append(message)
                self._signal.set()

    def shutdown(self) -> None:
        super().shutdown()
        self._stop.set()
        self._thread.join()
        self._slow.shutdown()


# Many adapters do not know the question for their status; those are left alone after so many without an answer.
_UNANSWERED_MAX = 3
# An adapter that takes no more bytes must not hold up the loop.
_WRITE_TIMEOUT_S = 0.2


class SteadySlcanBus(slcanBus):
    """slcan (a serial line of ASCII frames): python-can's own, fit for a fast loop and alive after a malformed line.

    Read in whole chunks, never raising for a line that it cannot parse, and asking the adapter how it is.

    python-can reads byte by byte, with two system calls each. ``data_bitrate`` is that of CAN FD frames, if any.
    """

    def __init__(self, channel: str, *, data_bitrate: int | None = None, **options: Any) -> None:
        self._stream = SlcanStream()
        self._data_bitrate = data_bitrate
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

    def set_bitrate(self, bitrate: int, data_bitrate: int | None = None) -> None:
        """As python-can does, which asks for no data bit rate when it opens the port."""
        super().set_bitrate(bitrate, data_bitrate or self._data_bitrate)

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
        """One frame. Raises CanOperationError, at the latest after a fifth of a second."""
        try:
            line = frame_of(msg, SlcanFrame).encode()
        except CodecError as error:
            raise can.CanOperationError(f"cannot send: {error}") from error
        self._write_line(line)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._stream.frames:
            self._fill(timeout)
        if not self._stream.frames:
            return None, False
        return message_of(self._stream.frames.popleft()), False

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


def frame_of(message: can.Message, kind: type[Framed]) -> Framed:
    """For a line."""
    data = b"" if message.is_remote_frame else bytes(message.data)
    extended, remote, fd = message.is_extended_id, message.is_remote_frame, message.is_fd
    return kind(message.arbitration_id, data, message.dlc, extended, remote, fd, fd and message.bitrate_switch)


def message_of(frame: LineFrame) -> can.Message:
    """What came in a line, with the time at which it was read."""
    return can.Message(
        timestamp=time.time(),
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_fd=frame.fd,
        bitrate_switch=frame.switched,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )


_ANSWER_TIMEOUT_S = 3.0
_CHUNK = 65536


class SteadySocketcandBus(can.BusABC):
    """A client of socketcand, which serves another computer's CAN bus over TCP.

    python-can's own dies of a malformed message, does not notice that the server has gone, lets Nagle's algorithm
    hold frames back, and turns remote frames into data frames.

    ``channel`` is a bus of the server at ``host`` and ``port``. Raises CanInitializationError.
    """

    def __init__(self, channel: str, *, host: str, port: int, bitrate: int = 0, **options: Any) -> None:
        self.channel_info = f"socketcand {channel} at {host}:{port}"
        self._stream = BracketStream()
        self._frames: deque[SocketcandFrame] = deque()
        self._malformed = 0
        self._refused = 0
        self._socket = self._connect(host, port)
        try:
            self._shake_hands(channel)
        except BaseException:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        super().__init__(channel, **options)

    def _connect(self, host: str, port: int) -> socket.socket:
        try:
            connected = socket.create_connection((host, port), timeout=_ANSWER_TIMEOUT_S)
        except OSError as error:
            raise can.CanInitializationError(f"nobody serves at {host}:{port}: {reason_of(error)}") from error
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connected

    def _shake_hands(self, channel: str) -> None:
        self._expect(HELLO, f"{self.channel_info} is no socketcand")
        for request, otherwise in (
            (open_bus(channel), f"the server has no bus {channel}, or does not share it"),
            (RAW_MODE, "the server knows no raw mode"),
        ):
            self._socket.sendall(request)
            self._expect(OK, otherwise)

    def _expect(self, answer: str, otherwise: str) -> None:
        deadline_s = time.monotonic() + _ANSWER_TIMEOUT_S
        while not self._stream.texts:
            self._socket.settimeout(max(deadline_s - time.monotonic(), 0.001))
            try:
                data = self._socket.recv(_CHUNK)
            except OSError as error:
                raise can.CanInitializationError(f"{otherwise} (no answer: {error})") from error
            if not data:
                raise can.CanInitializationError(f"{otherwise} (it hung up)")
            self._stream.feed(data)
        message = self._stream.texts.popleft()
        if message != answer:
            raise can.CanInitializationError(f"{otherwise} (it said <{message}>)")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """One classic frame. Raises CanOperationError, also where the connection is clogged: nothing waits here."""
        data = b"" if msg.is_remote_frame else bytes(msg.data)
        frame = SocketcandFrame(msg.arbitration_id, data, msg.is_extended_id, msg.is_remote_frame, length=msg.dlc)
        request = frame.encode_request()
        try:
            sent = self._socket.send(request)
        except OSError as error:
            raise can.CanOperationError(f"cannot send: {error}") from error
        if sent < len(request):
            raise can.CanOperationError("cannot send: the connection is clogged")

    def fileno(self) -> int:
        return self._socket.fileno()

    def shutdown(self) -> None:
        super().shutdown()
        self._socket.close()

    # ---- How it is -----------------------------------------------------------------------------------------------

    def ask(self) -> None:
        """The server cannot be asked."""

    def troubles(self) -> Mapping[str, int]:
        return {
            "malformed messages": self._stream.malformed + self._malformed,
            "requests that the server does not know (an old one sends no remote frames)": self._refused,
        }

    @property
    def off_bus(self) -> str | None:
        return None

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._frames:
            self._fill(timeout)
        return (_steady_socketcand_message(self._frames.popleft()) if self._frames else None), False

    def _fill(self, timeout: float | None) -> None:
        try:
            if timeout != 0:
                select.select([self._socket], [], [], timeout)
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            raise can.CanOperationError(f"cannot receive: {error}") from error
        if not data:
            raise can.CanOperationError("the server hung up")
        self._stream.feed(data)
        while self._stream.texts:
            self._take(self._stream.texts.popleft())

    def _take(self, text: str) -> None:
        if text == "error unknown command":
            self._refused += 1
            return
        try:
            self._frames.append(decode_event(text))
        except CodecError:
            self._malformed += 1


def _steady_socketcand_message(frame: SocketcandFrame) -> can.Message:
    return can.Message(
        timestamp=time.time(),  # the server's stamps are of another computer's clock
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_error_frame=frame.error,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )
