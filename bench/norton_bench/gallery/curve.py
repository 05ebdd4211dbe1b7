"""Torque against position along a slow way there and back, in whose mean friction cancels."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.records import Measured, SegmentInfo

# Torque is read where the way passes through this much on either side of a position; a zero by so much of the curve.
WINDOW_RAD, CLOSE_RAD = 0.05, 0.15
# Readings in one mean.
READINGS = 10


@dataclass(frozen=True)
class Curve:
    """The means of both directions, arrays of shape (points,)."""

    position_rad: FloatArray
    torque_nm: FloatArray

    def at(self, position_rad: float) -> float:
        """By a parabola through what lies within the window [N m]: the curve bends."""
        near = np.abs(self.position_rad - position_rad) <= WINDOW_RAD
        return float(np.polyfit(self.position_rad[near] - position_rad, self.torque_nm[near], 2)[-1])

    def zero_rad(self, near_rad: float) -> float:
        """Where the torque is zero, by a cubic through what lies about it."""
        near = np.abs(self.position_rad - near_rad) <= CLOSE_RAD
        return float(np.polyfit(self.torque_nm[near], self.position_rad[near], 3)[-1])

    def minus(self, other: "Curve") -> "Curve":
        """The difference in torque, at positions that both have."""
        low = max(self.position_rad[0], other.position_rad[0])
        high = min(self.position_rad[-1], other.position_rad[-1])
        position = self.position_rad[(self.position_rad >= low) & (self.position_rad <= high)]
        torque, others = (np.interp(position, each.position_rad, each.torque_nm) for each in (self, other))
        return Curve(position, torque - others)

    def mirrored(self, other: "Curve") -> "Curve":
        """Half the difference to what was done in reverse: the same without the zero of the sensor."""
        difference = self.minus(Curve(-other.position_rad[::-1], other.torque_nm[::-1]))
        return Curve(difference.position_rad, 0.5 * difference.torque_nm)


def read_torque(measured: Measured, segment: SegmentInfo) -> tuple[FloatArray, FloatArray]:
    """Positions and torque of one way as the sensor read it, in means, by increasing position."""
    inside = measured.between(segment.start_ns, segment.end_ns)
    torque = inside.torque[inside.torque["valid"]]
    position = np.interp(torque["arrival_ns"], inside.motion["arrival_ns"], inside.motion["position_rad"])
    return in_means(position, torque["torque_nm"])


def sent_torque(measured: Measured, segment: SegmentInfo) -> tuple[FloatArray, FloatArray]:
    """Positions and torque of one way as it was commanded of the load, in means, by increasing position."""
    inside = measured.between(segment.start_ns, segment.end_ns)
    position = np.interp(inside.ticks["tick_ns"], inside.motion["arrival_ns"], inside.motion["position_rad"])
    return in_means(position, inside.ticks["load_torque_nm"])


def in_means(position_rad: npt.ArrayLike, torque_nm: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Both (readings,) in means of READINGS neighbours, by increasing position."""
    order = np.argsort(position_rad)
    whole = READINGS * (order.size // READINGS)
    position, torque = (
        np.asarray(values)[order][:whole].reshape(-1, READINGS).mean(axis=1) for values in (position_rad, torque_nm)
    )
    return position, torque


def there_and_back(there: tuple[FloatArray, FloatArray], back: tuple[FloatArray, FloatArray]) -> Curve:
    """The mean of two ways, each with its positions and torque, where both have been."""
    low = max(float(way[0][0]) for way in (there, back))
    high = min(float(way[0][-1]) for way in (there, back))
    position = np.linspace(low, high, 400)
    return Curve(position, np.mean([np.interp(position, *way) for way in (there, back)], axis=0))
