"""The real world as a backend: python-can buses, pyserial ports and the machine's monotonic clock."""

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import can
import serial

from norton_drivers.adapters.serial_line import EagerSocket, LowLatencySerial, hurry, serial_mend
from norton_drivers.adapters.table import open_bus
from norton_drivers.errors import ConnectionFailedError, reason_of
from norton_drivers.ports import CanPort, Clock, MonotonicClock, SerialLine, SerialPort
from norton_drivers.wiring import CanBusSettings, Wiring

# A time stamp further in the past than this is of another clock than the wall's (some adapters count from power-on).
_OLDEST_NS = 10_000_000_000
_PSEUDO_TERMINAL_BAUD = 115_200
# A device that takes no more bytes must not hold up the loop.
_WRITE_TIMEOUT_S = 0.2


def open_backend(
    wiring: Wiring,  # noqa: ARG001  (every backend takes the same)
    simulated: Mapping[str, Any],  # noqa: ARG001
    *,
    seed: int | None,  # noqa: ARG001
    place: str,  # noqa: ARG001
) -> "HardwareBackend":
    """What the entry point names. Opens nothing yet."""
    return HardwareBackend()


class HardwareBackend:
    """Opens real ports; a driver is told of what arrives with the transport's own time stamps, on ``clock``."""

    def __init__(self) -> None:
        self._clock = MonotonicClock()
        self._ports: list[CanPort | SerialPort] = []

    @property
    def clock(self) -> Clock:
        return self._clock

    @property
    def lock_step(self) -> bool:
        return False

    def open_can(self, settings: CanBusSettings) -> CanPort:
        """Raises ConnectionFailedError with the remedy."""
        opened = open_bus(settings)
        port = CanPort(
            settings.name,
            opened.bus,
            self._clock,
            _ArrivalTime(),
            health=opened.health,
            marks_own_frames=opened.adapter.marks_own_frames,
            linux_error_frames=opened.adapter.linux_error_frames,
        )
        self._ports.append(port)
        return port

    def open_serial(self, port: str, baud: int) -> SerialPort:
        """``port`` is a path or any pyserial URL. Raises ConnectionFailedError with the remedy."""
        try:
            line = _open_line(port, baud)
        except (serial.SerialException, OSError, ValueError) as error:
            raise ConnectionFailedError(
                f"port {port}: cannot open it at {baud} baud ({reason_of(error)}); {serial_mend(error)}"
            ) from error
        serial_port = SerialPort(port, _eager(port, line), self._clock)
        self._ports.append(serial_port)
        return serial_port

    def close(self) -> None:
        ports, self._ports = self._ports, []
        for port in ports:
            with suppress(can.CanError, OSError):
                port.close()


class _ArrivalTime:
    """A received message's time stamp on the monotonic clock: never later than now, never before its predecessor."""

    def __init__(self) -> None:
        self._last_ns = 0

    def __call__(self, message: can.Message) -> int:
        now_ns = time.monotonic_ns()
        age_ns = time.time_ns() - round(message.timestamp * 1e9)
        arrival_ns = now_ns - age_ns if 0 <= age_ns <= _OLDEST_NS else now_ns
        self._last_ns = max(self._last_ns, arrival_ns)
        return self._last_ns


def _open_line(port: str, baud: int) -> serial.Serial:
    exclusive = None if "://" in port else True  # pyserial's URL handlers know no locks
    open_it = partial(serial.serial_for_url, port, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=exclusive)
    try:
        return open_it(baudrate=baud)
    except (serial.SerialException, OSError, ValueError):
        if not _is_pseudo_terminal(port):
            raise
    # A pseudo-terminal has no baud rate, but may refuse to be given an odd one.
    return open_it(baudrate=_PSEUDO_TERMINAL_BAUD)


def _eager(port: str, line: serial.Serial) -> SerialLine:
    """The line as a loop wants it, where it has a descriptor of its own."""
    if os.name != "posix" or ("://" in port and not port.startswith("socket://")):
        return line
    if "://" in port:
        return EagerSocket(line)
    hurry(line)
    return LowLatencySerial(line)


def _is_pseudo_terminal(port: str) -> bool:
    return str(Path(port).resolve()).startswith("/dev/pts/")
