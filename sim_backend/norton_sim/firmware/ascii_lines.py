"""A torque sensor that prints its reading, line by line, without being asked."""

from norton_drivers.ascii_lines import AsciiOptions
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import signed_text
from norton_drivers.wiring import parse_options
from norton_sim.firmware.site import Site, TorqueSignal

LINE_PERIOD_NS = 2_000_000
DIGITS_BEFORE, DIGITS_AFTER = 3, 4
# What such indicators print where they have no number to show.
OVERLOAD = b"-OL-"


class AsciiSensor:
    """Prints lines of the form that the rig names: number and unit in their field, zeros in the fields beside it."""

    def __init__(self, site: Site) -> None:
        self.signal = TorqueSignal(site.world.plant)
        self._options = parse_options(AsciiOptions, site.settings)
        self._plug = site.serial_connector()
        site.cyclic(LINE_PERIOD_NS, self._send)

    def freeze(self) -> None:
        """From now on print the torque of this instant."""
        self.signal.freeze()

    def _send(self, _stamp_ns: int) -> None:
        options = self._options
        fields = [b"0"] * (options.field - 1) + [self._number() + options.unit.encode()]
        self._plug.send(options.separator.encode().join(fields).ljust(options.width) + b"\r\n")

    def _number(self) -> bytes:
        try:
            return signed_text(self.signal.measure_nm() / self._options.scale, DIGITS_BEFORE, DIGITS_AFTER)
        except CodecError:
            return OVERLOAD
