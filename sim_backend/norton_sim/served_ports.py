"""Serial ports that other processes open as they would open hardware: a pseudo-terminal, or a TCP socket."""

import os
import pty
import socket
import termios
import tty
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from norton_drivers.errors import ConnectionFailedError, reason_of

_PSEUDO_TERMINALS = "/dev/pts/"
_READ_MAX = 65536
_RATES = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name.startswith("B") and name[1:].isdecimal() and int(name[1:]) > 0
}


class ServedPort:
    """A pseudo-terminal behind a link, which other processes open as a serial port.

    A pseudo-terminal whose far end stands at ``path``, a link that lives as long as this is open.

    Raises ConnectionFailedError where something else stands at ``path``, or another server still has it.
    """

    def __init__(self, path: str) -> None:
        self._link = Path(path)
        _make_room(self._link)
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._target = os.ttyname(self._slave)
        self._put_link()
        self.hung_up = False

    def fileno(self) -> int:
        """To wait on, for bytes from whoever opened the port."""
        return self._master

    @property
    def baud(self) -> int | None:
        """The rate that was set by whoever opened the port; a pseudo-terminal ignores it. None for odd rates."""
        if self.hung_up:
            return None
        return _RATES.get(termios.tcgetattr(self._slave)[5])

    def write(self, data: bytes) -> None:
        """Send bytes; what nobody reads is lost once the line is full, as on a real one."""
        if self.hung_up:
            return
        with suppress(BlockingIOError):
            os.write(self._master, data)

    def read(self) -> bytes:
        """What was written to the port since the last call."""
        if self.hung_up:
            return b""
        try:
            return os.read(self._master, _READ_MAX)
        except BlockingIOError:
            return b""

    def hang_up(self) -> None:
        """The adapter is pulled out: whoever has the port open is told so by his next use of it."""
        if not self.hung_up:
            self.close()
            self.hung_up = True

    def close(self) -> None:
        """Take the link away, where it is still this port's own."""
        if self.hung_up:
            return
        if self._link.is_symlink() and str(self._link.readlink()) == self._target:
            self._link.unlink()
        # The slave is kept open until now: a master without one reads errors.
        os.close(self._master)
        os.close(self._slave)

    def _put_link(self) -> None:
        try:
            self._link.symlink_to(self._target)
        except OSError as error:
            os.close(self._master)
            os.close(self._slave)
            raise _not_made(self._link, error) from error


def _not_made(link: Path, error: OSError) -> ConnectionFailedError:
    return ConnectionFailedError(f"port {link}: cannot make it ({reason_of(error)}); name another path")


def _make_room(link: Path) -> None:
    """Make the folder, and take away what a server that was killed left behind."""
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        if link.is_symlink() and str(link.readlink()).startswith(_PSEUDO_TERMINALS):
            if link.exists():
                raise ConnectionFailedError(
                    f"port {link}: another server may be using it; stop it, or remove this link"
                )
            link.unlink()
    except OSError as error:
        raise _not_made(link, error) from error
    if link.exists() or link.is_symlink():
        raise ConnectionFailedError(f"port {link}: something stands there that is not a simulated port; remove it")


SCHEME = "socket://"


class ServedSocket:
    """A serial line served over TCP, which other processes open as ``socket://host:port``.

    What is written to a pseudo-terminal is handed on by a thread of the system's, of ordinary priority, which other
    programs may keep waiting for a tenth of a second. Over TCP it is there at once.

    As :class:`norton_sim.served_ports.ServedPort`: one program at a time may have it open.

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


def served_port(path: str) -> ServedPort | ServedSocket:
    """At a path a pseudo-terminal, at a ``socket://`` URL a TCP server. Raises ConnectionFailedError."""
    return ServedSocket(path) if path.startswith(SCHEME) else ServedPort(path)
