"""Temperature probes that print degrees Celsius, a number a line, on a serial line, without being asked: "23.41".

An Arduino with a thermocouple amplifier does, and so do many meters. Nothing checks a line but its form (see
:mod:`norton_drivers.codecs.lines`): a number is believed where the line before it was one too.
"""

from pydantic import Field

from norton_drivers.ascii_lines import NumberLines
from norton_drivers.codecs.lines import NumberFormat
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.readings import DeviceIdentity, Inbox, TemperatureReading
from norton_drivers.wiring import DeviceOptions, DeviceSettings, parse_options

CONNECTION = "serial"
BAUD = 9600
# The line that is being printed when the port opens is not whole, and the one after it only makes the next believed:
# of a probe that prints once a second.
NUMBER_WITHIN_S = 3.0


class CelsiusOptions(DeviceOptions):
    """What a rig file may say of a probe."""

    unit: str = Field("", description="the text behind the number, where there is one", examples=[" C"])
    separator: str = Field("", description="what parts the fields of a line, where it has several", examples=[","])
    field: int = Field(1, ge=1, description="which of the fields is the temperature, counted from 1")
    baud: int = Field(BAUD, gt=0, description="the baud rate set in the probe", examples=[BAUD])


def open_temperature_sensor(settings: DeviceSettings, link: Link) -> "CelsiusProbe":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    return CelsiusProbe(settings, parse_options(CelsiusOptions, settings), link)


class CelsiusProbe:
    """A probe on a line of its own."""

    def __init__(self, settings: DeviceSettings, options: CelsiusOptions, link: Link) -> None:
        self.role = settings.role
        self._link, self._port = link, link.serial_port(settings, options.baud)
        self._baud = options.baud
        self._inbox: Inbox[TemperatureReading] = Inbox()
        form = NumberFormat(options.unit, options.separator, options.field)
        self.lines = NumberLines(self._port, form, options.baud, self._put)

    @property
    def malformed(self) -> int:
        """Lines that are no number, or no line."""
        return self.lines.malformed

    def identify(self, timeout_s: float = NUMBER_WITHIN_S) -> DeviceIdentity:
        """Wait for a number: the probe says nothing else. Raises DeviceTimeoutError."""
        before = self._inbox.count
        if not wait_until(lambda: self._inbox.count > before, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"[{self.role}] probe on {self._port.name}: no number in {timeout_s:g} s{self.lines.what_came()}; "
                f"check power, port, baud {self._baud}, and unit, separator and field in the rig file"
            )
        return DeviceIdentity(driver="celsius", address=self._port.name)

    def take_temperature(self) -> list[TemperatureReading]:
        """The readings since the last call, oldest first."""
        return self._inbox.take()

    def _put(self, number: float, arrival_ns: int) -> None:
        self._inbox.put(TemperatureReading(self._inbox.count, arrival_ns, number))
