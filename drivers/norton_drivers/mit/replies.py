"""What a motor's replies tell: where its shaft is, and, on a bus with others, that it is one in MIT mode."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs.mit import POSITION_CODES, VELOCITY_CODES, Ranges, Reply, Special
from norton_drivers.readings import RawFrame, Unwrapped
from norton_drivers.registry import Question, Recognised, nobodys

_ENDS = (0, POSITION_CODES - 1)
_STANDS_STILL_CODES = 8  # further than this a moving shaft gets from one code


class OutOfRangeError(ValueError):
    """Codes that stand for no position or velocity; the text says why, and the remedy."""


class MitShaft:
    """In the drive's own sense."""

    def __init__(self, ranges: Ranges, *, wraps: bool) -> None:
        self._ranges = ranges
        self._wraps = wraps
        self._followed = Unwrapped(POSITION_CODES)
        self._last: tuple[int, int, int] | None = None  # arrival [ns], position and velocity code

    def forget(self) -> None:
        """What was seen so far does not count against what comes."""
        self._last = None

    def follow(self, position_code: int, velocity_code: int, arrival_ns: int) -> tuple[float, float]:
        """Position [rad] and velocity [rad/s]. Raises OutOfRangeError."""
        expected = self._expected_codes(velocity_code, arrival_ns)
        if self._last is not None:
            self._check(position_code, velocity_code, self._last, expected)
        elif not self._wraps and position_code in _ENDS:
            raise self._at_the_end()
        self._last = arrival_ns, position_code, velocity_code
        total = self._followed.follow(position_code, expected)
        return self._ranges.position_of(total), self._ranges.velocity_of(velocity_code)

    def _expected_codes(self, velocity_code: int, arrival_ns: int) -> float:
        """By how much the position should have changed since the last reply."""
        if self._last is None:
            return 0.0
        last_ns, _, last_velocity = self._last
        mean_rad_s = self._ranges.velocity_of(velocity_code) + self._ranges.velocity_of(last_velocity)
        return 0.5 * mean_rad_s * (arrival_ns - last_ns) * 1e-9 / self._ranges.position_step_rad

    def _check(self, position_code: int, velocity_code: int, last: tuple[int, int, int], expected: float) -> None:
        _, last_position, last_velocity = last
        if abs(velocity_code - last_velocity) > VELOCITY_CODES // 2:
            raise OutOfRangeError(
                f"the velocity left its range of ±{self._ranges.velocity_rad_s:g} rad/s; "
                "set [limits] velocity below velocity_range"
            )
        at_end = position_code in _ENDS
        stuck = at_end and position_code == last_position and abs(expected) > _STANDS_STILL_CODES
        if stuck or (not self._wraps and (at_end or abs(position_code - last_position) > POSITION_CODES // 2)):
            raise self._at_the_end()

    def _at_the_end(self) -> OutOfRangeError:
        mend = 'set beyond_range = "saturates"' if self._wraps else "limit [limits] position, or set the drive's zero"
        return OutOfRangeError(f"the position is at the end of its range of ±{self._ranges.position_rad:g} rad; {mend}")


_DEVICE = "an actuator in MIT mode"
_REPLY_LENGTHS = (6, 7, 8)
# How far from the middle of their ranges velocity and torque of a motor that stands still may be; both have 12 bits.
_REST_VELOCITY_CODES, _REST_TORQUE_CODES = 16, 64
_PROBED_MAX = 0x7F  # identifiers above are others': SYNC, emergencies, process data


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """A reply under the master's identifier, whose first byte is the motor's; or one to another master, at rest."""
    if message.is_extended_id or message.is_remote_frame or message.dlc not in _REPLY_LENGTHS:
        return None
    reply, master = Reply.decode(message.data), message.arbitration_id
    if master == options.get("master", 0):
        return Recognised(_DEVICE, "reply", {"node": reply.node})
    return Recognised(_DEVICE, "reply", {"node": reply.node, "master": master}) if _rests(reply) else None


def _rests(reply: Reply) -> bool:
    """As hardly any frame of another device looks by chance."""
    middle = VELOCITY_CODES // 2
    velocity, torque = abs(reply.velocity_code - middle), abs(reply.torque_code - middle)
    return velocity <= _REST_VELOCITY_CODES and torque <= _REST_TORQUE_CODES


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """Every frame to a motor is answered with its own identifier in front."""
    return (
        len(question.data) == 8
        and len(frame.data) in _REPLY_LENGTHS
        and not (question.extended or question.remote or frame.extended or frame.remote)
        and frame.data[0] == question.arbitration_id
    )


def probes(options: Mapping[str, Any], heard: Collection[int]) -> Iterator[Question]:
    """Every motor is told to be disabled, which it answers; identifiers near those of others are left alone."""
    others = set(heard) - {options.get("master", 0)}
    for node in range(1, _PROBED_MAX + 1):
        if nobodys(node, others):
            yield Question(node, Special.DISABLE.encode())
