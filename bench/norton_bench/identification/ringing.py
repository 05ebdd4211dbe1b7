"""The ringing of motor and load on the torque sensor's spring: listened for in the readings, and taken off them.

Each step of a command makes both inertias ring, and where they do so faster than the torque is read, readings show it
as something slow, in the band that is fitted. It follows from the commands, as the motor's own torque does, so that
parameters take it for theirs: errors of ten deviations, with a residual that is white. The calibration tells the spring
far too badly to foretell it. The readings that are fitted tell stiffness and damping, and how loud and how late either
motor shakes them, by maximum likelihood beside all that the fit may change (Frisch, Waugh and Lovell).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.bootstrap import Readings, Simulation
from norton_bench.identification.coupling import LEAST_DAMPING_RATIO, UNKNOWNS, Coupling
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.readings import nominal_period_s
from norton_bench.identification.regression import Regression
from norton_bench.identification.separable import Solution, solve_again
from norton_bench.identification.shape import GAIN
from norton_bench.identification.signals import Signals, TimeSeries, instants, signals
from norton_bench.identification.simulated_bench import Driving, SimulatedStretch, Spectrum, inertia_of
from norton_bench.records import Measured
from norton_bench.segments import Use

# Listened to are the spans in which motors are driven the most; the whole record would take longer, and tell little
# more.
SPAN_S, SPANS = 2.0, 10
# Not in these steps: under feedback of the torque the load's commands follow the errors of its readings, and what they
# make ring would be told by these (closed-loop identification: Ljung, System Identification, ch. 13).
ZERO_TORQUE = ("free", "tabulate_source")
# At the ends of a span nobody knows what rang before.
EDGE_S = 0.05
# Of the stiffness, in deviations: where it is looked for.
WITHIN = 2.5
# Resonances that lie so near, relative, are one where they are looked for, with such a share of critical damping: from
# that to a joint's that rubs (Bachmann et al., Vibration Problems in Structures, 1995, app. C).
APART, BLUNT = 0.06, 0.06
# So many of the likeliest are followed to the peak, in so many steps.
FOLLOWED, MOST_STEPS = 3, 20
# The first fit was led astray by the ringing; beside a better one it is heard better.
ROUNDS = 3
SETTLED = 0.05  # of the logarithm of the likelihood
# For slopes: of the logarithms of stiffness and damping, delays [s], logarithms of amplitudes.
PROBES = np.array([1e-3, 1e-2, 1e-6, 1e-6, 1e-2, 1e-2])
LONGEST_STEP = np.array([0.1, 1.0, 1e-4, 1e-4, 0.5, 0.5])
STEP_SHARES = (1.0, 0.3, 0.1, 0.03)
# The middle of the shares of critical damping that joints have, from 0.005 to 0.16 (Bachmann), and the deviation of the
# logarithm with which 95 % lie between these.
DAMPING_RATIO, DAMPING_STD = 0.028, 0.88
# By how much of a wave a motor may differ from its first-order lag at such a frequency: 30°. And by how much, of the
# logarithm, the torque of either motor: 95 % from half of what its lag says to twice as much.
MOTOR_LATE, LOUDER = 1.0 / 12.0, 0.35
INCREDIBLE = 3.0  # deviations
# Of the stiffness's logarithm: known no better, in case it goes with the temperature; a factor of 7 either way.
STIFFNESS_STD = (1e-3, 1.0)


@dataclass(frozen=True)
class Ringing:
    """Of the coupling in spans of a simulation, as rows of a regression over ``stretches`` have it."""

    simulation: Simulation
    stretches: tuple[Signals, ...]
    spans: tuple[tuple[IntArray, Driving], ...]  # numbers of torque readings, and what makes it ring then

    @classmethod
    def of(cls, simulation: Simulation, coupling: Coupling, stretches: tuple[Signals, ...]) -> "Ringing":
        """In all of the simulation."""
        spans = ((simulation.seen(truth), simulation.driving(truth, coupling)) for truth in simulation.truths)
        return cls(simulation, stretches, tuple(spans))

    def torque_nm(self, spectrum_of: Callable[[Driving], Spectrum]) -> FloatArray:
        """At the torque's readings, none outside the spans, (readings,)."""
        time_s = self.simulation.torque.time_s
        torque_nm = np.zeros(time_s.size)
        for seen, driving in self.spans:
            torque_nm[seen] = driving.torque_at(time_s[seen], spectrum_of(driving))
        return torque_nm

    def rows(self, torque_nm: FloatArray, band: Kernel) -> FloatArray:
        """Of each sample in ``band``, what of its torque are these readings, (samples,)."""
        stream = replace(self.simulation.torque, value=torque_nm)
        rung = tuple(replace(each, torque_nm=self._at(each.time_s, stream)) for each in self.stretches)
        return Regression.of(rung, band).target()

    def _at(self, time_s: FloatArray, stream: TimeSeries) -> FloatArray:
        """Of a stream that is none outside the spans."""
        torque_nm = np.zeros(time_s.size)
        for _, driving in self.spans:
            within = slice(*np.searchsorted(time_s, [driving.at_s[0], driving.at_s[-1]]))
            heard_nm = stream.between(driving.at_s[0], driving.at_s[-1]).at(time_s[within])
            torque_nm[within] = np.nan_to_num(heard_nm)  # at the ends there may be no reading to either side
        return torque_nm

    def of_spring(self, spring: Coupling) -> FloatArray:
        """Its torque at the readings, (readings,)."""
        return self.torque_nm(lambda driving: driving.spectrum(spring))

    def read(self, spring: Coupling, band: Kernel) -> FloatArray:
        """Of each sample in ``band``, what of its torque is the ringing of ``spring``, (samples,)."""
        return self.rows(self.of_spring(spring), band)


@dataclass(frozen=True)
class Likelihood:
    """Of a ringing, by rows that lie in the spans listened to: ``left`` (rows,) is what the fit left there, beside
    ``unknowns`` (rows, k), an orthonormal base of its columns, both as least squares saw them."""

    ringing: Ringing
    listened: BoolArray  # (samples,)
    left: FloatArray
    unknowns: FloatArray
    alike: float  # rows that count as one

    @classmethod
    def of(cls, ringing: Ringing) -> "Likelihood":
        solution = ringing.simulation.solution
        time_s = solution.regression.time_s()
        listened = np.zeros(time_s.size, dtype=bool)
        for _, driving in ringing.spans:
            listened |= (time_s > driving.at_s[0] + EDGE_S) & (time_s < driving.at_s[-1] - EDGE_S)
        unknowns = np.linalg.qr(solution.jacobian[listened])[0]
        left = solution.innovation
        if ringing.simulation.readings.ringing_nm is not None:  # what was taken off is listened to once more
            rung = ringing.rows(ringing.simulation.readings.ringing_nm, solution.regression.rows[0].kernel)
            left = left + solution.regression.white(rung[None, :])[0]
        left = left[listened]
        left = left - unknowns @ (unknowns.T @ left)
        return cls(ringing, listened, left, unknowns, solution.regression.alike)

    def seen(self, spectrum_of: Callable[[Driving], Spectrum]) -> FloatArray:
        """What least squares would see of it beside the unknowns, (rows,)."""
        regression = self.ringing.simulation.solution.regression
        rows = self.ringing.rows(self.ringing.torque_nm(spectrum_of), regression.rows[0].kernel)
        white = regression.white(rows[None, :])[0][self.listened]
        return np.asarray(white - self.unknowns @ (self.unknowns.T @ white))

    def gain(self, rest: FloatArray) -> float:
        """The logarithm of how much likelier the readings are where ``rest`` (rows,) is all that is left. The variance
        is the likeliest."""
        return float(-0.5 * self.left.size / self.alike * np.log((rest @ rest) / (self.left @ self.left)))

    @property
    def audible(self) -> float:
        """The least gain that so many unknowns are worth (Schwarz, Annals of Statistics 6, 1978)."""
        return float(0.5 * UNKNOWNS * np.log(self.left.size / self.alike))


@dataclass(frozen=True)
class Heard:
    """One spring, how much likelier it makes the readings, and the curvature of that with the calibration's, (UNKNOWNS,
    UNKNOWNS)."""

    spring: Coupling
    gain: float
    curvature: FloatArray


def without_ringing(
    readings: Readings, stretches: tuple[Signals, ...], solution: Solution
) -> tuple[Readings, tuple[Signals, ...], Solution]:
    """Readings, signals and solution without the ringing that is heard in them; the same where none is.

    The solution is that of a motor that no joint stands before: what a joint lets through shakes no sensor. One that
    did not converge, or that no torque gives a scale, foretells no ringing.
    """
    as_read = readings, stretches, solution
    coupling = readings.coupling
    if coupling is None or not solution.converged or solution.free_motion:
        return as_read
    # Slower ringing is read as it is: nothing of it is folded.
    if coupling.resonance_hz(inertia_of(solution)) < 0.5 * _rate_hz(readings):
        return as_read
    quiet, springs = readings, tuple[Coupling, ...]()
    for _ in range(ROUNDS):
        simulation = Simulation.without_errors(quiet, stretches, solution)
        springs = heard(simulation, coupling, springs)
        if not springs:
            return as_read
        everywhere = simulation.over(_validated(readings))
        ringing_nm = Ringing.of(everywhere, springs[0], stretches).of_spring(springs[0])
        measured = _less(readings.measured, ringing_nm)
        quiet = replace(readings, measured=measured, coupling=springs[0], ringing_nm=ringing_nm)
        stretches = signals(measured, readings.tick_s, readings.use)
        solution = solve_again(stretches, solution)
        if not solution.converged:
            return as_read
    return quiet, stretches, solution


def remark_on(readings: Readings, inertia_kgm2: float) -> tuple[str, ...]:
    """A sentence on the ringing that was taken off the readings; none where none was."""
    if readings.ringing_nm is None or readings.coupling is None:
        return ()
    resonance_hz = readings.coupling.resonance_hz(inertia_kgm2)
    rms_nm = float(np.std(readings.ringing_nm[readings.ringing_nm != 0.0]))
    return (
        f"Motor and load ring on the torque sensor's spring at {resonance_hz:.0f} Hz, and the torque is read at "
        f"{_rate_hz(readings):.0f} Hz: {1e3 * rms_nm:.2g} mN*m rms of the readings was that, and was taken off them.",
    )


def _rate_hz(readings: Readings) -> float:
    """Of the torque's readings."""
    return 1.0 / nominal_period_s(readings.measured.torque["arrival_ns"])


def _validated(readings: Readings) -> tuple[Signals, ...]:
    try:
        return signals(readings.measured, readings.tick_s, Use.VALIDATE)
    except ExperimentError:
        return ()


def _less(measured: Measured, ringing_nm: FloatArray) -> Measured:
    """With so much less torque in the readings that a simulation has, (n,)."""
    table = measured.torque.copy()
    valid = np.flatnonzero(table["valid"])
    used = valid[instants(table[valid], int(measured.ticks["tick_ns"][0]))[1]]
    table["torque_nm"][used] -= ringing_nm
    return replace(measured, torque=table)


@dataclass(frozen=True)
class Prior:
    """What is known of a spring beforehand: normal, of Coupling.moved's unknowns, each by itself.

    What shakes it is late by half a wave at most: then it is another wave.
    """

    centre: Coupling
    std: FloatArray  # (UNKNOWNS,)
    inertia_kgm2: float

    @classmethod
    def of(cls, calibrated: Coupling, inertia_kgm2: float) -> "Prior":
        """By a calibration, and by what joints have where that hardly tells the damping."""
        stiffness = float(np.clip(calibrated.stiffness_std_nm_rad / calibrated.stiffness_nm_rad, *STIFFNESS_STD))
        damping = calibrated.damping_std_nms_rad / max(calibrated.damping_nms_rad, 1e-300)
        if damping > DAMPING_STD:
            damping, calibrated = DAMPING_STD, calibrated.damped(DAMPING_RATIO, inertia_kgm2)
        half_s = 0.5 / calibrated.resonance_hz(inertia_kgm2)
        return cls(calibrated, np.array([stiffness, damping, half_s, half_s, LOUDER, LOUDER]), inertia_kgm2)

    def with_motor_known(self) -> "Prior":
        """The same where the fit that foretells what the motor does is no more led astray."""
        std = self.std.copy()
        std[2] *= 2.0 * MOTOR_LATE
        return replace(self, std=std)

    def off(self, spring: Coupling) -> FloatArray:
        """How far a spring is from the centre, as Coupling.moved has it."""
        centre = self.centre
        return np.array(
            [
                np.log(spring.stiffness_nm_rad / centre.stiffness_nm_rad),
                np.log(spring.damping_nms_rad / centre.damping_nms_rad),
                spring.motor_late_s - centre.motor_late_s,
                spring.load_late_s - centre.load_late_s,
                np.log(spring.motor_louder / centre.motor_louder),
                np.log(spring.load_louder / centre.load_louder),
            ]
        )

    def cost(self, spring: Coupling) -> float:
        """The logarithm of how much less likely it is than the centre."""
        return 0.5 * float(np.sum((self.off(spring) / self.std) ** 2))

    def incredible(self, spring: Coupling) -> bool:
        """Whether no motor shakes it like that: then the load's commands follow the sensor's noise, which is heard."""
        return bool(np.any(np.abs(self.off(spring)[4:]) > INCREDIBLE * self.std[4:]))

    def possible(self, spring: Coupling) -> Coupling:
        """The same with no less damping than any joint has, and less than rings no more."""
        low, high = (spring.damped(ratio, self.inertia_kgm2).damping_nms_rad for ratio in (LEAST_DAMPING_RATIO, 1.0))
        return replace(spring, damping_nms_rad=min(max(spring.damping_nms_rad, low), high))


def heard(simulation: Simulation, coupling: Coupling, before: Sequence[Coupling] = ()) -> tuple[Coupling, ...]:
    """Springs that the readings tell of, the likeliest first, and how well each is told; none where they tell of none.

    They are looked for near those that were heard ``before``; without that wherever the calibration, ``coupling``, lets
    them be. One and the same folded frequency may be that of several, until the fit is led astray no more.
    """
    spans = tuple(_spans(simulation, coupling))
    if not spans:
        return ()
    likelihood = Likelihood.of(Ringing(simulation, simulation.stretches, spans))
    prior = Prior.of(coupling, inertia_of(simulation.solution))
    if before:
        prior = prior.with_motor_known()
        starts = [*before, *(replace(each, motor_late_s=0.0, motor_louder=1.0) for each in before)]
    else:
        starts = _looked_for(likelihood, prior)
    found = sorted((_followed(likelihood, start, prior) for start in starts), key=lambda each: -each.gain)
    if found[0].gain < likelihood.audible or prior.incredible(found[0].spring):
        return ()
    return tuple(_told(each, prior) for each in found[:FOLLOWED])


def _told(found: Heard, prior: Prior) -> Coupling:
    """The spring with its deviations, those of a normal peak (Laplace)."""
    covariance = np.linalg.inv(found.curvature * np.outer(prior.std, prior.std)) * np.outer(prior.std, prior.std)
    stiffness, damping = np.sqrt(np.diag(covariance))[:2]
    return replace(
        found.spring,
        stiffness_std_nm_rad=found.spring.stiffness_nm_rad * float(stiffness),
        damping_std_nms_rad=found.spring.damping_nms_rad * float(damping),
        root=np.asarray(np.linalg.cholesky(covariance), dtype=np.float64),
    )


def _spans(simulation: Simulation, coupling: Coupling) -> Iterator[tuple[IntArray, Driving]]:
    """Those in which the motors are driven the most while their motion is fitted, and does not answer the torque."""
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
    time_s = simulation.torque.time_s
    # Springs that are listened for may be stiffer.
    stiffest = coupling.stiffer(WITHIN)
    for driven, begin_s, truth in sorted(found, key=lambda each: -each[0])[:SPANS]:
        if driven > 0.0:
            seen = np.arange(*np.searchsorted(time_s, [begin_s, begin_s + SPAN_S]))
            yield seen, simulation.driving_within((begin_s, begin_s + SPAN_S), truth, stiffest)


def _energy(sent_s: FloatArray, driven: FloatArray, edges_s: FloatArray) -> FloatArray:
    """Of the steps, between each edge and the next, (edges - 1,)."""
    return np.asarray(np.histogram(sent_s[1:], edges_s, weights=np.diff(driven) ** 2)[0])


def _looked_for(likelihood: Likelihood, prior: Prior) -> list[Coupling]:
    """The likeliest of many stiffnesses, likelier than those beside it, each with the loudness and the phases that suit
    it best."""
    reach = WITHIN * float(prior.std[0])
    changes = np.linspace(-reach, reach, 2 * ceil(reach / (2 * APART)) + 1)
    found = []
    for change in changes:
        spring = prior.centre.moved(change * np.eye(UNKNOWNS)[0]).damped(BLUNT, prior.inertia_kgm2)
        fitting, gain = _suited(likelihood, spring, prior.inertia_kgm2)
        found.append((gain - 0.5 * (change / prior.std[0]) ** 2, fitting))
    gains = np.array([-np.inf, *(gain for gain, _ in found), -np.inf])
    peaks = np.flatnonzero((gains[1:-1] >= gains[:-2]) & (gains[1:-1] >= gains[2:]))
    return [found[each][1] for each in sorted(peaks, key=lambda peak: -found[peak][0])[:FOLLOWED]]


def _suited(likelihood: Likelihood, spring: Coupling, inertia_kgm2: float) -> tuple[Coupling, float]:
    """The same spring with the likeliest loudness and phase of either motor, and its gain: linear least squares."""

    def motor(driving: Driving) -> Spectrum:
        return np.asarray(driving.motor * spring.response(driving.frequency_hz, inertia_kgm2))

    def load(driving: Driving) -> Spectrum:
        return np.asarray(-driving.load * spring.response(driving.frequency_hz, inertia_kgm2))

    def a_quarter_late(part: Callable[[Driving], Spectrum]) -> Callable[[Driving], Spectrum]:
        return lambda driving: -1j * part(driving)

    columns = [likelihood.seen(each) for part in (motor, load) for each in (part, a_quarter_late(part))]
    matrix = np.stack(columns, axis=1)
    amplitudes = np.linalg.lstsq(matrix, likelihood.left, rcond=None)[0]
    gain = likelihood.gain(likelihood.left - matrix @ amplitudes)
    omega = 2 * np.pi * spring.resonance_hz(inertia_kgm2)
    of_motor, of_load = (complex(*amplitudes[at : at + 2]) for at in (0, 2))
    fitting = replace(
        spring,
        motor_louder=max(abs(of_motor), 1e-3),
        motor_late_s=float(np.angle(of_motor)) / omega,
        load_louder=max(abs(of_load), 1e-3),
        load_late_s=float(np.angle(of_load)) / omega,
    )
    return fitting, gain


def _followed(likelihood: Likelihood, start: Coupling, prior: Prior) -> Heard:
    """To the peak nearest to ``start``, by Gauss-Newton."""

    def rest_of(spring: Coupling) -> FloatArray:
        return likelihood.left - likelihood.seen(lambda driving: driving.spectrum(spring))

    spring, rest = prior.possible(start), rest_of(prior.possible(start))
    gain = likelihood.gain(rest) - prior.cost(spring)
    for _ in range(MOST_STEPS):
        slopes = np.stack([rest - rest_of(spring.moved(probe)) for probe in np.diag(PROBES)], axis=1) / PROBES
        variance = likelihood.alike * float(rest @ rest) / rest.size
        curvature = slopes.T @ slopes / variance + np.diag(prior.std**-2)
        pull = slopes.T @ rest / variance - prior.off(spring) / prior.std**2
        scaled = np.linalg.solve(curvature * np.outer(prior.std, prior.std), pull * prior.std)
        step = scaled * prior.std
        step /= max(1.0, float(np.max(np.abs(step) / LONGEST_STEP)))  # in its own direction: they stand for each other
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
    return Heard(spring, max(gain, before), curvature)
