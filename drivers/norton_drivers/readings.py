"""What devices say, in SI units and the bench's own signs, each with its arrival time and sequence number.

A reading is made once for each message that arrived; a repeated value in a new message is a new reading with the
next sequence number, and a reading is never handed out twice. Where no message means that nothing has changed, the
driver says the last value again, later, with the same number. What is made thousands of times a second is a named
tuple, at a third of a frozen dataclass's cost.
"""

from dataclasses import dataclass
from enum import Enum
from math import nan
from typing import NamedTuple


class MotionReading(NamedTuple):
    """Shaft position and velocity from a drive's encoder."""

    sequence: int
    arrival_ns: int
    position_rad: float
    velocity_rad_s: float


class CurrentReading(NamedTuple):
    """Measured torque-producing current of a drive."""

    sequence: int
    arrival_ns: int
    current_a: float


class TorqueReading(NamedTuple):
    """Torque that the actuator exerts on the load, at the port.

    ``device_ns`` is the sensor's own clock where it sends one (unwrapped, its epoch arbitrary), and for a sensor that
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
    """Where a drive stands, whatever its maker calls it."""

    UNKNOWN = "unknown"
    IDLE = "idle"
    ENABLED = "enabled"
    FAULT = "fault"


class DriveStatus(NamedTuple):
    """The slow truth about a drive."""

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


# Marks a CAN error frame in its identifier (Linux, include/uapi/linux/can.h: CAN_ERR_FLAG). Serial bytes have -1 there,
# in which every bit is set: look for those first.
ERROR_FRAME = 0x20000000


class RawFrame(NamedTuple):
    """One CAN frame or one chunk of serial bytes as it crossed the wire, for the recording."""

    stamp_ns: int
    channel: str
    sent: bool
    data: bytes
    arbitration_id: int = -1  # -1: serial bytes
    extended: bool = False
    remote: bool = False
