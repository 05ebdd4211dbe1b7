"""Torque sensors and indicators that print numbers, line by line, on a serial line, without being asked.

Torque is that which the actuator exerts on the load, times ``direction``. Nothing checks a line but its form (see
:mod:`norton_drivers.codecs.lines`): where the sensor's lines are all of one width, say so with ``width``.
"""

from collections.abc import Callable
from math import inf

from pydantic import Field

from norton_drivers.codecs.lines import LINE_MAX, LineStream, NumberFormat, Numbers
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort
from norton_drivers.readings import DeviceIdentity
from norton_drivers.serial_sensor import SerialSensor
from norton_drivers.serial_timing import ByteStamps
from norton_drivers.wiring import DeviceSettings, TorqueSensorOptions, parse_options

CONNECTION = "serial"
OPTION_UNITS = {"range": "N*m", "averaging": "s"}

BAUD = 115_200
_SHOWN = 40  # characters of a line that is no number, in a message


class AsciiOptions(TorqueSensorOptions):
    """What a rig file may say of a sensor that prints lines."""

    scale: float = Field(gt=0, description="N*m per unit of the number", examples=[0.001])
    unit: str = Field("", description="the text behind the number, where there is one", examples=["Nm"])
    separator: str = Field("", description="what parts the fields of a line, where it has several", examples=[";"])
    field: int = Field(1, ge=1, description="which of the fields is the torque, counted from 1")
    width: int = Field(
        0, ge=0, le=LINE_MAX, description="characters of a line, where they are always as many; 0 where not"
    )
    range_nm: float = Field(inf, alias="range", gt=0, description="the torque it can measure", examples=["2 N*m"])
    baud: int = Field(BAUD, gt=0, description="the baud rate set in the sensor", examples=[BAUD])

    @property
    def number_format(self) -> NumberFormat:
        return NumberFormat(self.unit, self.separator, self.field, self.width)


def open_torque_sensor(settings: DeviceSettings, link: Link) -> "AsciiSensor":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(AsciiOptions, settings)
    return AsciiSensor(settings, options, link.serial_port(settings, options.baud), link)


class NumberLines:
    """The numbers that a sensor prints on ``port``: each goes to ``put``, with when its line was complete [ns].

    ``numbers`` counts lines that are no number of the expected form, ``stream`` those that never ended.
    """

    def __init__(self, port: SerialPort, form: NumberFormat, baud: int, put: Callable[[float, int], None]) -> None:
        self.stream = LineStream(mid_line=True)
        self.numbers = Numbers(form)
        self._stamps = ByteStamps(baud)
        self._put = put
        self._last_garbled = b""
        port.subscribe(self._on_bytes)

    @property
    def malformed(self) -> int:
        """Lines that are no number, or no line."""
        return self.numbers.garbled + self.stream.overlong

    def what_came(self) -> str:
        """In brackets, for a message that no number came; empty where nothing did."""
        if not self.malformed:
            return ""
        last = f", the last {self._last_garbled[:_SHOWN].decode('ascii', 'replace')!r}" if self._last_garbled else ""
        return f" ({self.malformed} lines that are none{last})"

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        for line in self.stream.feed(data):
            number = self.numbers.take(line.text)
            if number is None:
                self._last_garbled = line.text
            elif self.numbers.believed:
                self._put(number, self._stamps.complete_ns(arrival_ns, line.later_bytes))


class AsciiSensor(SerialSensor):
    """A torque sensor that prints lines."""

    def __init__(self, settings: DeviceSettings, options: AsciiOptions, port: SerialPort, link: Link) -> None:
        super().__init__(settings, options, port, link, options.scale)
        self._baud = options.baud
        self.lines = NumberLines(port, options.number_format, options.baud, self._put)

    @property
    def malformed(self) -> int:
        """Lines that are no number, or no line."""
        return self.lines.malformed

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Wait for a number: the sensor says nothing else."""
        if not self._comes(timeout_s):
            raise DeviceTimeoutError(
                f"[{self.role}] sensor on {self._port.name}: no number in {timeout_s:g} s{self.lines.what_came()}; "
                f"check power, port, baud {self._baud}, and unit, separator, field and width in the rig file"
            )
        return DeviceIdentity(driver="ascii", address=self._port.name)
