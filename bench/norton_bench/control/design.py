"""Gains from the calibration: the greatest that keep their stability margins on every bench within its errors.

The actuator is not known before it has been identified, so its inertia and its friction are searched over a range about
what the load's own calibration makes likely; where it sticks it is a spring, and at worst a wall.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain, product
from math import ceil, inf, sqrt

from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.observer import Noise, Observer, design_observer, holds_at_any_age
from norton_bench.control.regulator import Regulator, SampledBench, design_regulator
from norton_bench.control.robustness import Control, margins, torque_control, tracking_control
from norton_bench.errors import ExperimentError

# Peak sensitivity allowed on every bench considered: 2 is a gain margin of 2 and a phase margin of 29° at least.
TORQUE_SENSITIVITY = 2.2
TRACKING_SENSITIVITY = 3.5
GAIN_ERROR, STIFFNESS_ERROR, DELAY_ERROR_TICKS = 0.1, 0.2, 0.5
# The actuator's inertia over the load's where nothing is known of it, and over its first estimate.
UNKNOWN_INERTIA, ESTIMATED_INERTIA = (0.125, 2.0), (0.7, 1.4)
STICKING = (0.5, 1.0, 2.0)  # the actuator's friction contact over the load's, where nothing is known of it
# And over its own first estimate: two deviations of `calibrate`'s WELL_KNOWN, to either side.
STICKING_AS_KNOWN = (0.7, 1.0, 1.4)
INTEGRAL_TIMES_S = (1e-3, 2e-3, 3e-3)  # proportional over integral gain
DAMPING_RATES_RAD_S = (200.0, 100.0, 0.0)  # D over the load's inertia
# A cycle between two stuck contacts may grow by this factor a tick: their hysteresis, which no linear model has, holds
# it below the sensor's noise.
GROWTH = 1.004
MOST_BOOST = 4.0
LEAST_INTEGRAL_PER_S = 3.0
DOUBTS = tuple(2.0**power for power in range(1, 9))  # deviation taken for the encoders, in counts
EFFORTS = tuple(0.5 * 2.0**step for step in range(8))  # see `design_regulator`; the stiffest first
# The actuator's inertia is taken for so many times the likely one.
HEAVIER = (1.0, 2.0, 4.0)
# Where none of those keeps its margins: observers that go by the encoders, and hardly by the torque reading. It is what
# shows the sensor's resonance, which a softer sensor has at frequencies that the loop still acts upon.
DISTRUSTS = (5.0, 25.0, 125.0)
# And where not even those do: gains that fall, to next to nothing. The shaft then follows by what is fed
# forward, and strays by what that is off.
GENTLE_EFFORTS = tuple(EFFORTS[-1] * 2.0**step for step in range(1, 9))
WALL = 50.0  # an inertia so many times the load's does not move


@dataclass(frozen=True)
class TorqueGains:
    """u = P τ + I ∫ τ dt − D ω while the contacts stick; ``boost`` times P and I, and no D, while they slide.

    ``boost`` is below one where the damping is what keeps the loop from swinging on the sensor's spring.
    """

    proportional: float
    integral_per_s: float
    boost: float
    damping_nms_rad: float


@dataclass(frozen=True)
class Tracking:
    """Observer and regulator of prescribed motion.

    ``gentler`` is by what factor its command may change more slowly for an error than with the gentlest usual gains;
    1 where those were kept to.
    """

    observer: Observer
    regulator: Regulator
    gentler: float = 1.0


def nominal_bench(calibration: LoadCalibration, tick_s: float) -> SampledBench:
    """The bench as calibrated; readings are half a tick old on average when a tick sees them."""
    c = calibration
    low, high = actuator_inertias(c)
    return SampledBench(
        gain=c.torque_gain,
        bandwidth_rad_s=c.amplifier_bandwidth_rad_s,
        load_inertia_kgm2=c.inertia_kgm2,
        actuator_inertia_kgm2=c.actuator_inertia_kgm2 or sqrt(low * high),
        stiffness_nm_rad=c.sensor_stiffness_nm_rad,
        damping_nms_rad=c.sensor_damping_nms_rad,
        command_delay_s=c.drive_delay_s,
        torque_delay_s=c.torque_delay_s + 0.5 * tick_s,
        position_delay_s=c.position_delay_s + 0.5 * tick_s,
    )


def sliding_benches(calibration: LoadCalibration, tick_s: float) -> Iterator[SampledBench]:
    """Both contacts slide; the actuator's inertia is not well known."""
    bench = nominal_bench(calibration, tick_s)
    return of_inertias(bench, _likely_inertias(calibration, bench), tick_s)


def unevenly_read(calibration: LoadCalibration, tick_s: float) -> Iterator[SampledBench]:
    """One encoder's readings are older than the other's, though they arrive at the same time: the shaft then seems
    twisted in proportion to its velocity, which acts as a damper, or as a negative one.

    Of readings that are due about when a tick looks, only those that travelled quickly have come. The mean age of what
    ticks see is off by up to 0.43 standard deviations of the travel time then (for uniform delays; 0.4 for normal
    ones), either way, and for each encoder by itself: their difference is within one standard deviation.
    """
    bench, jitter_s = nominal_bench(calibration, tick_s), calibration.position_jitter_s
    if jitter_s > 0.0:
        for inertia_kgm2, difference_s in product(_likely_inertias(calibration, bench), (jitter_s, -jitter_s)):
            yield replace(bench, actuator_inertia_kgm2=inertia_kgm2, age_difference_s=difference_s)


def sticking_benches(calibration: LoadCalibration, tick_s: float) -> Iterator[SampledBench]:
    """The actuator's contact sticks: it is a spring, and so is the load's or not."""
    c, bench = calibration, nominal_bench(calibration, tick_s)
    contact, factors = (c, STICKING) if c.actuator_friction is None else (c.actuator_friction, STICKING_AS_KNOWN)
    for factor in factors:
        stuck = replace(
            bench,
            actuator_spring_nm_rad=factor * contact.presliding_stiffness_nm_rad,
            actuator_damper_nms_rad=factor * contact.presliding_damping_nms_rad,
        )
        yield stuck
        yield replace(
            stuck, load_spring_nm_rad=c.presliding_stiffness_nm_rad, load_damper_nms_rad=c.presliding_damping_nms_rad
        )


def walls(calibration: LoadCalibration, tick_s: float) -> Iterator[SampledBench]:
    """The actuator does not move at all: the command's whole torque is seen, the most that the plant's gain can be."""
    wall = replace(nominal_bench(calibration, tick_s), actuator_inertia_kgm2=WALL * calibration.inertia_kgm2)
    for bench in miscalibrated(wall, tick_s):
        yield bench.with_damping(1.0)


def design_torque_loop(calibration: LoadCalibration, observer: Observer, tick_s: float) -> TorqueGains:
    """The greatest integral gain with margins. Raises ExperimentError where there is none."""
    result = _torque_gains(calibration, observer, tick_s)
    if result is None:

        def works(better: LoadCalibration) -> bool:
            tracking = _tracking(better, tick_s)
            return tracking is not None and _torque_gains(better, tracking.observer, tick_s) is not None

        raise ExperimentError(f"zero torque: no feedback keeps its margins on this bench; {_mend(calibration, works)}")
    return result


def _torque_gains(calibration: LoadCalibration, observer: Observer, tick_s: float) -> TorqueGains | None:
    sliding, still = tuple(sliding_benches(calibration, tick_s)), tuple(walls(calibration, tick_s))
    stuck = tuple(bench for bench in sticking_benches(calibration, tick_s) if bench.load_spring_nm_rad > 0)

    def control(integral: float, time_s: float, damping: float) -> Control:
        return torque_control(observer, integral * time_s, integral, damping, tick_s)

    def sticks(integral: float, time_s: float, damping: float) -> bool:
        loop = control(integral, time_s, damping)
        return all(margins(bench, loop, tick_s).radius < GROWTH for bench in stuck) and holds(
            loop, still + sliding, TORQUE_SENSITIVITY, tick_s
        )

    def slides(integral: float, time_s: float) -> bool:
        return holds(control(integral, time_s, 0.0), sliding, TORQUE_SENSITIVITY, tick_s)

    integral, time_s, damping = 0.0, 0.0, 0.0
    for shape in product(INTEGRAL_TIMES_S, (rate * calibration.inertia_kgm2 for rate in DAMPING_RATES_RAD_S)):
        # Searched only where it beats the best so far.
        result = _greatest(
            partial(sticks, time_s=shape[0], damping=shape[1]), max(1.05 * integral, LEAST_INTEGRAL_PER_S), 3000.0
        )
        if result:
            integral, (time_s, damping) = result, shape
    if integral == 0.0:
        return None
    bold = partial(slides, time_s=time_s)
    boosted = _greatest(bold, integral, MOST_BOOST * integral) or _greatest(bold, LEAST_INTEGRAL_PER_S, integral)
    return TorqueGains(integral * time_s, integral, boosted / integral, damping) if boosted else None


def design_tracking(calibration: LoadCalibration, tick_s: float) -> Tracking:
    """The stiffest regulator with margins, or else the one with the best margins of all that are stable throughout.

    A controller that takes the actuator for heavier than it is forgives more: where the likely inertia gives no
    margins, heavier ones are tried; then observers that trust the torque reading less, and gentler gains at last.
    Raises ExperimentError where none is stable throughout.
    """
    result = _tracking(calibration, tick_s)
    if result is None:
        mend = _mend(calibration, lambda better: _tracking(better, tick_s) is not None)
        raise ExperimentError(f"prescribed motion: no feedback, however gentle, is stable on this bench; {mend}")
    return result


def _tracking(calibration: LoadCalibration, tick_s: float) -> Tracking | None:
    benches = (
        *sliding_benches(calibration, tick_s),
        *unevenly_read(calibration, tick_s),
        *sticking_benches(calibration, tick_s),
    )
    best, least = None, inf
    for candidate in _candidates(calibration, tick_s):
        sensitivity = _worst(tracking_control(candidate.observer, candidate.regulator), benches, least, tick_s)
        if sensitivity < least:
            best, least = candidate, sensitivity
        if sensitivity <= TRACKING_SENSITIVITY:
            break
    return best


def _mend(calibration: LoadCalibration, works: Callable[[LoadCalibration], bool]) -> str:
    """What would have to be better of the bench, each by itself and by so much that it no longer counts."""
    c = calibration
    delay_ms = 1e3 * (c.drive_delay_s + c.torque_delay_s)
    betters = (
        (f"a shorter delay from command to torque ({delay_ms:.2f} ms)", replace(c, command_delay_s=-c.shift_s)),
        (
            f"finer counts of the encoders ({1e3 * c.position_resolution_rad:.2g} mrad)",
            replace(c, position_resolution_rad=c.position_resolution_rad / 16),
        ),
        (
            f"a quieter torque sensor ({1e3 * c.torque_noise_nm:.2g} mN m a reading)",
            replace(c, torque_noise_nm=c.torque_noise_nm / 16),
        ),
        (
            f"a softer torque sensor ({c.sensor_stiffness_nm_rad:.3g} N m/rad)",
            replace(c, sensor_stiffness_nm_rad=c.sensor_stiffness_nm_rad / 4),
        ),
    )
    helpful = [words for words, better in betters if works(better)]
    if not helpful:
        return "the calibration itself may be wrong: run 'calibrate' again, for longer"
    return f"it would take {' or '.join(helpful)}"


def _candidates(calibration: LoadCalibration, tick_s: float) -> Iterator[Tracking]:
    """The usual ones first; of the others the stiffest first, whichever observer it takes."""
    nominal = nominal_bench(calibration, tick_s)

    @cache
    def seen(heavier: float, distrust: float) -> tuple[SampledBench, Observer | None]:
        bench = replace(nominal, actuator_inertia_kgm2=heavier * nominal.actuator_inertia_kgm2)
        return bench, _observer(calibration, bench, tick_s, distrust)

    trusting, distrusting = tuple(product(HEAVIER, (1.0,))), tuple(product((1.0,), DISTRUSTS))
    usual = ((effort, kind) for kind in trusting for effort in EFFORTS)
    for effort, kind in chain(usual, product(EFFORTS, distrusting), product(GENTLE_EFFORTS, trusting + distrusting)):
        bench, observer = seen(*kind)
        if observer is not None:
            yield Tracking(observer, design_regulator(bench, effort, tick_s), max(effort / EFFORTS[-1], 1.0))


def _observer(calibration: LoadCalibration, bench: SampledBench, tick_s: float, distrust: float) -> Observer | None:
    """The quickest that holds for readings of any age; None where none does."""
    torque_nm = doubted_torque_nm(calibration)
    free_rad_s2 = 100 * torque_nm / bench.actuator_inertia_kgm2  # per root second
    for doubt in DOUBTS:
        walks = (free_rad_s2, free_rad_s2, 30 * torque_nm)
        observer = doubting_observer(calibration, bench, doubt, walks, tick_s, distrust)
        if holds_at_any_age(observer, bench, tick_s):
            return observer
    return None


def doubting_observer(
    calibration: LoadCalibration,
    bench: SampledBench,
    doubt: float,
    walks: tuple[float, float, float],
    tick_s: float,
    distrust: float = 1.0,
) -> Observer:
    """Takes the encoders for off by ``doubt`` counts, and the torque sensor for ``distrust`` times as noisy as it is.

    ``walks`` are the last three of :class:`Noise`.

    The sensor is damped artificially: a controller must not build on where its resonance is. Encoders are trusted less
    than they deserve, the less the stiffer the sensor: a twist of a few counts must not pass for torque.
    """
    position_rad = doubt * max(calibration.position_resolution_rad, 1e-9)
    noise = Noise(distrust * doubted_torque_nm(calibration), position_rad, *walks)
    return design_observer(bench.with_damping(1.0), noise, tick_s, past_ticks(calibration, tick_s))


def doubted_torque_nm(calibration: LoadCalibration) -> float:
    """The deviation that observers take a torque reading to have."""
    return max(3 * calibration.torque_noise_nm, 1e-6)


def past_ticks(calibration: LoadCalibration, tick_s: float) -> int:
    """How many past states an observer keeps: readings are as old as their delays, and up to a tick more."""
    return ceil(max(calibration.torque_delay_s, calibration.position_delay_s) / tick_s) + 2


def actuator_inertias(calibration: LoadCalibration) -> tuple[float, float]:
    """The least and the greatest that the actuator's may be [kg m²]."""
    estimate = calibration.actuator_inertia_kgm2
    base, (low, high) = (
        (calibration.inertia_kgm2, UNKNOWN_INERTIA) if estimate is None else (estimate, ESTIMATED_INERTIA)
    )
    return base * low, base * high


def _likely_inertias(calibration: LoadCalibration, bench: SampledBench) -> tuple[float, float, float]:
    """The actuator's: lightest, heaviest, nominal."""
    return (*actuator_inertias(calibration), bench.actuator_inertia_kgm2)


def of_inertias(bench: SampledBench, actuator_kgm2: Iterable[float], tick_s: float) -> Iterator[SampledBench]:
    """``bench`` with each of these inertias for the actuator's, as it may be calibrated."""
    for inertia_kgm2 in actuator_kgm2:
        yield from miscalibrated(replace(bench, actuator_inertia_kgm2=inertia_kgm2), tick_s)


def miscalibrated(bench: SampledBench, tick_s: float) -> Iterator[SampledBench]:
    """``bench``, and as it may be instead: see the errors named above."""
    late_s = DELAY_ERROR_TICKS * tick_s
    yield bench
    yield replace(bench, gain=bench.gain * (1 + GAIN_ERROR))
    yield replace(bench, command_delay_s=bench.command_delay_s + late_s)
    yield replace(bench, stiffness_nm_rad=bench.stiffness_nm_rad * (1 + STIFFNESS_ERROR))
    yield replace(bench, stiffness_nm_rad=bench.stiffness_nm_rad * (1 - STIFFNESS_ERROR))


def holds(control: Control, benches: Iterable[SampledBench], sensitivity: float, tick_s: float) -> bool:
    """Whether it keeps its margins on all of them."""
    return all(margins(bench, control, tick_s).within(sensitivity) for bench in benches)


def _worst(control: Control, benches: tuple[SampledBench, ...], least: float, tick_s: float) -> float:
    """The greatest peak sensitivity, infinite where it is unstable or beyond ``least`` anyhow."""
    worst = 0.0
    for bench in benches:
        result = margins(bench, control, tick_s)
        if not result.within(least) or result.radius >= 1.0:  # what is held to a path does not drift
            return inf
        worst = max(worst, result.sensitivity)
    return worst


def _greatest(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The greatest gain between ``low`` and ``high`` that holds, to 5 %; 0 where not even ``low`` does."""
    if not holds(low):
        return 0.0
    while high > 1.05 * low:
        middle = sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
