"""The real world as a backend: python-can buses, pyserial ports and the machine's monotonic clock."""

import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import can
import serial

from norton_drivers.adapters.serial_line import open_line, serial_mend
from norton_drivers.adapters.table import open_bus
from norton_drivers.errors import ConnectionFailedError, reason_of
from norton_drivers.ports import CanPort, Clock, MonotonicClock, SerialPort
from norton_drivers.wiring import CanBusSettings, Wiring

# A time stamp further in the past than this is of another clock than the wall's (some adapters count from power-on).
_OLDEST_NS = 10_000_000_000


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
            fd=settings.fd,
            switches_bitrate=settings.switches_bitrate,
        )
        self._ports.append(port)
        return port

    def open_serial(self, port: str, baud: int) -> SerialPort:
        """``port`` is a path or any pyserial URL. Raises ConnectionFailedError with the remedy."""
        try:
            line = open_line(port, baud)
        except (serial.SerialException, OSError, ValueError) as error:
            raise ConnectionFailedError(
                f"port {port}: cannot open it at {baud} baud ({reason_of(error)}); {serial_mend(error)}"
            ) from error
        serial_port = SerialPort(port, line, self._clock)
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
