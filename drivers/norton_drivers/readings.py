"""What devices say, in SI units and the bench's own signs, each with its arrival time and sequence number.

A reading is made once for each message that arrived; a repeated value in a new message is a new reading with the
next sequence number, and a reading is never handed out twice. Where no message means that nothing has changed, the
driver says the last value again, later, with the same number. What is made thousands of times a second is a named
tuple, at a third of a frozen dataclass's cost.
"""

from dataclasses import dataclass
from enum import Enum
from math import nan
from typing import Generic, NamedTuple, TypeVar


class MotionReading(NamedTuple):
    """Shaft position and velocity from a drive's encoder; ``device_ns`` as in :class:`TorqueReading`."""

    sequence: int
    arrival_ns: int
    position_rad: float
    velocity_rad_s: float
    device_ns: int | None = None


class CurrentReading(NamedTuple):
    """Measured torque-producing current of a drive; ``device_ns`` as in :class:`TorqueReading`."""

    sequence: int
    arrival_ns: int
    current_a: float
    device_ns: int | None = None


class TorqueReading(NamedTuple):
    """Torque that the actuator exerts on the load, at the port.

    ``device_ns`` is the device's own clock where it sends one (unwrapped, its epoch arbitrary), and for a device that
    has to be asked the instant of the question, from which its measurement is a constant time away; else None.
    """

    sequence: int
    arrival_ns: int
    torque_nm: float
    device_ns: int | None = None
    valid: bool = True


class TemperatureReading(NamedTuple):
    """Temperature at the place of a probe."""

    sequence: int
    arrival_ns: int
    temperature_c: float


class DriveState(Enum):
    """The state of a drive, whatever its maker calls it."""

    UNKNOWN = "unknown"
    IDLE = "idle"
    ENABLED = "enabled"
    FAULT = "fault"


class DriveStatus(NamedTuple):
    """What a drive reports of itself now and then: state, errors, temperatures, supply voltage."""

    state: DriveState
    heartbeat_ns: int | None = None  # arrival of the last heartbeat
    errors: tuple[str, ...] = ()  # in words
    transistor_temperature_c: float = nan
    motor_temperature_c: float = nan
    bus_voltage_v: float = nan


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """What a device says it is."""

    driver: str
    address: str  # e.g. "can0 node 1" or "/dev/ttyUSB0"
    hardware: str = ""
    firmware: str = ""

    @property
    def words(self) -> str:
        """ "odrive, can0 node 1, hardware 4.4.58, firmware 0.6.10"; what it does not say is left out."""
        hardware = f"hardware {self.hardware}" if self.hardware else ""
        firmware = f"firmware {self.firmware}" if self.firmware else ""
        return ", ".join(filter(None, (self.driver, self.address, hardware, firmware)))


# Marks a CAN error frame in its identifier (Linux, include/uapi/linux/can.h: CAN_ERR_FLAG). Serial bytes have -1 there,
# in which every bit is set: look for those first.
ERROR_FRAME = 0x20000000


class RawFrame(NamedTuple):
    """One CAN frame or one chunk of serial bytes as it crossed the wire, for the recording.

    ``fd``: a CAN FD frame; ``switched``: its data went at the bus's second bit rate.
    """

    stamp_ns: int
    channel: str
    sent: bool
    data: bytes
    arbitration_id: int = -1  # -1: serial bytes
    extended: bool = False
    remote: bool = False
    fd: bool = False
    switched: bool = False


Reading = TypeVar("Reading")

# Ten seconds at 1 kHz. Nobody may be taking, and memory must not grow; a loss shows as a gap in the sequence.
CAPACITY = 10_000


class Inbox(Generic[Reading]):
    """Where a driver keeps its readings until they are taken.

    Readings in the order of their arrival, each handed out once; ``count`` is how many were ever put.
    """

    def __init__(self) -> None:
        self.count = 0
        self._waiting: list[Reading] = []

    def put(self, reading: Reading) -> None:
        self.count += 1
        if len(self._waiting) >= CAPACITY:
            del self._waiting[0]
        self._waiting.append(reading)

    def take(self) -> list[Reading]:
        """What was put since the last call."""
        taken, self._waiting = self._waiting, []
        return taken


class Unwrapped:
    """Unwraps a position that starts again after a turn or at the end of its range.

    Follows a reading that comes modulo ``span``, in the reading's own steps; ``total`` is where it has got to.
    """

    def __init__(self, span: int) -> None:
        self._span = span
        self._last: int | None = None
        self.total = 0

    def follow(self, reading: int, expected_change: float = 0.0) -> int:
        """The new total: of all that agree with ``reading``, the one nearest to the ``expected_change``."""
        if self._last is None:
            self.total = reading
        else:
            change = reading - self._last
            self.total += change + self._span * round((expected_change - change) / self._span)
        self._last = reading
        return self.total
