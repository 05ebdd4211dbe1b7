"""Drives on serial lines that speak when spoken to: their decoders, with answers that come whether asked for or not."""

from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from norton_drivers.codecs import odrive_ascii, simplefoc, vesc_uart
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import LineStream
from norton_drivers.codecs.simplefoc import MotorState
from norton_drivers.codecs.vesc_uart import PacketStream, Value, mask_of

from .streams import StreamCodec

_MASK = mask_of(Value.Q_A, Value.ERPM, Value.FAULT, Value.POSITION_DEG, Value.STATUS)
_DECIMALS = 5


class AnswerLine:
    """``by_chance`` counts what the checksum lets through of what it found to be damaged."""

    def told(self, _wire: bytes) -> Sequence[object]:
        return []

    def pause(self) -> None:
        """No answer waits for the next."""

    def close(self) -> None:
        """Nothing is open."""


class VescLine(AnswerLine):
    def __init__(self) -> None:
        self._stream = PacketStream()

    def message(self, random: Random) -> tuple[bytes, object]:
        values = {
            Value.Q_A: random.randint(-6000, 6000) / 100,
            Value.ERPM: float(random.randint(-100_000, 100_000)),
            Value.FAULT: random.randrange(30),
            Value.POSITION_DEG: random.randrange(360_000_000) / 1e6,
            Value.STATUS: random.randrange(2),
        }
        payload = vesc_uart.values_value(values, _MASK)
        return vesc_uart.packet(payload), tuple(sorted(vesc_uart.values_of(payload).items()))

    def hear(self, data: bytes) -> Sequence[object]:
        found = []
        for received in self._stream.feed(data):
            if vesc_uart.mask_in(received.payload) == _MASK:
                try:
                    found.append(tuple(sorted(vesc_uart.values_of(received.payload).items())))
                except CodecError:
                    continue
        return found

    @property
    def by_chance(self) -> float:
        return self._stream.malformed * 2.0**-16


class TextLine(AnswerLine):
    """Lines of text: ``form`` makes the reading of one, None where it is none."""

    def __init__(self, form: Callable[[str], object | None]) -> None:
        self._form = form
        self._begun = b""

    def _readings(self, texts: Sequence[str]) -> list[object]:
        return [reading for text in texts if (reading := self._form(text)) is not None]


class ODriveLine(TextLine):
    def __init__(self) -> None:
        super().__init__(odrive_ascii.feedback_in)
        self._stream = odrive_ascii.TextStream()

    def message(self, random: Random) -> tuple[bytes, object]:
        text = odrive_ascii.feedback_text(random.uniform(-100, 100), random.uniform(-20, 20))
        return odrive_ascii.line(text, b"\r\n"), odrive_ascii.feedback_in(text)

    def hear(self, data: bytes) -> Sequence[object]:
        return self._readings([told.text for told in self._stream.feed(data)])

    @property
    def by_chance(self) -> float:
        return self._stream.garbled * 2.0**-8


class SimpleFocLine(TextLine):
    """There is no checksum: what has the form of seven numbers is one."""

    by_chance = 0.0

    def __init__(self) -> None:
        super().__init__(simplefoc.state_in)
        self._stream = LineStream(mid_line=False)

    def message(self, random: Random) -> tuple[bytes, object]:
        state = MotorState(*(random.uniform(-100, 100) for _ in range(simplefoc.NUMBERS)))
        text = simplefoc.state_text(state, _DECIMALS)
        return text.encode() + b"\r\n", simplefoc.state_in(text)

    def told(self, wire: bytes) -> Sequence[object]:
        *lines, self._begun = (self._begun + wire).replace(b"\r", b"\n").split(b"\n")
        found: list[object] = []
        for line in lines:
            fields: list[Any] = line.split(b";")
            # By Python's own reading of numbers.
            if len(fields) == simplefoc.NUMBERS and not line.strip(b"0123456789.-;"):
                try:
                    found.append(MotorState(*map(float, fields)))
                except ValueError:
                    continue
        return found

    def hear(self, data: bytes) -> Sequence[object]:
        return self._readings([each.text.decode("ascii", "replace") for each in self._stream.feed(data)])


def vesc_values() -> StreamCodec:
    return StreamCodec("VESC on a serial line", "CRC-16: one damaged message in 65536", VescLine)


def odrive_feedback() -> StreamCodec:
    return StreamCodec("ODrive ASCII", "exclusive or: one damaged line in 256; form", ODriveLine)


def simplefoc_states() -> StreamCodec:
    return StreamCodec("SimpleFOC Commander", "form: seven numbers with a point", SimpleFocLine)
