"""Torque sensors on a scripted serial line: Bota, DYN-200 pushed and polled, lines of numbers, Mantracourt."""

import re
from collections.abc import Sequence
from math import isfinite
from random import Random
from struct import Struct
from typing import Any

from norton_bench.testing import ScriptedWorld
from norton_drivers import ascii_lines, bota, dyn200, mantracourt
from norton_drivers.codecs.bota import BotaFrame
from norton_drivers.codecs.dyn200 import PushFrame, number_value
from norton_drivers.codecs.lines import signed_text
from norton_drivers.codecs.modbus import ReadAnswer
from norton_drivers.wiring import DeviceSettings

from .streams import StreamCodec

_CRC16 = "CRC-16: one damaged message in 65536"
_MISSED = 2.0**-16  # of damaged messages, by a checksum of 16 bits
_PAUSE_NS = 5_000_000
_F32 = Struct("<f")


class SensorLine:
    """A sensor's driver at the host's end of a scripted line."""

    def __init__(self, module: Any, **options: Any) -> None:
        self._world = ScriptedWorld()
        self._link = self._world.link()
        settings = DeviceSettings("torque_sensor", "sensor", port="line", options=options)
        self.driver = module.open_torque_sensor(settings, self._link)
        self._poll = self._link.serial_port(settings, 115_200).poll

    def told(self, _wire: bytes) -> Sequence[object]:
        return []

    def hear(self, data: bytes) -> Sequence[object]:
        self._world.line.arriving += data
        self._poll()
        return [each.torque_nm for each in self.driver.take_torque() if each.valid]

    def pause(self) -> None:
        self._world.line.sent.clear()
        self._world.clock.ns += _PAUSE_NS
        self._link.poll()

    def close(self) -> None:
        self._world.close()


class BotaLine(SensorLine):
    def __init__(self) -> None:
        super().__init__(bota)

    def message(self, random: Random) -> tuple[bytes, object]:
        numbers = [_F32.unpack(_F32.pack(random.uniform(-100, 100)))[0] for _ in range(6)]
        frame = BotaFrame(0, *numbers, random.getrandbits(32), 25.0)
        return frame.encode(), frame.torque_z_nm

    @property
    def by_chance(self) -> float:
        return self.driver.stream.crc_errors * _MISSED


class PushedLine(SensorLine):
    def __init__(self) -> None:
        super().__init__(dyn200, mode="push", torque_per_digit=1.0)

    def message(self, random: Random) -> tuple[bytes, object]:
        torque = random.randint(-65535, 65535)
        return PushFrame(torque, random.randrange(3000)).encode(), torque

    @property
    def by_chance(self) -> float:
        return self.driver.stream.crc_errors * _MISSED


class ModbusLine(SensorLine):
    """It answers whether it is asked or not."""

    def __init__(self) -> None:
        super().__init__(dyn200, mode="polled", torque_per_digit=1.0, silence=0.0)
        self._heard = 0
        self._messages = 0

    def message(self, random: Random) -> tuple[bytes, object]:
        self._messages += 1
        number = random.randint(-(2**31), 2**31 - 1)
        return ReadAnswer(1, number_value(number)).encode(), number

    def hear(self, data: bytes) -> Sequence[object]:
        heard = super().hear(data)
        self._heard += len(heard)
        return heard

    @property
    def by_chance(self) -> float:
        return max(0, self._messages - self._heard) * _MISSED


class NumberLine(SensorLine):
    """Lines of numbers with a sign, five digits, a point and three digits; ``unit`` behind them."""

    by_chance = 0.0
    _CHARACTERS = re.compile(rb"[-+.0-9eE ]+")

    def __init__(self, module: Any, *, end: bytes, unit: str = "", width: int = 0) -> None:
        super().__init__(module, scale=1.0, width=width, **({"unit": unit} if unit else {"averaging": 0.0}))
        self._end, self._unit, self._width = end, unit.encode(), width
        self._signed = module is mantracourt
        self._begun = b""

    def message(self, random: Random) -> tuple[bytes, object]:
        text = signed_text(random.uniform(-99_999, 99_999), 5, 3)
        return text + self._unit + self._end, float(text)

    def told(self, wire: bytes) -> Sequence[object]:
        *lines, self._begun = re.split(rb"[\r\n]", self._begun + wire)
        return [number for line in lines if (number := self._number_in(line)) is not None]

    def _number_in(self, line: bytes) -> float | None:
        """By Python's own reading of numbers."""
        text = line.removesuffix(b" " * (len(line) - len(line.rstrip(b" "))))
        if (self._width and len(line) != self._width) or not text.endswith(self._unit):
            return None
        text = text.removesuffix(self._unit).strip(b" ")
        if not self._CHARACTERS.fullmatch(text) or (self._signed and text[:1] not in (b"+", b"-")):
            return None
        try:
            number = float(text[:1] + text[1:].lstrip(b" ") if text[:1] in (b"+", b"-") else text)
        except ValueError:
            return None
        return number if isfinite(number) else None


def bota_frames() -> StreamCodec:
    return StreamCodec("Bota frames", _CRC16, BotaLine)


def pushed_frames() -> StreamCodec:
    # It reads nothing before three good frames in a row.
    return StreamCodec("DYN-200 pushed", f"{_CRC16}; three in a row to begin", PushedLine, damaged_share=0.05)


def modbus_answers() -> StreamCodec:
    return StreamCodec("DYN-200 polled (Modbus RTU)", f"{_CRC16}; station, function, length", ModbusLine)


def bare_lines() -> StreamCodec:
    form = "form; two numbers in a row"
    return StreamCodec("lines of numbers", form, lambda: NumberLine(ascii_lines, end=b"\r\n"))


def padded_lines() -> StreamCodec:
    def make() -> NumberLine:
        return NumberLine(ascii_lines, end=b"\r\n", unit="Nm", width=12)

    return StreamCodec("lines of numbers, width and unit", "form, width, unit; two in a row", make)


def mantracourt_answers() -> StreamCodec:
    def make() -> NumberLine:
        return NumberLine(mantracourt, end=b"\r", width=10)

    return StreamCodec("Mantracourt", "form, sign, width; one question at a time", make)
