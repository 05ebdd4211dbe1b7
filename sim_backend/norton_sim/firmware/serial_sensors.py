"""Sensors on a serial line that print lines of text, or are asked for them: torque, and temperature."""

from functools import partial
from math import isfinite

from norton_drivers.ascii_lines import AsciiOptions
from norton_drivers.celsius import CelsiusOptions
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import LineStream, signed_text
from norton_drivers.codecs.mantracourt import NOT_UNDERSTOOD, question_in
from norton_drivers.mantracourt import MantracourtOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, TorqueSignal

ASCII_PERIOD_NS = 2_000_000
ASCII_DIGITS = 3, 4  # before and after the point
# What such indicators print where they have no number to show.
OVERLOAD = b"-OL-"


class AsciiSensor:
    """A torque sensor that prints its reading, line by line, without being asked.

    Prints lines of the form that the rig names: number and unit in their field, zeros in the fields beside it.
    """

    def __init__(self, context: DeviceContext) -> None:
        self.signal = TorqueSignal(context.world.plant)
        self._options = parse_options(AsciiOptions, context.settings)
        self._connector = context.serial_connector()
        context.cyclic(ASCII_PERIOD_NS, self._send)

    def freeze(self) -> None:
        """From now on print the torque of this instant."""
        self.signal.freeze()

    def _send(self, _stamp_ns: int) -> None:
        options = self._options
        fields = [b"0"] * (options.field - 1) + [self._number() + options.unit.encode()]
        self._connector.send(options.separator.encode().join(fields).ljust(options.width) + b"\r\n")

    def _number(self) -> bytes:
        try:
            return signed_text(self.signal.measure_nm() / self._options.scale, *ASCII_DIGITS)
        except CodecError:
            return OVERLOAD


MANTRACOURT_PERIOD_NS = 2_000_000
PROCESSING_NS = 300_000
MANTRACOURT_DIGITS = 5, 3  # before and after the point
MOST = 10.0 ** MANTRACOURT_DIGITS[0] - 10.0 ** -MANTRACOURT_DIGITS[1]
VERSION = 3 * 256 + 6  # 3.06, as the parameter VER has it
SERIAL_HIGH, SERIAL_LOW = 12.0, 3456.0


class MantracourtSensor:
    """A Mantracourt DSC strain gauge converter: measures on its own, and tells its last value when it is asked.

    It answers to its own station number alone, with five digits before and three after the point, ``?`` to what it
    does not understand, and nothing to station 000, which is all stations. It is set to measure 500 times a second
    (parameter RATE). Source: Mantracourt, "DSC User Manual", appendix B.

    Its station, and what it is asked for, are those that the rig names.
    """

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(MantracourtOptions, context.settings)
        self.signal = TorqueSignal(context.world.plant)
        self._world = context.world
        self._scale = options.scale
        self._station = options.station
        self._values = {options.command: 0.0, "VER": VERSION, "SERH": SERIAL_HIGH, "SERL": SERIAL_LOW}
        self._output = options.command
        self._stream = LineStream(mid_line=False)
        self._connector = context.serial_connector()
        self._connector.on_bytes(self._receive)
        context.cyclic(MANTRACOURT_PERIOD_NS, self._measure)

    def freeze(self) -> None:
        """From now on tell the torque of this instant."""
        self.signal.freeze()

    def _measure(self, _stamp_ns: int) -> None:
        # It clamps, and has no way to say that there is no number (its status word is not read here).
        value = self.signal.measure_nm() / self._scale
        self._values[self._output] = min(max(value, -MOST), MOST) if isfinite(value) else MOST

    def _receive(self, data: bytes) -> None:
        for line in self._stream.feed(data):
            answer = self._answer_to(line.text)
            if answer is not None:
                self._world.at(self._world.now_ns + PROCESSING_NS, partial(self._say, answer))

    def _answer_to(self, text: bytes) -> str | None:
        """The name of the value asked for, "" where the question is not understood, None where nothing is said."""
        if not text.startswith(f"!{self._station:03d}:".encode()):
            return None
        try:
            _, command = question_in(text)
        except CodecError:
            return ""
        return command if command in self._values else ""

    def _say(self, name: str, _stamp_ns: int) -> None:
        text = signed_text(self._values[name], *MANTRACOURT_DIGITS) if name else NOT_UNDERSTOOD
        self._connector.send(text + b"\r")


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
