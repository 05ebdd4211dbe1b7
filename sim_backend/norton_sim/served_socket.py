"""A serial line served over TCP, which other processes open as ``socket://host:port``.

What is written to a pseudo-terminal is handed on by a thread of the system's, of ordinary priority, which other
programs may keep waiting for a tenth of a second. Over TCP it is there at once.
"""

import socket
from contextlib import suppress
from urllib.parse import urlsplit

from norton_drivers.errors import ConnectionFailedError, reason_of

SCHEME = "socket://"
_READ_MAX = 65536


class ServedSocket:
    """As :class:`norton_sim.pseudo_terminals.ServedPort`: one program at a time may have it open.

    Raises ConnectionFailedError where the address cannot be had.
    """

    def __init__(self, url: str) -> None:
        address = urlsplit(url)
        try:
            self._listener = socket.create_server((address.hostname or "localhost", address.port or 0))
        except (OSError, ValueError) as error:
            raise ConnectionFailedError(
                f"port {url}: cannot serve it ({reason_of(error)}); name another, or stop who has it"
            ) from error
        self._listener.setblocking(False)
        self._line: socket.socket | None = None
        self.hung_up = False

    def fileno(self) -> int:
        """To wait on: for bytes, or for somebody to open the line."""
        return (self._line or self._listener).fileno()

    @property
    def baud(self) -> int | None:
        """Nobody tells."""
        return None

    def write(self, data: bytes) -> None:
        """Send bytes; what nobody reads is lost."""
        if self._line is not None:
            try:
                self._line.send(data)
            except BlockingIOError:
                pass
            except OSError:
                self._let_go()

    def read(self) -> bytes:
        """What was written to the line since the last call."""
        if self.hung_up:
            return b""
        if self._line is None:
            self._take_up()
        try:
            data = b"" if self._line is None else self._line.recv(_READ_MAX)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._let_go()
        return data

    def hang_up(self) -> None:
        """The adapter is pulled out: whoever has the line open is told so by his next use of it."""
        if not self.hung_up:
            self.close()
            self.hung_up = True

    def close(self) -> None:
        """Nobody can open it any more."""
        self._let_go()
        self._listener.close()

    def _take_up(self) -> None:
        with suppress(BlockingIOError):
            self._line, _ = self._listener.accept()
            self._line.setblocking(False)
            self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _let_go(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None
