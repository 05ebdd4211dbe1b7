"""How a simulated device is really set up and connected, where that differs from the rig file.

``device = { node = 3, baud = 115200 }`` in a device's true values changes its options as its firmware sees them, in the
rig file's own spelling. ``driver``, ``bus`` and ``port`` may be given too, ``bitrate`` and ``data_bitrate`` for a
device on CAN, and ``plugged = false`` for one that is not there.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import floor
from typing import Any

from norton_bench.units import parse_quantity
from norton_drivers import registry
from norton_drivers.errors import WiringError
from norton_drivers.wiring import CanBusSettings, DeviceSettings
from norton_sim.connectors import CAN_ERR_PROTOCOL, CanConnector, Piece, SerialConnector

_DATA_BITS = 8
_FRAME_BITS = 10  # start, eight data bits, stop


def heard_at(data: bytes, sent_baud: float, heard_baud: float) -> bytes:
    """What a receiver makes of bytes that were sent at another baud rate: it samples the same line at its own times.

    ``data``, sent back to back without parity and with one stop bit, as a UART of another rate receives it.

    The line rests before and after. A character whose stop bit is missing is handed over all the same, as most
    drivers do; the receiver then waits for the line to rest.
    """
    return bytes(_heard(_Line(data, sent_baud), 1 / heard_baud))


class _Line:
    """The level of the line at any time [s], counted from the first start bit."""

    def __init__(self, data: bytes, baud: float) -> None:
        self._bits = [bit for byte in data for bit in (0, *((byte >> place) & 1 for place in range(_DATA_BITS)), 1)]
        self._baud = baud

    def level(self, time_s: float) -> int:
        place = floor(time_s * self._baud)
        return self._bits[place] if 0 <= place < len(self._bits) else 1

    def next_fall_s(self, from_s: float) -> float | None:
        """When the line next goes from rest to a start bit; a line that is low already must rest first."""
        place = max(0, floor(from_s * self._baud))
        before = self.level(from_s)
        while place < len(self._bits):
            if before == 1 and self._bits[place] == 0:
                return max(from_s, place / self._baud)
            before = self._bits[place]
            place += 1
        return None


def _heard(line: _Line, bit_s: float) -> Iterator[int]:
    at_s = -bit_s
    while (start_s := line.next_fall_s(at_s)) is not None:
        # Half a bit in, a false start bit is seen for what it is.
        if line.level(start_s + 0.5 * bit_s) == 1:
            at_s = start_s + 0.5 * bit_s
            continue
        bits = (line.level(start_s + (1.5 + place) * bit_s) << place for place in range(_DATA_BITS))
        yield sum(bits)
        at_s = start_s + (_FRAME_BITS - 0.5) * bit_s


PLACES = ("driver", "bus", "port")
RATES = ("bitrate", "data_bitrate")


@dataclass(frozen=True)
class Hookup:
    """``bitrate_bit_s``, ``data_bitrate_bit_s`` and ``baud`` are the device's own; None where they are those of the
    wire."""

    plugged: bool = True
    bitrate_bit_s: int | None = None
    data_bitrate_bit_s: int | None = None
    baud: int | None = None

    def connect_can(self, plug: CanConnector, bus: CanBusSettings) -> None:
        """Let ``plug`` pass only what a device set up like this understands."""
        rates = ((self.bitrate_bit_s, bus.bitrate_bit_s), (self.data_bitrate_bit_s, bus.data_bitrate_bit_s))
        if any(own not in (None, its) for own, its in rates):
            # It hears others' frames as errors and says so; others hear its frames as errors.
            plug.tamper(
                to_host=lambda _piece: plug.wire.report_error(CAN_ERR_PROTOCOL),
                to_device=lambda _piece: plug.wire.report_error(CAN_ERR_PROTOCOL),
            )
        if not self.plugged:
            plug.cut()

    def connect_serial(self, plug: SerialConnector) -> None:
        """As :meth:`connect_can`, of a line whose other end listens at the rate that it was opened with."""
        if self.baud is not None:
            plug.tamper(
                to_host=self._garble(plug, lambda host, own: (own, host)),
                to_device=self._garble(plug, lambda host, own: (host, own)),
            )
        if not self.plugged:
            plug.cut()

    def _garble(self, plug: SerialConnector, rates: Callable[[int, int], tuple[int, int]]) -> Callable[[Piece], None]:
        own = self.baud or 0

        def tamper(piece: Piece) -> None:
            host = plug.wire.host_baud
            data = piece.data if host in (None, own) else heard_at(piece.data, *rates(host or own, own))
            if data:
                piece.forward(data)

        return tamper


AS_WRITTEN = Hookup()


def really(settings: DeviceSettings, truth: Mapping[str, Any], place: str) -> tuple[DeviceSettings, Hookup]:
    """``settings`` as the device is really set up, and how it is connected. Raises WiringError with place and mend."""
    if not truth:
        return settings, AS_WRITTEN
    where = f"{place}: [simulated.{settings.role}] device"
    options = {key: value for key, value in truth.items() if key not in (*PLACES, *RATES, "plugged")}
    driver = str(truth.get("driver", settings.driver))
    converted = _in_units(options, driver, settings.role, where)
    retained = settings.options if driver == settings.driver else {}
    rates = {f"{key}_bit_s": round(_quantity(truth[key], "bit/s", f"{where} {key}")) for key in RATES if key in truth}
    hookup = Hookup(
        plugged=_boolean(truth.get("plugged", True), where),
        **rates,
        baud=converted["baud"] if isinstance(converted.get("baud"), int) else None,
    )
    bus, port = truth.get("bus", settings.bus), truth.get("port", settings.port)
    return replace(settings, driver=driver, bus=bus, port=port, options={**retained, **converted}), hookup


def _in_units(options: Mapping[str, Any], driver: str, role: str, where: str) -> dict[str, Any]:
    """Quantities as numbers, in the units that the driver declares."""
    group = registry.group_of(role)
    factory = registry.load(group, driver, asked_by=f"{where} driver")
    units = getattr(sys.modules[factory.__module__], "OPTION_UNITS", {})
    return {
        key: _quantity(value, units[key], f"{where} {key}") if key in units else value for key, value in options.items()
    }


def _quantity(text: object, unit: str, where: str) -> float:
    try:
        return parse_quantity(text, unit)
    except ValueError as error:
        raise WiringError(f"{where}: {error}") from None


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool):
        raise WiringError(f"{where} plugged = {value!r} should be true or false")
    return value
