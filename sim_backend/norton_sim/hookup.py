"""How a device is really set up and connected, where that is not what the rig file says.

``device = { node = 3, baud = 115200 }`` in a device's true values changes its options as its firmware sees them, in the
rig file's own spelling. ``driver``, ``bus`` and ``port`` may be given too, ``bitrate`` for a device on CAN, and
``plugged = false`` for one that is not there.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from norton_bench.units import parse_quantity
from norton_drivers import registry
from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.plugs import CanPlug, SerialPlug
from norton_sim.tampering import Piece
from norton_sim.trouble import CAN_ERR_PROTOCOL
from norton_sim.uart import heard_at

PLACES = ("driver", "bus", "port")


@dataclass(frozen=True)
class Hookup:
    """``bitrate_bit_s`` and ``baud`` are the device's own; None where they are those of the wire."""

    plugged: bool = True
    bitrate_bit_s: int | None = None
    baud: int | None = None

    def connect_can(self, plug: CanPlug, bus_bitrate_bit_s: int) -> None:
        """Let ``plug`` pass only what a device set up like this understands."""
        if self.bitrate_bit_s not in (None, bus_bitrate_bit_s):
            # It hears others' frames as errors and says so; others hear its frames as errors.
            plug.tamper(
                to_host=lambda _piece: plug.wire.report_error(CAN_ERR_PROTOCOL),
                to_device=lambda _piece: plug.wire.report_error(CAN_ERR_PROTOCOL),
            )
        if not self.plugged:
            plug.cut()

    def connect_serial(self, plug: SerialPlug) -> None:
        """As :meth:`connect_can`, of a line whose other end listens at the rate that it was opened with."""
        if self.baud is not None:
            plug.tamper(
                to_host=self._garble(plug, lambda host, own: (own, host)),
                to_device=self._garble(plug, lambda host, own: (host, own)),
            )
        if not self.plugged:
            plug.cut()

    def _garble(self, plug: SerialPlug, rates: Callable[[int, int], tuple[int, int]]) -> Callable[[Piece], None]:
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
    options = {key: value for key, value in truth.items() if key not in (*PLACES, "plugged", "bitrate")}
    driver = str(truth.get("driver", settings.driver))
    converted = _in_units(options, driver, settings.role, where)
    kept = settings.options if driver == settings.driver else {}
    hookup = Hookup(
        plugged=_boolean(truth.get("plugged", True), where),
        bitrate_bit_s=round(_quantity(truth["bitrate"], "bit/s", f"{where} bitrate")) if "bitrate" in truth else None,
        baud=converted["baud"] if isinstance(converted.get("baud"), int) else None,
    )
    bus, port = truth.get("bus", settings.bus), truth.get("port", settings.port)
    return replace(settings, driver=driver, bus=bus, port=port, options={**kept, **converted}), hookup


def bitrate_of(wiring: Wiring, bus: str | None) -> int:
    """What the rig file says of a bus."""
    return next((each.bitrate_bit_s for each in wiring.buses if each.name == bus), 0)


def _in_units(options: Mapping[str, Any], driver: str, role: str, where: str) -> dict[str, Any]:
    """Quantities as numbers, in the units that the driver declares."""
    group = registry.TORQUE_SENSORS if role == "torque_sensor" else registry.AMPLIFIERS
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
