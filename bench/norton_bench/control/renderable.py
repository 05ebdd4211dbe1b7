"""Which laws a bench can render: the least damping that a virtual body of some mass and stiffness needs."""

from dataclasses import dataclass
from math import floor, log10, nan

from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.rendering import rendering_is_stable, rounded
from norton_bench.segments import Admittance

# Of the overview: masses over the load's own inertia, and stiffnesses over that of the sensor, to a power of ten.
MASSES = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
STIFFNESSES = (0.0, 1e-3, 1e-2, 1e-1)
# Dampings are tried by doubling, to this many times one that stops the load within a tick and from so far below; then
# nearer to the greatest that is too little, by halves.
STRONGEST, DOUBLINGS, HALVINGS = 16.0, 18, 4


@dataclass(frozen=True)
class Overview:
    """``least_nms_rad[row][column]`` is the least damping beside a mass and a stiffness, NaN where none will do."""

    masses_kgm2: tuple[float, ...]
    stiffnesses_nm_rad: tuple[float, ...]
    least_nms_rad: tuple[tuple[float, ...], ...]


def overview(calibration: LoadCalibration, tick_s: float) -> Overview:
    """Of masses and stiffnesses that suit the bench; takes some ten seconds.

    Raises ExperimentError where no feedback follows any motion.
    """
    masses = tuple(rounded(share * calibration.inertia_kgm2) for share in MASSES)
    decade = 10.0 ** floor(log10(calibration.sensor_stiffness_nm_rad))
    stiffnesses = tuple(share * decade for share in STIFFNESSES)
    rows = tuple(tuple(least_damping(calibration, tick_s, mass, each) for each in stiffnesses) for mass in masses)
    return Overview(masses, stiffnesses, rows)


def least_damping(
    calibration: LoadCalibration, tick_s: float, mass_kgm2: float, stiffness_nm_rad: float = 0.0
) -> float:
    """The least damping [N m s/rad] with which the bench can render a body; 0 where it needs none, NaN where none
    that was tried will do.

    More damping makes a law more like a prescribed motion, which the bench follows.
    Raises ExperimentError as :func:`overview`.
    """

    def can(damping_nms_rad: float) -> bool:
        return rendering_is_stable(calibration, tick_s, Admittance(mass_kgm2, damping_nms_rad, stiffness_nm_rad))

    if can(0.0):
        return 0.0
    strongest = STRONGEST * calibration.inertia_kgm2 / tick_s
    tried = [rounded(strongest * 2.0 ** (power - DOUBLINGS)) for power in range(DOUBLINGS + 1)]
    enough = next((each for each in tried if can(each)), None)
    if enough is None:
        return nan
    too_little = 0.5 * enough
    for _ in range(HALVINGS):
        middle = rounded((too_little * enough) ** 0.5)
        too_little, enough = (too_little, middle) if can(middle) else (middle, enough)
    return enough
