"""Frames of the Turnwell T1 (11-bit identifiers, little-endian), both ways. No ports, no clock.

To the drive: COMMAND (u8 mode, u8 zero, i16 torque [mN m]) and CLEAR (empty). From the drive: MOTION (i32 position
[turn/65536], i16 velocity [0.1 rad/s], i16 current [10 mA]) every millisecond, and STATE (u8 state, u8 error, u8
firmware) every fiftieth of a second. A drive that hears no COMMAND for a tenth of a second lets go of its motor.
"""

import struct
from math import isfinite, tau
from typing import NamedTuple

COMMAND, MOTION, STATE, CLEAR = 0x100, 0x180, 0x200, 0x280  # and the node below
IDLE, TORQUE, FAILED = 0, 1, 2
NODE_MAX = 127
TORQUE_MAX_NM = 32.767
ERRORS = {0: "", 1: "watchdog: no command for 100 ms", 2: "supply voltage too low", 3: "too hot"}

_COMMAND = struct.Struct("<BBh")
_MOTION = struct.Struct("<ihh")
_STATE = struct.Struct("<BBB")


class Motion(NamedTuple):
    position_rad: float
    velocity_rad_s: float
    current_a: float


class State(NamedTuple):
    state: int
    error: int
    firmware: int


def command(mode: int, torque_nm: float) -> bytes:
    """Raises ValueError for a torque that the frame cannot carry."""
    if not (isfinite(torque_nm) and abs(torque_nm) <= TORQUE_MAX_NM):
        raise ValueError(f"a torque of {torque_nm} N m cannot be sent")
    return _COMMAND.pack(mode, 0, round(torque_nm * 1e3))


def command_of(data: bytes) -> tuple[int, float]:
    """Mode and torque [N m]. Raises struct.error for another length."""
    mode, _, torque_mnm = _COMMAND.unpack(data)
    return mode, torque_mnm * 1e-3


def motion(value: Motion) -> bytes:
    return _MOTION.pack(
        round(value.position_rad / tau * 65536), round(value.velocity_rad_s * 10), round(value.current_a * 100)
    )


def motion_of(data: bytes) -> Motion:
    """Raises struct.error for another length."""
    position, velocity, current = _MOTION.unpack(data)
    return Motion(position / 65536 * tau, velocity * 0.1, current * 0.01)


def state(value: State) -> bytes:
    return _STATE.pack(*value)


def state_of(data: bytes) -> State:
    """Raises struct.error for another length."""
    return State(*_STATE.unpack(data))
