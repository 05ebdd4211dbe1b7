"""A client of socketcand, which serves another computer's CAN bus over TCP.

python-can's own dies of a malformed message, does not notice that the server has gone, lets Nagle's algorithm hold
frames back, and turns remote frames into data frames.
"""

import select
import socket
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import can

from norton_drivers.codecs.errors import CodecError
from norton_drivers.codecs.socketcand import HELLO, OK, RAW_MODE, BracketStream, SocketcandFrame, decode_event, open_bus
from norton_drivers.errors import reason_of

_ANSWER_TIMEOUT_S = 3.0
_CHUNK = 65536


class SteadySocketcandBus(can.BusABC):
    """``channel`` is a bus of the server at ``host`` and ``port``. Raises CanInitializationError."""

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
        said = self._stream.texts.popleft()
        if said != answer:
            raise can.CanInitializationError(f"{otherwise} (it said <{said}>)")

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
        return (_message(self._frames.popleft()) if self._frames else None), False

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


def _message(frame: SocketcandFrame) -> can.Message:
    return can.Message(
        timestamp=time.time(),  # the server's stamps are of another computer's clock
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_error_frame=frame.error,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )
