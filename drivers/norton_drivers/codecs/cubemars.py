"""CubeMars' AK actuators in servo mode: what they send by themselves, for either end of the wire.

Commands are VESC's (:mod:`norton_drivers.codecs.vesc`): extended identifiers ``packet << 8 | id``, big-endian payloads.
The actuator sends one message, at a rate that is set in it: angle of the output in tenths of a degree, electrical
speed in tens of turns a minute, current in hundredths of an ampere, temperature, error. Sources: CubeMars, AK Series
Actuator Driver Manual V1.0.8, section 5.1 (commands), 5.2.1 (identifier 0x2900 + id; scales; that angles go to
±3200° and speeds to ±320000 turns a minute; errors are those of MIT mode); neurobionics/TMotorCANControl, servo_can.py.
"""

from struct import Struct
from typing import NamedTuple, Self

from norton_drivers.codecs.common import CodecError

UPLOAD = 0x29  # a packet, in VESC's words
UPLOADS_MAX_HZ = 500.0
NODE_MAX = 0xFD
POSITION_STEP_DEG = 0.1
POSITION_END_DEG = 3200.0
POSITION_SPAN = 1 << 16
ERPM_STEP = 10.0
CURRENT_STEP_A = 0.01

_UPLOAD = Struct(">hhhbB")
_I16 = (1 << 15) - 1


class Upload(NamedTuple):
    """What the actuator sends by itself. ``position`` is in steps of a tenth of a degree."""

    position: int
    erpm: float
    current_a: float
    temperature_c: int
    error: int

    def encode(self) -> bytes:
        """A position beyond 16 bits wraps; what else does not fit is held at the end of its range."""
        position = (self.position + _I16 + 1) % POSITION_SPAN - _I16 - 1
        erpm, current = (_cut(value) for value in (self.erpm / ERPM_STEP, self.current_a / CURRENT_STEP_A))
        return _UPLOAD.pack(position, erpm, current, self.temperature_c, self.error)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Raises CodecError for another length than 8."""
        if len(data) != _UPLOAD.size:
            raise CodecError(f"upload: {len(data)} bytes where 8 are sent")
        position, erpm, current, temperature, error = _UPLOAD.unpack(data)
        return cls(position, erpm * ERPM_STEP, current / 100, temperature, error)


def _cut(value: float) -> int:
    """An integer as C's cast makes it, held within its type."""
    return int(min(max(value, -_I16 - 1), _I16))
