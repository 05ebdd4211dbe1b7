"""The far end of Modbus RTU: what a station makes of the bytes on its line.

It hears its own address alone, reads holding registers, and answers everything else that is sound with an exception.
Source: "MODBUS Application Protocol Specification V1.1b3", sections 6.3 and 7; "MODBUS over Serial Line Specification
and Implementation Guide V1.02", section 2.
"""

from collections.abc import Callable, Mapping

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

MOST_REGISTERS = 12
WRITE_COILS, WRITE_REGISTERS = 15, 16


class ModbusServer:
    """``numbers()`` gives the station's numbers by their first register, two registers each."""

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
        found: dict[int, bytes] = {}
        for first, number in self._numbers().items():
            value = number_value(number)
            found |= {first + k: value[2 * k : 2 * k + 2] for k in range(NUMBER_REGISTERS)}
        return found
