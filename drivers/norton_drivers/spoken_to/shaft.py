"""Where the shaft of a motor is that tells integers scaled to a range."""

from norton_drivers.codecs.ranges import POSITION_CODES, Ranges
from norton_drivers.readings import Unwrapped

_ENDS = (0, POSITION_CODES - 1)
_STANDS_STILL_CODES = 8  # further than this a moving shaft gets from one code


class OutOfRangeError(ValueError):
    """Codes that stand for no position or velocity; the text says why, and the remedy."""


class RangedShaft:
    """In the drive's own sense. ``wraps`` says what its position does at the end of its range."""

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
        if abs(velocity_code - last_velocity) > self._ranges.short_codes // 2:
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
