"""The real world as a backend: python-can buses, pyserial ports and the machine's monotonic clock."""

import logging
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import serial

from drivers.clock import Clock, MonotonicClock
from drivers.errors import ConnectionFailedError
from drivers.ports import CanPort, SerialPort
from drivers.wiring import CanBusSettings, Wiring

# A time stamp further in the past than this is of another clock than the wall's (some adapters count from power-on).
_OLDEST_NS = 10_000_000_000
_LIKELY_MENDS = {
    "socketcan": "is it up? `ip link set {channel} up type can bitrate {bitrate}`",
    "slcan": "is the adapter plugged in, and may this user open it (group dialout)?",
    "udp_multicast": "the channel must be a multicast address, e.g. 239.74.163.2, and the network must be up",
}
_PSEUDO_TERMINAL_BAUD = 115_200
_NOT_BUSES = ("virtual", "serial")  # inside one process; every serial port over again


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
        """Raises ConnectionFailedError with the mend."""
        try:
            bus = _open_bus(settings)
        except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
            raise ConnectionFailedError(_complaint(settings, error)) from error
        port = CanPort(settings.name, bus, self._clock, _ArrivalTime())
        self._ports.append(port)
        return port

    def open_serial(self, port: str, baud: int) -> SerialPort:
        """``port`` is a path or any pyserial URL. Raises ConnectionFailedError with the mend."""
        try:
            line = _open_line(port, baud)
        except (serial.SerialException, OSError, ValueError) as error:
            raise ConnectionFailedError(
                f"port {port}: cannot open it at {baud} baud ({error}); is it plugged in, free, and may this user open "
                "it (group dialout)?"
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


def _open_bus(settings: CanBusSettings) -> can.BusABC:
    arguments = {"bitrate": settings.bitrate_bit_s, **settings.options}
    if settings.interface == "udp_multicast":
        from drivers.buses import QuietUdpBus  # noqa: PLC0415  (msgpack is needed by this interface alone)

        return QuietUdpBus(settings.channel, **arguments)
    if settings.interface == "slcan":
        from drivers.buses import SteadySlcanBus  # noqa: PLC0415

        return SteadySlcanBus(settings.channel, **arguments)
    # Without python-can's own configuration files: the rig file alone says what is opened.
    return can.Bus(settings.channel, settings.interface, ignore_config=True, **arguments)


def _complaint(settings: CanBusSettings, error: Exception) -> str:
    place = f"[bus.{settings.name}] {settings.interface} on {settings.channel}"
    if settings.interface not in can.VALID_INTERFACES:
        return f"{place}: python-can has no such interface; known: {', '.join(sorted(can.VALID_INTERFACES))}"
    mend = _LIKELY_MENDS.get(settings.interface, "is the adapter plugged in, and its driver installed?")
    return f"{place}: cannot open it ({error}); {mend.format(channel=settings.channel, bitrate=settings.bitrate_bit_s)}"


def _open_line(port: str, baud: int) -> serial.Serial:
    exclusive = None if "://" in port else True  # pyserial's URL handlers know no locks
    try:
        return serial.serial_for_url(port, baudrate=baud, timeout=0, exclusive=exclusive)
    except (serial.SerialException, OSError, ValueError):
        if not _is_pseudo_terminal(port):
            raise
    # A pseudo-terminal has no baud rate, but may refuse to be given an odd one.
    return serial.serial_for_url(port, baudrate=_PSEUDO_TERMINAL_BAUD, timeout=0, exclusive=exclusive)


def _is_pseudo_terminal(port: str) -> bool:
    return str(Path(port).resolve()).startswith("/dev/pts/")


@dataclass(frozen=True)
class FoundPort:
    """Something that a rig file could name: ``kind`` is "serial" or a python-can interface."""

    kind: str
    channel: str
    description: str = ""


def list_ports() -> tuple[FoundPort, ...]:
    """Serial ports and CAN channels that this machine has. Opens nothing; takes some seconds with some adapters."""
    from serial.tools import list_ports as serial_list  # noqa: PLC0415

    found = [FoundPort("serial", entry.device, entry.description) for entry in serial_list.comports()]
    logging.getLogger("can").setLevel(logging.CRITICAL)  # it says of each adapter's library that it is not installed
    configurations = [(str(each["interface"]), str(each["channel"])) for each in can.detect_available_configs()]
    return (*found, *(FoundPort(kind, channel) for kind, channel in configurations if kind not in _NOT_BUSES))
