"""Standard deviations and biases by a parametric bootstrap: the fit is simulated with the bench's errors and refitted.

A parametric bootstrap (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6 and 10). The smoothed motion
is taken for the true one and the fit for the true actuator. The measuring chain is as it was measured: noise and steps
of the torque readings, counts of the encoder, the instants at which readings are taken, and how unevenly commands
travel. Each simulated record goes the whole way of the real one, from readings to parameters. The scatter of the
parameters is their deviation; their mean distance from the values that were put in is their bias.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification.counts import resolution_of
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.joint_fit import remaining_power, solve_again
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.reading_errors import NO_ERRORS, ReadingErrors
from norton_bench.identification.rows import Rows
from norton_bench.identification.scatter import Scatter
from norton_bench.identification.separable import Solution
from norton_bench.identification.signals import (
    Signals,
    Span,
    TimeSeries,
    instants,
    positions_late_s,
    positions_of,
    signals,
    stream_of,
    travel_times_s,
)
from norton_bench.identification.simulated_bench import (
    Driving,
    SimulatedStretch,
    even_grid,
    inertia_of,
)
from norton_bench.records import Measured, Table
from norton_bench.segments import Use

# Values and their covariance from a solution: (p,), (p, p).
Physical = Callable[[Solution], tuple[FloatArray, FloatArray]]

# Simulated records of one fit. The deviation of a parameter is then known to within a fifth; Student's distribution
# allows for that.
DRAWS = 12
# And so many, before, without errors of the torque readings. They tell what all other errors leave to about a tenth.
OTHER_DRAWS, KNOWN_TO = 4, 0.1


@dataclass(frozen=True)
class ErrorsSeen:
    """The energy of an encoder's errors in the fit's band, as another encoder shows it.

    ``factor`` is how many times the energy that its own readings show, ``known_to`` the standard deviation of its
    logarithm. It moved the fit's values by ``moved`` (9,), in the order of ``physical``.
    """

    factor: float
    known_to: float
    moved: FloatArray

    def of(self, stretches: tuple[Signals, ...]) -> tuple[Signals, ...]:
        """Signals as they were read, with this energy."""
        return louder(stretches, self.factor)


@dataclass(frozen=True)
class Readings:
    """What a fit's signals were made of, and how many such records are to be simulated.

    ``ringing_nm`` (n,) was subtracted from the torque readings that a simulation uses (``ringing``). What is not known
    of its amplitudes makes values in the order of ``physical``, of the motor without a joint, covary by
    ``ringing_covariance`` (9, 9).
    ``errors_seen`` is what another encoder tells of the errors of the motion's readings, if it does.
    """

    measured: Measured
    tick_s: float
    use: Use
    draws: int = DRAWS
    coupling: Coupling | None = None  # where it is known
    ringing_nm: FloatArray | None = None
    ringing_covariance: FloatArray | None = None
    errors_seen: ErrorsSeen | None = None


def louder(stretches: tuple[Signals, ...], factor: float) -> tuple[Signals, ...]:
    """The same, with so many times the variance of the motion's own errors."""
    return tuple(replace(each, position_noise=factor * each.position_noise) for each in stretches)


def stated_energy(stretches: tuple[Signals, ...], kernel: Kernel) -> float:
    """Of the acceleration's errors in a band, as the readings alone show it, in the mean [rad²/s⁴]."""
    rows = [Rows(each, kernel) for each in stretches]
    return float(np.average([each.motion_noise(2) for each in rows], weights=[each.usable.size for each in rows]))


def scatter_of(bench: "Simulation", put_in: FloatArray, physical: Physical) -> Scatter:
    """Fit each simulated record again. ``put_in`` (p,) is what ``physical`` makes of the real one's solution."""
    fits, left = [], []
    for record, random in zip(bench.records(), np.random.default_rng(1).spawn(bench.readings.draws), strict=True):
        solution = solve_again(_signals(bench, record, random), bench.solution)
        fits.append(physical(solution))
        left.append(np.mean(solution.innovation**2))
    variances = np.array([np.diag(covariance) for _, covariance in fits])
    values = np.array([values for values, _ in fits])
    shares = np.array(left) / np.mean(bench.solution.innovation**2)
    return Scatter(values, put_in, variances, shares)


def _signals(bench: "Simulation", record: Measured, random: np.random.Generator) -> tuple[Signals, ...]:
    """Those of a simulated record, as a fit of it has them."""
    stretches = signals(record, bench.readings.tick_s, bench.readings.use)
    if (seen := bench.readings.errors_seen) is None:
        return stretches
    off, kernel = np.exp(seen.known_to * random.standard_normal()), bench.solution.regression.rows[0].kernel
    return louder(stretches, off * bench.error_energy(record, stretches) / stated_energy(stretches, kernel))


@dataclass(frozen=True)
class Encoder:
    """What one encoder read: ``rows`` of its table (n,), and ``late_s`` (n,), how much later than at even instants each
    was read, as far as arrivals tell."""

    rows: Table
    position: TimeSeries
    late_s: FloatArray
    errors: ReadingErrors = NO_ERRORS

    @classmethod
    def of(cls, table: Table, origin_ns: int) -> "Encoder":
        """Without errors."""
        rows = table[instants(table, origin_ns)[1]]
        return cls(rows, positions_of(rows, origin_ns), positions_late_s(rows, origin_ns))

    def with_errors(self) -> "Encoder":
        """With the errors that its own readings show; counts are told by what was read, and by nothing made of it."""
        steps = resolution_of(np.asarray(self.rows["position_rad"], dtype=np.float64))
        return replace(self, errors=ReadingErrors.of(self.position, steps))

    def along(self, truths: Sequence[SimulatedStretch]) -> tuple[FloatArray, FloatArray]:
        """Position and velocity at its readings, (n,) each, from its own zero; outside the stretches what it did read,
        and no velocity."""
        position_rad = np.asarray(self.rows["position_rad"], dtype=np.float64).copy()
        velocity_rad_s, read_s = np.zeros(position_rad.size), self.position.time_s + self.late_s
        for truth in truths:
            own = _within(self.position.time_s, truth.stretch.time_s)
            motion_rad = truth.motion(read_s[own])
            position_rad[own] = motion_rad + np.mean(position_rad[own] - motion_rad)
            velocity_rad_s[own] = truth.motion(read_s[own], 1)
        return position_rad, velocity_rad_s

    def read(self, motion: tuple[FloatArray, FloatArray], random: np.random.Generator) -> Table:
        """Readings of such a motion, with errors of their own."""
        return _with(self.rows, "position_rad", self.errors.drawn(*motion, random))


@dataclass(frozen=True)
class Simulation:
    """The bench as it was measured, with the fit for its actuator.

    ``other`` is the load's encoder, None where it stays as it was read: the load turns as the actuator does, less what
    the torque twists the sensor between them.
    """

    readings: Readings
    solution: Solution
    truths: tuple[SimulatedStretch, ...]
    encoder: Encoder
    torque_rows: Table
    torque: TimeSeries
    torque_errors: ReadingErrors
    travel_s: FloatArray  # of commands, about its mean: as readings on the same wire had it
    other: Encoder | None = None
    compliance_rad_nm: float = 0.0  # of the sensor

    @classmethod
    def of(cls, readings: Readings, stretches: tuple[Signals, ...], solution: Solution) -> "Simulation":
        """With the errors of its own readings."""
        return cls.without_errors(readings, stretches, solution)._with_errors()

    @classmethod
    def without_errors(cls, readings: Readings, stretches: tuple[Signals, ...], solution: Solution) -> "Simulation":
        """With perfect readings, at the instants at which they were read."""
        measured, origin_ns = readings.measured, stretches[0].origin_ns
        valid = measured.torque[measured.torque["valid"]]
        encoder = Encoder.of(measured.motion, origin_ns)
        torque_rows = valid[instants(valid, origin_ns)[1]]
        torque = stream_of(torque_rows, "torque_nm", origin_ns)
        return cls(
            readings,
            solution,
            tuple(SimulatedStretch.of(stretch, solution, readings.coupling) for stretch in stretches),
            encoder,
            torque_rows,
            torque,
            NO_ERRORS,
            _one_way_s(travel_times_s(measured.motion), encoder.late_s),
        )

    def _with_errors(self) -> "Simulation":
        """As measured, without what looks like the torque sensor's errors and is torque: commands that act between two
        readings, and ringing. A simulated record of even instants with the noise that was seen shows these as well."""
        seen = ReadingErrors.of(self.torque, resolution_of(self.torque.value))
        bench, random = replace(self, encoder=self.encoder.with_errors()), np.random.default_rng(0)
        port_nm = bench._at_port(random)
        even = replace(bench, torque_errors=replace(seen, jitter_s=0.0))
        shown = ReadingErrors.of(replace(self.torque, value=even._read_torque(port_nm, random)), seen.steps)
        noise_nm = float(np.sqrt(max(2.0 * seen.noise**2 - shown.noise**2, 0.0)))
        jitter_s = float(np.sqrt(max(seen.jitter_s**2 - shown.jitter_s**2, 0.0)))
        variance_std = float(np.hypot(seen.variance_std, shown.variance_std))
        errors = ReadingErrors(noise_nm, seen.steps, jitter_s, variance_std)
        rate_nm_s = np.gradient(port_nm, self.torque.time_s)[self._is_simulated]
        return replace(bench, torque_errors=errors.no_more_than(bench._left_for_torque_nm2(random), rate_nm_s))

    def _left_for_torque_nm2(self, random: np.random.Generator) -> float:
        """The variance of white errors of torque readings that, beside all other errors, would leave what the fit
        leaves in its band: none of them is greater. Ringing that no simulation knows is in the readings, but faster
        than the band. ``self`` has no errors of the torque readings."""
        records = (self.record(random) for _ in range(OTHER_DRAWS))
        of_others = [remaining_power(_signals(self, each, random), self.solution) for each in records]
        every = float(np.mean(self.solution.innovation**2))
        left = max(every - float(np.mean(of_others)), KNOWN_TO * every)
        regression, tick_s = self.solution.regression, self.readings.tick_s
        energy = regression.white_energy * regression.rows[0].kernel.energy(0)
        return left / energy * tick_s / self.torque.period_s

    @property
    def stretches(self) -> tuple[Signals, ...]:
        """What is simulated."""
        return tuple(truth.stretch for truth in self.truths)

    def over(self, others: tuple[Signals, ...]) -> "Simulation":
        """The same over ``others`` too, as far as no stretch of its own holds them already."""
        own = {stretch.time_s[0] for stretch in self.stretches}
        more = tuple(
            SimulatedStretch.of(other, self.solution, self.readings.coupling)
            for other in others
            if other.time_s[0] not in own
        )
        return replace(self, truths=(*self.truths, *more))

    def records(self) -> Iterator[Measured]:
        """Of the same experiment; always the same ones for the same recording."""
        for random in np.random.default_rng(0).spawn(self.readings.draws):
            yield self.record(random)

    def record(self, random: np.random.Generator) -> Measured:
        """What would have been measured, with errors of its own."""
        torque_nm = self._at_port(random)
        motion = self.encoder.read(self._of_actuator, random)
        torque = _with(self.torque_rows, "torque_nm", self._read_torque(torque_nm, random))
        record = replace(self.readings.measured, motion=motion, torque=torque)
        if self.other is None:
            return record
        of_load = self._of_load(replace(self.torque, value=torque_nm))
        return replace(record, load_motion=self.other.read(of_load, random))

    @cached_property
    def _is_simulated(self) -> npt.NDArray[np.bool_]:
        """Which torque readings lie in some stretch, (n,)."""
        result = np.zeros(self.torque.value.size, dtype=bool)
        for truth in self.truths:
            result[self.seen(truth)] = True
        return result

    def _at_port(self, random: np.random.Generator) -> FloatArray:
        """The torque at the instants of its readings, (n,); outside the stretches what was read."""
        torque_nm = self.torque.value.copy()
        coupling = None if self.readings.coupling is None else self.readings.coupling.drawn(random)
        for truth in self.truths:
            seen = self.seen(truth)
            torque_nm[seen] = self._torque(truth, self.torque.time_s[seen], coupling, random)
        return torque_nm

    def _read_torque(self, torque_nm: FloatArray, random: np.random.Generator) -> FloatArray:
        """Readings of such a torque, both (n,), with errors of their own; what is not simulated has its own already."""
        drawn_nm = self.torque_errors.drawn(torque_nm, np.gradient(torque_nm, self.torque.time_s), random)
        if self.readings.ringing_nm is not None:
            drawn_nm = drawn_nm - self.readings.ringing_nm
        return np.where(self._is_simulated, drawn_nm, torque_nm)

    def error_energy(self, record: Measured, stretches: tuple[Signals, ...]) -> float:
        """The true mean square of what a simulated record's errors make of the acceleration in the fit's band."""
        errors_rad = np.asarray(record.motion["position_rad"] - self._of_actuator[0], dtype=np.float64)
        errors = replace(self.encoder.position, value=errors_rad)
        rows = [Rows(each, self.solution.regression.rows[0].kernel) for each in stretches]
        parts = [each.derivatives(errors.at(each.signals.time_s), (2,))[0, each.usable] for each in rows]
        return float(np.mean(np.concatenate(parts) ** 2))

    def with_load(self, compliance_rad_nm: float) -> "Simulation":
        """The same with a load, whose encoder was read throughout, behind a sensor that the torque twists."""
        origin_ns = self.stretches[0].origin_ns
        other = Encoder.of(self.readings.measured.load_motion, origin_ns)
        return replace(self, other=other.with_errors(), compliance_rad_nm=compliance_rad_nm)

    @cached_property  # of every simulated record
    def _of_actuator(self) -> tuple[FloatArray, FloatArray]:
        return self.encoder.along(self.truths)

    @cached_property
    def _of_untwisted_load(self) -> tuple[FloatArray, FloatArray]:
        assert self.other is not None
        return self.other.along(self.truths)

    def _of_load(self, torque: TimeSeries) -> tuple[FloatArray, FloatArray]:
        """Its motion under this torque, at its own readings."""
        assert self.other is not None
        (position_rad, velocity_rad_s), time_s = self._of_untwisted_load, self.other.position.time_s
        at_nm = np.interp(time_s - self.solution.shape.motion_delay_s, torque.time_s, torque.value)
        return position_rad - self.compliance_rad_nm * at_nm, velocity_rad_s

    def _torque(
        self, truth: SimulatedStretch, time_s: FloatArray, coupling: Coupling | None, random: np.random.Generator
    ) -> FloatArray:
        travel_s = random.choice(self.travel_s, truth.stretch.sent_s.size)
        if averaging_s := truth.stretch.torque_averaging_s:
            time_s = time_s + averaging_s * random.uniform(-0.5, 0.5, time_s.size)
        torque_nm = truth.torque(self.solution, travel_s)(time_s)
        if coupling is None:
            return torque_nm
        return torque_nm + self.driving(truth, coupling, travel_s).ringing_at(time_s, coupling)

    def driving(self, truth: SimulatedStretch, coupling: Coupling, travel_s: FloatArray | None = None) -> Driving:
        """What makes the coupling ring in one stretch; the mean over ``travel_s`` (commands,) where it is not given."""
        begin_s, end_s = truth.time_s[0], truth.time_s[-1]
        return self.driving_within((begin_s, end_s), truth, coupling, travel_s)

    def driving_within(
        self, span_s: Span, truth: SimulatedStretch, coupling: Coupling, travel_s: FloatArray | None = None
    ) -> Driving:
        """The same in a part of it."""
        at_s = even_grid(*span_s, truth.stretch.tick_s, coupling.resonance_hz(inertia_of(self.solution)))
        if travel_s is not None:
            return Driving.of(truth, self.solution, coupling, travel_s, at_s)
        usual_s = np.zeros(truth.stretch.sent_s.size)
        return Driving.of(truth, self.solution, coupling, usual_s, at_s).blurred(float(np.std(self.travel_s)))

    def seen(self, truth: SimulatedStretch) -> npt.NDArray[np.int64]:
        """Which torque readings lie in a stretch."""
        return _within(self.torque.time_s, truth.stretch.time_s)


def _one_way_s(travel_s: FloatArray, late_s: FloatArray) -> FloatArray:
    """Of commands, where answers to them travelled for ``travel_s`` both ways: arrivals tell of a reading's instant the
    share that the command has in the variance of both. All of it where readings come by themselves."""
    share = float(np.std(late_s) / max(float(np.std(travel_s)), 1e-300))
    return travel_s * np.sqrt(share) if share > 0.0 else travel_s


def _with(table: Table, column: str, values: FloatArray) -> Table:
    other = table.copy()
    other[column] = values
    return other


def _within(time_s: FloatArray, span_s: FloatArray) -> npt.NDArray[np.int64]:
    """Which of ``time_s`` lie in a span."""
    return np.arange(*np.searchsorted(time_s, [span_s[0], span_s[-1]]))
