"""Ringing of the two motors on the torque sensor's spring, found in the torque readings and subtracted from them.

Each step of a command, and friction at each turn, makes both inertias oscillate. If they do so faster than the torque
is read, sampling aliases the oscillation into the band that is fitted. It follows from the commands, as the motor's own
torque does, so the fit takes it for inertia, bandwidth and damping: errors of ten standard deviations, with a white
residual. The calibration knows the spring too badly to predict it. The readings tell it: stiffness, damping, and the
amplitude and delay with which either motor drives the spring are estimated by maximum likelihood. Whatever the unknowns
of the fit can explain is projected out before (Frisch, Waugh and Lovell). After a turn the friction contact, as the fit
has it, damps the oscillation until the shaft slides.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.identification.bootstrap import Readings, Simulation
from norton_bench.identification.coupling import DAMPING_RATIO, UNKNOWNS, Coupling, Prior
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.motor_values import physical
from norton_bench.identification.readings import nominal_period_s
from norton_bench.identification.regression import Regression
from norton_bench.identification.separable import Solution, solve_again
from norton_bench.identification.shape import GAIN
from norton_bench.identification.signals import Signals, TimeSeries, instants, signals, validation_stretches
from norton_bench.identification.simulated_bench import Driving, SimulatedStretch, Spectrum, inertia_of
from norton_bench.identification.statistics import sandwich
from norton_bench.records import Measured

# Evaluated are the spans in which the motors are driven most; the whole record would take longer and tell little more.
SPAN_S, SPANS = 2.0, 10
# Not in these steps: with torque feedback the load's commands depend on the errors of the torque readings, which would
# bias the estimate (closed-loop identification: Ljung, System Identification, ch. 13).
ZERO_TORQUE = ("free", "tabulate_source")
# At the ends of a span the oscillation depends on earlier commands.
EDGE_S = 0.05
# How far the stiffness is scanned, in deviations of the calibration's.
SCANNED = 2.5
# The scan's step, relative, of the resonance, and its damping ratio: so that no resonance lies between two steps.
SCAN_STEP = SCAN_DAMPING = DAMPING_RATIO
# From so many of the best places of the scan a search begins, of at most so many steps.
MOST_STARTS, MOST_STEPS = 3, 20
# The first fit is biased by the ringing, and with it the estimate of the ringing; the later ones are not.
ROUNDS = 3
SETTLED = 0.05  # of the logarithm of the likelihood
# Of an amplitude that was subtracted, relative, before the residual is looked at: between none and twice as much.
AMPLITUDE_VARIANCE = 1.0 / 3.0
# For slopes: of the logarithms of stiffness and damping, delays [s], logarithms of amplitudes.
PROBES = np.array([1e-3, 1e-2, 1e-6, 1e-6, 1e-2, 1e-2])
LONGEST_STEP = np.array([0.1, 1.0, 1e-4, 1e-4, 0.5, 0.5])
STEP_SHARES = (1.0, 0.3, 0.1, 0.03)
# Fewer rows without a search tell nothing of amplitudes.
FEWEST_ROWS = 100


@dataclass(frozen=True)
class Ringing:
    """Torque of the oscillating coupling in spans of a simulation, and in the rows of a regression of ``stretches``."""

    simulation: Simulation
    stretches: tuple[Signals, ...]
    spans: tuple[tuple[IntArray, Driving], ...]  # indices of torque readings, and the driving

    @classmethod
    def of(cls, simulation: Simulation, coupling: Coupling, stretches: tuple[Signals, ...]) -> "Ringing":
        """In all of the simulation."""
        spans = ((simulation.seen(truth), simulation.driving(truth, coupling)) for truth in simulation.truths)
        return cls(simulation, stretches, tuple(spans))

    def torque_nm(self, spring: Coupling, push_of: Callable[[Driving], Spectrum]) -> FloatArray:
        """At the instants of the torque readings, zero outside the spans, (readings,)."""
        time_s = self.simulation.torque.time_s
        torque_nm = np.zeros(time_s.size)
        for seen, driving in self.spans:
            torque_nm[seen] = driving.torque_at(time_s[seen], push_of(driving), spring)
        return torque_nm

    def rows(self, torque_nm: FloatArray, band: Kernel) -> FloatArray:
        """These readings, filtered as the fit's rows in ``band`` are, (samples,)."""
        stream = replace(self.simulation.torque, value=torque_nm)
        ringing = tuple(replace(each, torque_nm=self._at(each.time_s, stream)) for each in self.stretches)
        return Regression.of(ringing, band).target()

    def _at(self, time_s: FloatArray, stream: TimeSeries) -> FloatArray:
        """Resampled; zero outside the spans, (n,)."""
        torque_nm = np.zeros(time_s.size)
        for _, driving in self.spans:
            within = slice(*np.searchsorted(time_s, [driving.at_s[0], driving.at_s[-1]]))
            resampled_nm = stream.between(driving.at_s[0], driving.at_s[-1]).at(time_s[within])
            torque_nm[within] = np.nan_to_num(resampled_nm)  # at the ends readings are missing on one side
        return torque_nm

    def of_spring(self, spring: Coupling) -> FloatArray:
        """Torque at the instants of the readings with this spring, (readings,)."""
        return self.torque_nm(spring, lambda driving: driving.push(spring))

    def read(self, spring: Coupling, band: Kernel) -> FloatArray:
        """The same, filtered as the fit's rows in ``band`` are, (samples,)."""
        return self.rows(self.of_spring(spring), band)


@dataclass(frozen=True)
class Likelihood:
    """Likelihood of a ringing, from the rows in its spans: ``left`` (rows,) is the fit's residual there, ``unknowns``
    (rows, k) an orthonormal basis of its columns; both whitened."""

    ringing: Ringing
    evaluated: BoolArray  # (samples,)
    left: FloatArray
    unknowns: FloatArray
    alike: float  # neighbouring rows that count as one

    @classmethod
    def of(cls, ringing: Ringing) -> "Likelihood":
        solution = ringing.simulation.solution
        time_s = solution.regression.time_s()
        evaluated = np.zeros(time_s.size, dtype=bool)
        for _, driving in ringing.spans:
            evaluated |= (time_s > driving.at_s[0] + EDGE_S) & (time_s < driving.at_s[-1] - EDGE_S)
        unknowns = np.linalg.qr(solution.jacobian[evaluated])[0]
        left = solution.innovation
        if ringing.simulation.readings.ringing_nm is not None:  # add what was subtracted before
            before = ringing.rows(ringing.simulation.readings.ringing_nm, solution.regression.rows[0].kernel)
            left = left + solution.regression.white(before[None, :])[0]
        left = left[evaluated]
        left = left - unknowns @ (unknowns.T @ left)
        return cls(ringing, evaluated, left, unknowns, solution.regression.alike)

    def projected(self, spring: Coupling, push_of: Callable[[Driving], Spectrum]) -> FloatArray:
        """The part of a ringing in the rows that the fit's unknowns cannot explain, (rows,)."""
        regression = self.ringing.simulation.solution.regression
        rows = self.ringing.rows(self.ringing.torque_nm(spring, push_of), regression.rows[0].kernel)
        white = regression.white(rows[None, :])[0][self.evaluated]
        return np.asarray(white - self.unknowns @ (self.unknowns.T @ white))

    def gain(self, rest: FloatArray) -> float:
        """Log-likelihood of the remaining residual ``rest`` (rows,), relative to no ringing; maximised over the
        variance."""
        return float(-0.5 * self.left.size / self.alike * np.log((rest @ rest) / (self.left @ self.left)))

    @property
    def least_gain(self) -> float:
        """What so many unknowns must gain: Schwarz's criterion (Annals of Statistics 6, 1978)."""
        return float(0.5 * UNKNOWNS * np.log(self.left.size / self.alike))


@dataclass(frozen=True)
class SpringFit:
    """A local maximum: the spring, its log-likelihood with the prior, and the curvature, (UNKNOWNS, UNKNOWNS)."""

    spring: Coupling
    gain: float
    curvature: FloatArray


def without_ringing(
    readings: Readings, stretches: tuple[Signals, ...], solution: Solution
) -> tuple[Readings, tuple[Signals, ...], Solution]:
    """Readings, signals and solution with the ringing subtracted; unchanged where none is found.

    Nothing is looked for in free motion, after a fit that did not converge, or if the coupling oscillates slower than
    half the rate of the torque readings: then nothing is aliased.
    """
    as_read = readings, stretches, solution
    coupling = readings.coupling
    if coupling is None or not solution.converged or solution.free_motion:
        return as_read
    if coupling.resonance_hz(inertia_of(solution)) < 0.5 * _rate_hz(readings):
        return as_read
    unseen = validation_stretches(readings.measured, readings.tick_s)
    quiet, springs = readings, tuple[Coupling, ...]()
    for _ in range(ROUNDS):
        simulation = Simulation.without_errors(quiet, stretches, solution)
        springs = fitted_springs(simulation, coupling, springs)
        if not springs:
            return as_read
        ringing = Ringing.of(simulation.over(unseen), springs[0], stretches)
        ringing_nm = ringing.of_spring(springs[0])
        measured = _less(readings.measured, ringing_nm)
        quiet = replace(readings, measured=measured, coupling=springs[0], ringing_nm=ringing_nm)
        stretches = signals(measured, readings.tick_s, readings.use)
        solution = solve_again(stretches, solution)
        if not solution.converged:
            return as_read
    begins_s = np.array([begin_s for begin_s, _ in _most_driven(simulation, coupling)])
    parts = parts_of_ringing(ringing, springs[0], ringing_nm, solution)
    return replace(quiet, ringing_covariance=left_uncertain(parts, solution, begins_s)), stretches, solution


def parts_of_ringing(ringing: Ringing, spring: Coupling, whole: FloatArray, solution: Solution) -> FloatArray:
    """What motor and load make of the ``whole`` of it (readings,) in the rows of ``solution``, (2, rows), as its least
    squares sees them."""
    band = solution.regression.rows[0].kernel
    of_motor = ringing.of_spring(replace(spring, load_amplitude=0.0))
    rows = np.stack([ringing.rows(each, band) for each in (of_motor, whole - of_motor)])
    return solution.regression.white(rows)


def left_uncertain(parts: FloatArray, solution: Solution, begins_s: FloatArray) -> FloatArray:
    """Covariance of values, in the order of ``physical``, (p, p), for what is not known of the amplitudes of ``parts``
    (k, rows) of a ringing that was subtracted.

    Each may be anything between none and twice what it was taken for, unless the residual tells it better, beside all
    that the fit may change, in the rows outside the spans in which it was searched, which begin at ``begins_s`` (k,).
    """
    time_s = solution.regression.time_s()
    since_s = time_s[:, None] - begins_s
    elsewhere = ~np.any((since_s > -EDGE_S) & (since_s < SPAN_S + EDGE_S), axis=1)
    changes = np.linalg.lstsq(solution.jacobian, parts.T, rcond=None)[0]
    own = parts.T - solution.jacobian @ changes
    precision, pull = np.eye(len(parts)) / AMPLITUDE_VARIANCE, np.zeros(len(parts))
    if np.count_nonzero(elsewhere) > FEWEST_ROWS:
        told = own[elsewhere]
        amplitudes = np.linalg.lstsq(told, solution.innovation[elsewhere], rcond=None)[0]
        left = solution.innovation[elsewhere] - told @ amplitudes
        of_residual = np.linalg.pinv(sandwich(told, left, time_s[elsewhere]), hermitian=True)
        precision, pull = precision + of_residual, of_residual @ amplitudes
    mean = np.linalg.solve(precision, pull)
    off = np.linalg.inv(precision) + np.outer(mean, mean)
    return physical(solution, changes @ off @ changes.T)[1]


def remark_on(readings: Readings, inertia_kgm2: float) -> tuple[str, ...]:
    """A sentence on the ringing that was subtracted from the readings; none where none was."""
    if readings.ringing_nm is None or readings.coupling is None:
        return ()
    resonance_hz = readings.coupling.resonance_hz(inertia_kgm2)
    rms_nm = float(np.std(readings.ringing_nm[readings.ringing_nm != 0.0]))
    return (
        f"Motor and load oscillate on the torque sensor's spring at {resonance_hz:.0f} Hz, and the torque is read at "
        f"{_rate_hz(readings):.0f} Hz: {1e3 * rms_nm:.2g} mN*m rms of this was found in the readings and subtracted.",
    )


def _rate_hz(readings: Readings) -> float:
    """Of the torque's readings."""
    return 1.0 / nominal_period_s(readings.measured.torque["arrival_ns"])


def _less(measured: Measured, ringing_nm: FloatArray) -> Measured:
    """``ringing_nm`` (n,) subtracted from the torque readings that a simulation uses."""
    table = measured.torque.copy()
    valid = np.flatnonzero(table["valid"])
    used = valid[instants(table[valid], int(measured.ticks["tick_ns"][0]))[1]]
    table["torque_nm"][used] -= ringing_nm
    return replace(measured, torque=table)


def fitted_springs(simulation: Simulation, coupling: Coupling, before: Sequence[Coupling] = ()) -> tuple[Coupling, ...]:
    """Local maxima of the likelihood, the greatest first, each with its covariance; none where nothing rings.

    Two whose stiffnesses are closer than the scan's step are one. The search begins at those found ``before``, or else
    at all stiffnesses that the calibration, ``coupling``, allows. Several springs can have one aliased frequency; which
    of them it is becomes clear once the fit is unbiased.
    """
    spans = tuple(_spans(simulation, coupling))
    if not spans:
        return ()
    likelihood = Likelihood.of(Ringing(simulation, simulation.stretches, spans))
    prior = Prior.of(coupling, inertia_of(simulation.solution))
    if before:
        prior = prior.with_motor_known()
        starts = [*before, *(replace(each, motor_extra_delay_s=0.0, motor_amplitude=1.0) for each in before)]
    else:
        starts = _starting_springs(likelihood, prior)
    found = sorted((_most_likely(likelihood, start, prior) for start in starts), key=lambda each: -each.gain)
    # The first fit is too much biased for its motor's amplitude to be judged.
    if found[0].gain < likelihood.least_gain or (before and prior.implausible(found[0].spring)):
        return ()
    distinct = [found[0]]
    for each in found[1:]:
        if all(abs(prior.off(each.spring)[0] - prior.off(one.spring)[0]) > SCAN_STEP for one in distinct):
            distinct.append(each)
    return tuple(_with_deviations(each, prior) for each in distinct[:MOST_STARTS])


def _with_deviations(found: SpringFit, prior: Prior) -> Coupling:
    """The spring with its covariance by Laplace's approximation."""
    covariance = np.linalg.inv(found.curvature * np.outer(prior.std, prior.std)) * np.outer(prior.std, prior.std)
    stiffness, damping = np.sqrt(np.diag(covariance))[:2]
    return replace(
        found.spring,
        stiffness_std_nm_rad=found.spring.stiffness_nm_rad * float(stiffness),
        damping_std_nms_rad=found.spring.damping_nms_rad * float(damping),
        covariance_root=np.asarray(np.linalg.cholesky(covariance), dtype=np.float64),
    )


def _spans(simulation: Simulation, coupling: Coupling) -> Iterator[tuple[IntArray, Driving]]:
    """Those in which the motors are driven most, with what drives them."""
    time_s = simulation.torque.time_s
    # The grid must show the stiffest spring of the scan.
    stiffest = coupling.stiffer(SCANNED)
    for begin_s, truth in _most_driven(simulation, coupling):
        seen = np.arange(*np.searchsorted(time_s, [begin_s, begin_s + SPAN_S]))
        yield seen, simulation.driving_within((begin_s, begin_s + SPAN_S), truth, stiffest)


def _most_driven(simulation: Simulation, coupling: Coupling) -> list[tuple[float, SimulatedStretch]]:
    """Where the spans begin that have the greatest steps of the commands, without torque feedback, among rows that are
    fitted; and the stretch of each."""
    solution, segments = simulation.solution, simulation.readings.measured.segments
    answering = [segment.index for segment in segments if segment.procedure in ZERO_TORQUE]
    found: list[tuple[float, float, SimulatedStretch]] = []
    for truth in simulation.truths:
        stretch = truth.stretch
        edges_s = np.arange(truth.time_s[0], truth.time_s[-1], SPAN_S)
        if edges_s.size < 2:
            continue
        quick = float(solution.linear[GAIN]) * solution.shape.bandwidth_rad_s / inertia_of(solution)
        energy = _energy(stretch.sent_s, quick * stretch.command, edges_s)
        quick = coupling.load_gain * coupling.load_bandwidth_rad_s / coupling.load_inertia_kgm2
        energy += _energy(coupling.sent_s, quick * coupling.command_nm, edges_s)
        useful = stretch.usable & ~np.isin(stretch.segment, answering)
        energy *= np.histogram(stretch.time_s, edges_s, weights=useful.astype(float))[0]
        found += [(float(each), begin, truth) for each, begin in zip(energy, edges_s[:-1], strict=True)]
    ordered = sorted(found, key=lambda each: -each[0])[:SPANS]
    return [(begin_s, truth) for driven, begin_s, truth in ordered if driven > 0.0]


def _energy(sent_s: FloatArray, driven: FloatArray, edges_s: FloatArray) -> FloatArray:
    """Sum of the squared steps of a command between each edge and the next, (edges - 1,)."""
    return np.asarray(np.histogram(sent_s[1:], edges_s, weights=np.diff(driven) ** 2)[0])


def _starting_springs(likelihood: Likelihood, prior: Prior) -> list[Coupling]:
    """The best local maxima of a scan over the stiffness, each with its best amplitudes and phases."""
    reach = SCANNED * float(prior.std[0])
    changes = np.linspace(-reach, reach, 2 * ceil(reach / (2 * SCAN_STEP)) + 1)
    found = []
    for change in changes:
        spring = prior.centre.moved(change * np.eye(UNKNOWNS)[0]).damped(SCAN_DAMPING, prior.inertia_kgm2)
        fitting, gain = _with_best_phases(likelihood, spring, prior.inertia_kgm2)
        found.append((gain - 0.5 * (change / prior.std[0]) ** 2, fitting))
    gains = np.array([-np.inf, *(gain for gain, _ in found), -np.inf])
    peaks = np.flatnonzero((gains[1:-1] >= gains[:-2]) & (gains[1:-1] >= gains[2:]))
    return [found[each][1] for each in sorted(peaks, key=lambda peak: -found[peak][0])[:MOST_STARTS]]


def _with_best_phases(likelihood: Likelihood, spring: Coupling, inertia_kgm2: float) -> tuple[Coupling, float]:
    """The same spring with the best amplitude and phase of either motor, by linear least squares, and its gain."""
    pushes: tuple[Callable[[Driving], Spectrum], ...] = (
        lambda driving: driving.motor,
        lambda driving: -1j * driving.motor,  # a quarter of a period later
        lambda driving: -driving.load,
        lambda driving: 1j * driving.load,
    )
    matrix = np.stack([likelihood.projected(spring, each) for each in pushes], axis=1)
    left = likelihood.left + likelihood.projected(spring, lambda driving: driving.friction)
    amplitudes = np.linalg.lstsq(matrix, left, rcond=None)[0]
    gain = likelihood.gain(left - matrix @ amplitudes)
    omega = 2 * np.pi * spring.resonance_hz(inertia_kgm2)
    of_motor, of_load = (complex(*amplitudes[at : at + 2]) for at in (0, 2))
    fitting = replace(
        spring,
        motor_amplitude=max(abs(of_motor), 1e-3),
        motor_extra_delay_s=float(np.angle(of_motor)) / omega,
        load_amplitude=max(abs(of_load), 1e-3),
        load_extra_delay_s=float(np.angle(of_load)) / omega,
    )
    return fitting, gain


def _most_likely(likelihood: Likelihood, start: Coupling, prior: Prior) -> SpringFit:
    """The local maximum near ``start``, by Gauss-Newton."""

    def rest_of(spring: Coupling) -> FloatArray:
        return likelihood.left - likelihood.projected(spring, lambda driving: driving.push(spring))

    spring = prior.possible(start)
    rest = rest_of(spring)
    gain = likelihood.gain(rest) - prior.cost(spring)
    for _ in range(MOST_STEPS):
        slopes = np.stack([rest - rest_of(spring.moved(probe)) for probe in np.diag(PROBES)], axis=1) / PROBES
        variance = likelihood.alike * float(rest @ rest) / rest.size
        curvature = slopes.T @ slopes / variance + np.diag(prior.std**-2)
        pull = slopes.T @ rest / variance - prior.off(spring) / prior.std**2
        scaled = np.linalg.solve(curvature * np.outer(prior.std, prior.std), pull * prior.std)
        step = scaled * prior.std
        step /= max(1.0, float(np.max(np.abs(step) / LONGEST_STEP)))  # all by the same factor: they are correlated
        before = gain
        for share in STEP_SHARES:
            trial = prior.possible(spring.moved(share * step))
            left = rest_of(trial)
            gain = likelihood.gain(left) - prior.cost(trial)
            if gain > before:
                spring, rest = trial, left
                break
        if gain < before + SETTLED:
            break
    return SpringFit(spring, max(gain, before), curvature)
