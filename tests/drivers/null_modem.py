"""A null modem of two pseudo-terminals: what goes in at one path comes out at the other, until it is cut."""

import os
import pty
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class NullModem:
    """``near`` and ``far`` are paths that any program can open as serial ports."""

    def __init__(self) -> None:
        ends = [pty.openpty() for _ in range(2)]
        self._masters = [master for master, _ in ends]
        self._slaves = [slave for _, slave in ends]
        for slave in self._slaves:
            tty.setraw(slave)
        self.near, self.far = (os.ttyname(slave) for slave in self._slaves)
        self._cut = threading.Event()
        self._relay = threading.Thread(target=self._carry, daemon=True)
        self._relay.start()

    def cut(self) -> None:
        """Nothing passes any more."""
        self._cut.set()
        self._relay.join()

    def unplug(self) -> None:
        """The near port is gone, as an adapter that is pulled out."""
        self.cut()
        os.close(self._masters[0])

    def close(self) -> None:
        self.cut()
        for descriptor in (*self._masters, *self._slaves):
            with suppress(OSError):
                os.close(descriptor)

    def _carry(self) -> None:
        other = dict(zip(self._masters, reversed(self._masters), strict=True))
        while not self._cut.is_set():
            ready, _, _ = select.select(self._masters, [], [], 0.01)
            for master in ready:
                os.write(other[master], os.read(master, 4096))


@contextmanager
def null_modem() -> Iterator[NullModem]:
    modem = NullModem()
    try:
        yield modem
    finally:
        modem.close()
