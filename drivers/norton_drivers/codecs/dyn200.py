"""DYN-200 torque sensors: what their Modbus registers hold, and the frames that they push by themselves.

Torque is a whole number of digits; what a digit is worth depends on the model and on the decimals set in it. In *active
upload, mode 0* the sensor sends a frame a thousand times a second at 115200 baud: u16 magnitude of the torque, u16
speed whose highest bit is the torque's sign, both high byte first, and CRC-16/MODBUS, low byte first. Sources: ATO,
"Wiring RS485 Port of Torque Sensor for Modbus Communication" (registers 0 and 2); the register list and the frames as
published in libraries for the sensor (J. Deuter's "DYN200" for Arduino; a C library with the test vector
00 7B 80 64 = -123 digits at 100 rpm).
"""

from struct import Struct, error
from typing import Final, NamedTuple, Self

from norton_drivers.codecs.common import CodecError, crc16_modbus

BAUD: Final = 115_200
FRAME_LENGTH: Final = 6
FRAMES_TO_LOCK: Final = 3
STATION_MAX: Final = 120

TORQUE_REGISTER: Final = 0x0000  # each number is an i32 in two registers
SPEED_REGISTER: Final = 0x0002
DECIMALS_REGISTER: Final = 0x0008
ZERO_AT_START_REGISTER: Final = 0x000A  # 1 where it takes the torque at power-on for zero
NUMBER_REGISTERS: Final = 2

_NUMBER = Struct(">i")
_FRAME = Struct(">HH")
_SIGN = 0x8000
_CRC_LENGTH = 2


def number_value(number: int) -> bytes:
    """Two registers. Raises CodecError for what 32 bits cannot carry."""
    try:
        return _NUMBER.pack(number)
    except error as reason:
        raise CodecError(f"DYN-200 register: {reason}") from reason


def number_of(data: bytes) -> int:
    """The number in two registers."""
    return int(_NUMBER.unpack(data)[0])


class PushFrame(NamedTuple):
    """One sample: torque in digits, -65535 to 65535; speed in revolutions a minute, 0 to 32767, without a sign."""

    torque_digits: int
    speed_rpm: int

    def encode(self) -> bytes:
        """The six bytes. Raises CodecError where a value does not fit."""
        sign = _SIGN if self.torque_digits < 0 else 0
        if not (abs(self.torque_digits) <= 0xFFFF and 0 <= self.speed_rpm < _SIGN):
            raise CodecError(f"DYN-200 frame: {self} does not fit")
        data = _FRAME.pack(abs(self.torque_digits), self.speed_rpm | sign)
        return data + crc16_modbus(data).to_bytes(_CRC_LENGTH, "little")

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Exactly one frame. Raises CodecError for a wrong length or CRC."""
        if len(data) != FRAME_LENGTH or not _is_frame(data):
            raise CodecError("DYN-200 frame: not six bytes with their CRC")
        magnitude, speed = _FRAME.unpack_from(data)
        return cls(-magnitude if speed & _SIGN else magnitude, speed & ~_SIGN)


def _is_frame(data: bytes | bytearray) -> bool:
    return crc16_modbus(data[:-_CRC_LENGTH]) == int.from_bytes(data[-_CRC_LENGTH:], "little")


class PushStream:
    """Finds pushed frames in a byte stream; what it finds does not depend on how the stream is cut.

    Nothing marks where a frame begins, and one stretch of six bytes in 65536 ends in its own CRC by chance. So frames
    count only once ``FRAMES_TO_LOCK`` of them stood one behind the other, and at one place only: a stream that repeats
    itself, as that of a sensor at rest, can look like frames at two. One wrong CRC, and the search begins anew.
    ``crc_errors`` counts those, ``discarded_bytes`` all that belongs to no frame handed out.
    """

    def __init__(self) -> None:
        self.discarded_bytes = 0
        self.crc_errors = 0
        self._buffer = bytearray()
        self._locked = False
        self._searched = 0  # bytes looked at since the search began
        self._in_a_row = [0] * FRAME_LENGTH  # frames so far at each of the places where frames could end

    @property
    def pending_bytes(self) -> int:
        """How many bytes were fed after the last complete frame."""
        return len(self._buffer)

    @property
    def locked(self) -> bool:
        """Whether it is known where frames begin."""
        return self._locked

    def feed(self, data: bytes) -> list[PushFrame]:
        """The frames completed by ``data``, oldest first. Never raises."""
        frames: list[PushFrame] = []
        for byte in data:
            self._buffer.append(byte)
            if not self._locked:
                self._search()
            elif len(self._buffer) == FRAME_LENGTH:
                self._take(frames)
        return frames

    def _take(self, frames: list[PushFrame]) -> None:
        try:
            frames.append(PushFrame.decode(self._buffer))
        except CodecError:
            self.crc_errors += 1
            self._locked = False
            self._searched, self._in_a_row = 0, [0] * FRAME_LENGTH
            self._discard(len(self._buffer))
        else:
            self._buffer.clear()

    def _search(self) -> None:
        """Look whether the last six bytes are a frame, and whether frames stand in a row there and nowhere else."""
        if len(self._buffer) > FRAME_LENGTH:
            self._discard(1)
        if len(self._buffer) < FRAME_LENGTH:
            return
        self._searched += 1
        place = self._searched % FRAME_LENGTH
        result = _is_frame(self._buffer)
        self._in_a_row[place] = self._in_a_row[place] + 1 if result else 0
        if self._in_a_row[place] >= FRAMES_TO_LOCK and self._in_a_row.count(0) == FRAME_LENGTH - 1:
            self._locked = True
            self._discard(len(self._buffer))

    def _discard(self, count: int) -> None:
        self.discarded_bytes += count
        del self._buffer[:count]
