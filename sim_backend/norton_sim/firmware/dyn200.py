"""A DYN-200 torque sensor: pushing its frames at 1 kHz, or answering Modbus RTU questions to its own address.

It measures 1000 times a second and says whole digits; it answers ``PROCESSING_NS`` after a question's last byte, with
the sample that it then has. Sources: as for :mod:`norton_drivers.codecs.dyn200`.
"""

from collections.abc import Callable, Mapping
from functools import partial
from math import isfinite, log10, tau

from norton_drivers.codecs import dyn200
from norton_drivers.codecs.dyn200 import NUMBER_REGISTERS, number_value
from norton_drivers.codecs.modbus import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    READ_HOLDING_REGISTERS,
    REQUEST_LENGTH,
    ReadAnswer,
    ReadRequest,
    Refusal,
    is_sound,
)
from norton_drivers.dyn200 import Dyn200Options
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, TorqueSignal

MOST_REGISTERS = 12
WRITE_COILS, WRITE_REGISTERS = 15, 16


class ModbusServer:
    """The far end of Modbus RTU: what a station makes of the bytes on its line.

    It hears its own address alone, reads holding registers, and answers everything else that is sound with an
    exception. Source: "MODBUS Application Protocol Specification V1.1b3", sections 6.3 and 7; "MODBUS over Serial
    Line Specification and Implementation Guide V1.02", section 2.

    ``numbers()`` gives the station's numbers by their first register, two registers each.
    """

    def __init__(self, station: int, numbers: Callable[[], Mapping[int, int]]) -> None:
        self._station = station
        self._numbers = numbers
        self._buffer = bytearray()

    def begin(self) -> None:
        """The line was silent: what comes now is the beginning of a frame."""
        self._buffer.clear()

    def questions_in(self, data: bytes) -> list[bytes]:
        """Sound frames to this station that ``data`` completes; after an unsound one, silence must mark the next."""
        questions: list[bytes] = []
        self._buffer += data
        while len(self._buffer) >= (length := self._frame_length()):
            frame = bytes(self._buffer[:length])
            del self._buffer[:length]
            if frame[0] == self._station and is_sound(frame):
                questions.append(frame)
        return questions

    def answer_to(self, frame: bytes) -> bytes:
        """The registers asked for, or an exception."""
        function = frame[1]
        if function != READ_HOLDING_REGISTERS:
            return Refusal(self._station, ILLEGAL_FUNCTION, function).encode()
        request = ReadRequest.decode(frame)
        if not 1 <= request.count <= MOST_REGISTERS:
            return Refusal(self._station, ILLEGAL_VALUE).encode()
        registers = self._registers()
        asked = range(request.register, request.register + request.count)
        if not all(register in registers for register in asked):
            return Refusal(self._station, ILLEGAL_ADDRESS).encode()
        return ReadAnswer(self._station, b"".join(registers[register] for register in asked)).encode()

    def _frame_length(self) -> int:
        if len(self._buffer) > 6 and self._buffer[1] in (WRITE_COILS, WRITE_REGISTERS):
            return 9 + self._buffer[6]
        return REQUEST_LENGTH

    def _registers(self) -> dict[int, bytes]:
        result: dict[int, bytes] = {}
        for first, number in self._numbers().items():
            value = number_value(number)
            result |= {first + k: value[2 * k : 2 * k + 2] for k in range(NUMBER_REGISTERS)}
        return result


SAMPLE_PERIOD_NS = 1_000_000
PROCESSING_NS = 500_000
PUSHED_MOST = 0xFFFF
NUMBER_MOST = 0x7FFF_FFFF
SPEED_MOST = 0x7FFF
# Bytes that the line has been silent after for longer than this belong to no question any more.
GAP_NS = 1_750_000


class Dyn200Sensor:
    """Its station, scale and mode are those that the rig names."""

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(Dyn200Options, context.settings)
        self.signal = TorqueSignal(context.world.plant)
        self._world = context.world
        self._options = options
        self._digits = 0
        self._connector = context.serial_connector()
        if options.mode == "push":
            context.cyclic(SAMPLE_PERIOD_NS, self._push)
        else:
            self._server = ModbusServer(options.station, self._numbers)
            self._heard_ns = 0
            self._connector.on_bytes(self._receive)
            context.cyclic(SAMPLE_PERIOD_NS, self._measure)

    def freeze(self) -> None:
        """From now on report the torque of this instant."""
        self.signal.freeze()

    def _measure(self, _stamp_ns: int) -> None:
        self._digits = self._digits_now(NUMBER_MOST)

    def _digits_now(self, most: int) -> int:
        digits = self.signal.measure_nm() / self._options.torque_per_digit_nm
        # What cannot be measured is what the converter gives when it is driven beyond its end.
        return min(max(round(digits), -most), most) if isfinite(digits) else most

    def _speed_rpm(self) -> int:
        return min(round(abs(self._world.plant.true_velocity_rad_s("actuator")) * 60 / tau), SPEED_MOST)

    # ---- active upload ----

    def _push(self, _stamp_ns: int) -> None:
        self._connector.send(dyn200.PushFrame(self._digits_now(PUSHED_MOST), self._speed_rpm()).encode())

    # ---- Modbus ----

    def _receive(self, data: bytes) -> None:
        now_ns = self._world.now_ns
        if now_ns - self._heard_ns > GAP_NS:
            self._server.begin()
        self._heard_ns = now_ns
        for question in self._server.questions_in(data):
            self._world.at(now_ns + PROCESSING_NS, partial(self._answer, question))

    def _answer(self, question: bytes, _stamp_ns: int) -> None:
        self._connector.send(self._server.answer_to(question))

    def _numbers(self) -> Mapping[int, int]:
        """The numbers that can be read, by their first register."""
        return {
            dyn200.TORQUE_REGISTER: self._digits,
            dyn200.SPEED_REGISTER: self._speed_rpm(),
            dyn200.DECIMALS_REGISTER: self._decimals(),
            dyn200.ZERO_AT_START_REGISTER: 0,
        }

    def _decimals(self) -> int:
        if self._options.expected_decimals is not None:
            return self._options.expected_decimals
        return max(0, round(-log10(self._options.torque_per_digit_nm)))
