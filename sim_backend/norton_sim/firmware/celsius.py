"""A temperature probe that prints degrees Celsius, line by line, without being asked."""

from norton_drivers.celsius import CelsiusOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext

PERIOD_NS = 500_000_000
ROOM_C = 23.41  # the simulated machines stay as warm as the room


class CelsiusProbe:
    """Prints the room's temperature in the field that the rig names, with zeros in the fields beside it."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = parse_options(CelsiusOptions, context.settings)
        self._connector = context.serial_connector()
        context.cyclic(PERIOD_NS, self._send)

    def freeze(self) -> None:
        """The room's temperature does not change anyway."""

    def _send(self, _stamp_ns: int) -> None:
        options = self._options
        fields = [b"0"] * (options.field - 1) + [f"{ROOM_C:.2f}{options.unit}".encode()]
        self._connector.send(options.separator.encode().join(fields) + b"\n")
