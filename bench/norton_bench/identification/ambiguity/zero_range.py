"""Backlash as the port shows it: a range of displacement in which it exerts nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import t as t_distribution

from norton_bench.arrays import FloatArray
from norton_bench.identification.aligned import Aligned
from norton_bench.records import SegmentInfo

# Torque within this many deviations of its noise, or this share of the loop's greatest, counts as next to none.
DEVIATIONS, SHARE = 3.0, 0.02
LEAST_STROKES = 4


@dataclass(frozen=True)
class ZeroRange:
    """The mean width over all strokes, and its 95 % interval (Student's, of the scatter between strokes).

    ``crossing_rad`` is how far the port moves through zero at the slope that it has beside it: what is no wider than
    that is no gap, but a curve.
    """

    width_rad: float
    interval_rad: tuple[float, float]
    crossing_rad: float
    strokes: int

    @property
    def is_gap(self) -> bool:
        return self.interval_rad[0] > self.crossing_rad


def zero_range(
    stretches: Sequence[Aligned],
    segments: Sequence[SegmentInfo],
    *,
    inertia_kgm2: float,
    bias_nm: float,
    noise_nm: float,
) -> ZeroRange | None:
    """From the imposed loops; None where there are too few strokes that go through zero.

    Torque is freed of the sensor's zero, ``bias_nm``, and of what the actuator's own inertia takes. A curve that
    crosses zero stays within ± T as long as it takes from T to 2 T on both sides together; a gap comes on top of that.
    """
    loops = {each.index for each in segments if each.procedure == "imposed" and each.name.startswith("loop")}
    found: list[tuple[float, float]] = []
    for stretch in stretches:
        torque_nm = stretch.torque_nm - bias_nm + inertia_kgm2 * stretch.acceleration_rad_s2
        for stroke in _strokes(stretch, loops):
            found += _ways(torque_nm[stroke], stretch.velocity_rad_s[stroke] * stretch.signals.tick_s, noise_nm)
    if len(found) < LEAST_STROKES:
        return None
    near, beside = np.array(found).T
    widths = near - beside
    mean, deviation = float(np.mean(widths)), float(np.std(widths, ddof=1) / np.sqrt(len(widths)))
    half = float(t_distribution.ppf(0.975, len(widths) - 1)) * deviation
    return ZeroRange(
        max(mean, 0.0), (max(mean - half, 0.0), max(mean + half, 0.0)), float(np.mean(beside)), len(widths)
    )


def _strokes(stretch: Aligned, loops: set[int]) -> Iterator[slice]:
    """From one turning point of a loop to the next."""
    for index in sorted(loops):
        inside = np.flatnonzero((stretch.signals.segment == index) & stretch.usable)
        if inside.size:
            turns = np.flatnonzero(np.diff(np.sign(stretch.velocity_rad_s[inside])) != 0) + 1
            edges = inside[0] + turns
            yield from (slice(int(first), int(last)) for first, last in pairwise(edges))


def _ways(torque_nm: FloatArray, way_rad: FloatArray, noise_nm: float) -> list[tuple[float, float]]:
    """The way within ± T of zero, and that from there to 2 T; nothing where the stroke does not go well through it."""
    limit_nm = max(DEVIATIONS * noise_nm, SHARE * float(np.max(np.abs(torque_nm))))
    if not (torque_nm.max() > 2 * limit_nm and torque_nm.min() < -2 * limit_nm):
        return []
    size = np.abs(torque_nm)
    near, beside = size <= limit_nm, (size > limit_nm) & (size <= 2 * limit_nm)
    return [(float(abs(way_rad[near].sum())), float(abs(way_rad[beside].sum())))]
