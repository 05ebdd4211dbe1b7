"""Deviations and biases from this bench's own errors: what was identified is simulated, and fitted again.

A parametric bootstrap (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6 and 10). The smoothed motion
is taken for the true one and the fit for the true actuator. The measuring chain is as it was measured: noise and steps
of the torque readings, counts of the encoder, the instants at which readings are taken, and how unevenly commands
travel. Each simulated record goes the whole way of the real one, from readings to parameters. The scatter of the
parameters is their deviation; their mean distance from the values that were put in is their bias.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline, make_interp_spline

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.identification import loops, noise
from norton_bench.identification.coupling import Coupling, likeliest
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.quantisation import resolution_rad
from norton_bench.identification.regression import COULOMB, DAMPING, GAIN, INERTIA, LINEAR, VISCOUS, Regression
from norton_bench.identification.separable import Solution, solve_again
from norton_bench.identification.signals import (
    FINE,
    Signals,
    Stream,
    instants,
    positions_late_s,
    positions_of,
    signals,
    stream_of,
)
from norton_bench.identification.timing import travel_s
from norton_bench.identification.verdict import LOOSE_BEYOND
from norton_bench.records import Measured, Table
from norton_bench.segments import Use

Spectrum = npt.NDArray[np.complex128]
# Values and their covariance from a solution and the instants of its rows: (p,), (p, p).
Physical = Callable[[Solution, FloatArray], tuple[FloatArray, FloatArray]]

# Simulated records of one fit. The deviation of a parameter is then known to within a fifth; Student's distribution
# allows for that.
DRAWS = 12
NORMAL_95 = 1.96  # deviations
# The simulated friction follows the path this many times as finely as the fit does.
FINER = 4
# Noise is told from errors of the instants by readings in blocks of so many, fast ones and slow ones.
BLOCK = 100
# The motion that was measured tells the port's torque up to nearly half the rate of the readings. Above that, inertia
# and coupling alone decide what the sensor feels of the motors.
PORT = Kernel(cutoff=0.45, half_width=24.0)
# What readings tell of a motion without loss, and no more: a shaft does not move faster than that.
SHAFT = Kernel(cutoff=0.22, half_width=16.0)
NO_RESTS = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class ReadingErrors:
    """Errors of one stream's readings, as measured: independent noise, a step in which values come, and how far the
    instants at which they are taken scatter."""

    noise: float
    step: float
    jitter_s: float

    @classmethod
    def of(cls, stream: Stream, step: float) -> "ReadingErrors":
        """The variance of a reading's error is a + b·rate²: b is that of its instant."""
        squares = np.diff(stream.value, noise.ORDER) ** 2 / noise.VARIANCE
        rate = np.gradient(stream.value, stream.time_s)[noise.ORDER // 2 : -(noise.ORDER // 2)]
        count = squares.size // BLOCK
        if count < noise.FEWEST_BLOCKS:
            return cls(0.0, step, 0.0)
        blocks = squares[: count * BLOCK].reshape(count, BLOCK)
        # The median passes over shocks; for normal errors it is this much of the mean.
        power = np.median(blocks, axis=1) / noise.NORMAL_MEDIAN_SQUARE
        speed = np.mean(rate[: count * BLOCK].reshape(count, BLOCK) ** 2, axis=1)
        constant, slope = _line(speed, power)
        return cls(float(np.sqrt(max(constant - step**2 / 12, 0.0))), step, float(np.sqrt(slope)))

    def drawn(self, values: FloatArray, rate: FloatArray, random: np.random.Generator) -> FloatArray:
        """Readings of ``values`` (n,), which change at ``rate`` (n,)."""
        read = values + self.jitter_s * rate * random.standard_normal(values.size)
        read += self.noise * random.standard_normal(values.size)
        if self.step == 0.0:
            return read
        zero = self.step * random.uniform()
        return np.asarray(np.round((read + zero) / self.step) * self.step - zero)


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Intercept and slope, neither negative, of values whose scatter goes with their size: shape (n,) each."""
    constant, slope = float(np.median(y)), 0.0
    for _ in range(10):
        weight = 1.0 / np.maximum(constant + slope * x, 1e-30) ** 2
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        spread = float(np.average((x - mean_x) ** 2, weights=weight))
        slope = max(float(np.average((x - mean_x) * (y - mean_y), weights=weight)) / spread, 0.0) if spread > 0 else 0.0
        constant = mean_y - slope * mean_x
        if constant < 0.0:
            constant, slope = 0.0, float(np.average(y, weights=weight) / mean_x)
    return constant, slope


@dataclass(frozen=True)
class Truth:
    """One stretch as if the fit were true: its motion, and the torque under that motion without a command.

    ``motion`` is on the motion's clock, ``passive_nm`` (n,) at ``time_s`` on the torque's, FINE times a tick.
    """

    stretch: Signals
    motion: BSpline
    time_s: FloatArray
    passive_nm: FloatArray

    @classmethod
    def of(cls, stretch: Signals, solution: Solution) -> "Truth":
        shape, linear = solution.shape, solution.linear
        step_s = stretch.tick_s / FINE
        time_s = stretch.time_s[0] + np.arange(stretch.path_rad.size) * step_s
        motion = make_interp_spline(time_s, _filtered(stretch.path_rad, SHAFT), k=5)
        finer_s = time_s[0] + shape.motion_delay_s + np.arange(time_s.size * FINER) * (step_s / FINER)
        finer_s = np.clip(finer_s, time_s[0], time_s[-1])
        at_s = finer_s[::FINER]
        path, velocity, acceleration = motion(at_s), motion(at_s, 1), motion(at_s, 2)
        h = loops.friction_path(motion(finer_s), shape.s_per_rad, NO_RESTS)[0]
        rate = np.gradient(h, step_s / FINER) / shape.s_per_rad
        torque = -linear[INERTIA] * acceleration - linear[VISCOUS] * velocity
        torque -= linear[COULOMB] * h[::FINER] + linear[DAMPING] * rate[::FINER]
        for index, periods in enumerate(solution.regression.cogging):
            cosine, sine = linear[len(LINEAR) + 2 * index : len(LINEAR) + 2 * index + 2]
            torque += cosine * np.cos(periods * path) + sine * np.sin(periods * path)
        return cls(stretch, motion, time_s, torque)

    def torque(self, solution: Solution, travel_s: FloatArray, coupling: Coupling | None) -> BSpline:
        """At the port, on the torque's clock, where each command travelled longer than usual by ``travel_s`` (m,)."""
        motor_nm = self.motor(solution, travel_s)
        torque = self._passive_in_band_nm + _filtered(motor_nm, PORT, of_means=True)
        if coupling is not None:
            torque += self.quick(motor_nm, coupling, inertia_of(solution))
        return make_interp_spline(self.time_s, torque, k=3)

    def driving(self, solution: Solution, coupling: Coupling, travel_std_s: float) -> Spectrum:
        """What makes the coupling ring (see :meth:`quick`), on average over commands that travel so unevenly."""
        usual_nm = self.motor(solution, np.zeros(self.stretch.sent_s.size))
        phase_rad = 2 * np.pi * self._frequency_hz * travel_std_s
        return self._driving(usual_nm, coupling, inertia_of(solution)) * np.exp(-0.5 * phase_rad**2)

    def ringing(self, driving: Spectrum, solution: Solution, coupling: Coupling) -> BSpline:
        """The torque that the sensor feels of it, above PORT's band."""
        return make_interp_spline(self.time_s, self._rung(driving, coupling, inertia_of(solution)), k=3)

    def motor(self, solution: Solution, travel_s: FloatArray) -> FloatArray:
        """Behind the amplifier's lag, (n,)."""
        stretch, shape = self.stretch, solution.shape
        acts_s = np.maximum.accumulate(stretch.sent_s + travel_s) + shape.command_delay_s  # nothing overtakes
        return np.asarray(
            solution.linear[GAIN]
            * self.lag(acts_s, stretch.command, shape.bandwidth_rad_s, released=stretch.released_at_zero)
        )

    @cached_property  # of every simulated record
    def _passive_in_band_nm(self) -> FloatArray:
        return _filtered(self.passive_nm, PORT)

    def lag(self, acts_s: FloatArray, command: FloatArray, bandwidth_rad_s: float, *, released: bool) -> FloatArray:
        """Of commands (m,) that act from these instants on: (n,)."""
        step_s = self.stretch.tick_s / FINE
        return np.asarray(
            loops.mean_lag_of_held(acts_s, command, bandwidth_rad_s, self.time_s[0], step_s, self.time_s.size, released)
        )

    def quick(self, motor_nm: FloatArray, coupling: Coupling, inertia_kgm2: float) -> FloatArray:
        """What the sensor feels of both motors above PORT's band, (n,)."""
        return self._rung(self._driving(motor_nm, coupling, inertia_kgm2), coupling, inertia_kgm2)

    def _driving(self, motor_nm: FloatArray, coupling: Coupling, inertia_kgm2: float) -> Spectrum:
        """The difference of the accelerations that both motors give, above PORT's band."""
        load_nm = coupling.load_gain * self.lag(
            coupling.sent_s + coupling.load_delay_s,
            coupling.command_nm,
            coupling.load_bandwidth_rad_s,
            released=coupling.load_released_at_zero,
        )
        driving = motor_nm / inertia_kgm2 - load_nm / coupling.load_inertia_kgm2
        return np.asarray(np.fft.rfft(driving - _filtered(driving, PORT, of_means=True)))

    @cached_property  # of every ringing
    def _frequency_hz(self) -> FloatArray:
        return np.asarray(np.fft.rfftfreq(self.time_s.size, self.stretch.tick_s / FINE))

    def _rung(self, driving: Spectrum, coupling: Coupling, inertia_kgm2: float) -> FloatArray:
        response = coupling.response(self._frequency_hz, inertia_kgm2)
        return np.asarray(np.fft.irfft(driving * response, self.time_s.size), dtype=np.float64)


def inertia_of(solution: Solution) -> float:
    return abs(float(solution.linear[INERTIA]))


def _filtered(values: FloatArray, kernel: Kernel, *, of_means: bool = False) -> FloatArray:
    """A signal known FINE times a tick, or its means over these steps, through a low-pass."""
    reach = round(kernel.half_width * FINE)
    taps = kernel.taps(np.arange(-reach, reach + 1) / FINE, 0, of_means=of_means, exact_to=3)[None, :]
    return np.asarray(loops.filter_at(values, taps, -reach, 1, values.size)[0])


@dataclass(frozen=True)
class Readings:
    """What a fit's signals were made of, and how many such records are to be simulated."""

    measured: Measured
    tick_s: float
    use: Use
    draws: int = DRAWS
    coupling: Coupling | None = None  # where it is known


@dataclass(frozen=True)
class Scatter:
    """What fits of simulated records gave, beside what was put in.

    ``drawn`` (draws, p) are the values, ``put_in`` (p,); ``stated_std`` (p,) is what such fits say of themselves, from
    their residuals alone, rms over the draws.
    """

    drawn: FloatArray
    put_in: FloatArray
    stated_std: FloatArray

    @property
    def bias(self) -> FloatArray:
        """Mean of what comes out less what was put in, (p,)."""
        return np.asarray(np.mean(self.drawn, axis=0) - self.put_in)

    @property
    def std(self) -> FloatArray:
        """Of one fit, (p,), as wide as few draws make it: with it 1.96 deviations hold 95 %."""
        draws = len(self.drawn)
        few = t_quantile(0.975, draws - 1) / NORMAL_95
        return np.asarray(few * np.std(self.drawn, axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / draws))

    @property
    def bias_std(self) -> FloatArray:
        """Of the bias that is taken off, (p,). The smoothed motion is not the true one: anything between no bias and
        twice the one seen is held to be as likely, which deviates by the bias over the square root of 3."""
        return np.asarray(np.abs(self.bias) / np.sqrt(3.0))

    def applied(self, values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values without their bias, and their covariance, from those that the residual alone gives: (p,), (p, p).

        Where the real residual gives a greater deviation than simulated ones do, the model or the noise is not as was
        simulated: the difference of the squares is added. Nothing becomes better known than the residual says.
        """
        stated = np.sqrt(np.diag(covariance))
        unexplained = np.maximum(stated**2 - self.stated_std**2, 0.0)
        scattered = np.maximum(self.std**2 + unexplained, stated**2)
        std = np.sqrt(scattered + self.bias_std**2)
        # A bias of such a share of the value says only that nothing is known: it widens, and is not taken off.
        credible = np.abs(self.bias) < LOOSE_BEYOND * np.abs(values)
        corrected = values - np.where(credible, self.bias, 0.0)
        return corrected, covariance * np.outer(std / stated, std / stated)


def scatter_of(bench: "Simulation", put_in: FloatArray, physical: Physical) -> Scatter:
    """Fit each simulated record again. ``put_in`` (p,) is what ``physical`` makes of the real one's solution."""
    fits = [physical(each, each.regression.time_s()) for each in _solutions(bench)]
    variances = np.array([np.diag(covariance) for _, covariance in fits])
    return Scatter(np.array([values for values, _ in fits]), put_in, np.sqrt(np.mean(variances, axis=0)))


def _solutions(bench: "Simulation") -> Iterator[Solution]:
    """What the fit makes of each simulated record."""
    for record in bench.records():
        yield solve_again(signals(record, bench.readings.tick_s, bench.readings.use), bench.solution)


@dataclass(frozen=True)
class Ringing:
    """Of the coupling, as it was read; ``driving`` is what makes it ring, one a stretch."""

    simulation: "Simulation"
    driving: tuple[Spectrum, ...]

    @classmethod
    def of(cls, simulation: "Simulation", coupling: Coupling) -> "Ringing":
        uneven_s = float(np.std(simulation.travel_s))
        return cls(
            simulation, tuple(truth.driving(simulation.solution, coupling, uneven_s) for truth in simulation.truths)
        )

    def read(self, spring: Coupling, band: Kernel) -> FloatArray:
        """Of each sample in ``band``, what of its torque is the ringing of ``spring``, (samples,)."""
        solution, torque = self.simulation.solution, self.simulation.torque
        stretches = []
        for truth, driving in zip(self.simulation.truths, self.driving, strict=True):
            read = replace(torque, value=truth.ringing(driving, solution, spring)(torque.time_s))
            read.value[(torque.time_s < truth.time_s[0]) | (torque.time_s > truth.time_s[-1])] = 0.0
            stretches.append(replace(truth.stretch, torque_nm=read.at(truth.stretch.time_s)))
        return Regression.of(tuple(stretches), band).target()


@dataclass(frozen=True)
class Heard:
    """What readings show of the coupling's ringing, beside what the model's unknowns could make of it.

    ``left`` (samples,) is what the fit left, ``unknowns`` (samples, k) an orthonormal base of its columns, both as
    least squares saw them.
    """

    ringing: Ringing
    left: FloatArray
    unknowns: FloatArray

    @classmethod
    def of(cls, simulation: "Simulation", coupling: Coupling) -> "Heard":
        solution = simulation.solution
        unknowns = np.linalg.qr(solution.jacobian)[0]
        left = solution.innovation - unknowns @ (unknowns.T @ solution.innovation)
        return cls(Ringing.of(simulation, coupling), left, unknowns)

    def gain(self, spring: Coupling) -> float:
        """The logarithm of how much likelier the readings are with this ringing than with none: rows that are alike
        count as one, and the variance of what is left is the likeliest."""
        regression = self.ringing.simulation.solution.regression
        rung = regression.white(self.ringing.read(spring, regression.rows[0].kernel)[None, :])[0]
        rest = self.left - (rung - self.unknowns @ (self.unknowns.T @ rung))
        return float(-0.5 * self.left.size / regression.alike * np.log((rest @ rest) / (self.left @ self.left)))


@dataclass(frozen=True)
class Simulation:
    """The bench as it was measured, with the fit for its actuator."""

    readings: Readings
    solution: Solution
    truths: tuple[Truth, ...]
    motion_rows: Table
    torque_rows: Table
    position: Stream
    torque: Stream
    position_errors: ReadingErrors
    torque_errors: ReadingErrors
    late_s: FloatArray  # how much later than at even instants positions were read, as far as arrivals tell
    travel_s: FloatArray  # of commands, about its mean: as readings on the same wire had it

    @classmethod
    def of(cls, readings: Readings, stretches: tuple[Signals, ...], solution: Solution) -> "Simulation":
        measured, origin_ns = readings.measured, stretches[0].origin_ns
        valid = measured.torque[measured.torque["valid"]]
        motion_rows = measured.motion[instants(measured.motion, origin_ns)[1]]
        torque_rows = valid[instants(valid, origin_ns)[1]]
        position, late_s = positions_of(motion_rows, origin_ns), positions_late_s(motion_rows, origin_ns)
        torque = stream_of(torque_rows, "torque_nm", origin_ns)
        bench = cls(
            readings,
            solution,
            tuple(Truth.of(stretch, solution) for stretch in stretches),
            motion_rows,
            torque_rows,
            position,
            torque,
            ReadingErrors.of(position, stretches[0].count_rad),
            ReadingErrors.of(torque, resolution_rad(torque.value)),
            late_s,
            _one_way_s(travel_s(measured.motion["arrival_ns"]), late_s),
        )
        return bench._with_spring_heard()._without_signal_in_noise()

    def _with_spring_heard(self) -> "Simulation":
        """The same with the coupling's spring as the readings that were fitted tell it, too."""
        coupling, inertia_kgm2 = self.readings.coupling, inertia_of(self.solution)
        # Slower ringing is read as it is: nothing of it is folded.
        if coupling is None or coupling.resonance_hz(inertia_kgm2) < 0.5 / self.torque.period_s:
            return self
        spring = likeliest(coupling, inertia_kgm2, Heard.of(self, coupling).gain)
        return replace(self, readings=replace(self.readings, coupling=spring))

    def _without_signal_in_noise(self) -> "Simulation":
        """The same without what looks like the torque sensor's errors and is torque: commands that act between two
        readings, and ringing. A simulated record of even instants with the noise that was seen shows these as well."""
        seen = self.torque_errors
        even = replace(self, torque_errors=replace(seen, jitter_s=0.0)).record(np.random.default_rng(0))
        values = np.asarray(even.torque["torque_nm"], dtype=np.float64)
        shown = ReadingErrors.of(replace(self.torque, value=values), seen.step)
        noise_nm = float(np.sqrt(max(2.0 * seen.noise**2 - shown.noise**2, 0.0)))
        jitter_s = float(np.sqrt(max(seen.jitter_s**2 - shown.jitter_s**2, 0.0)))
        return replace(self, torque_errors=ReadingErrors(noise_nm, seen.step, jitter_s))

    def over(self, others: tuple[Signals, ...]) -> "Simulation":
        """The same over ``others`` too, as far as no stretch of its own holds them already."""
        own = {truth.stretch.time_s[0] for truth in self.truths}
        more = tuple(Truth.of(other, self.solution) for other in others if other.time_s[0] not in own)
        return replace(self, truths=(*self.truths, *more))

    def records(self) -> Iterator[Measured]:
        """Of the same experiment; always the same ones for the same recording."""
        for random in np.random.default_rng(0).spawn(self.readings.draws):
            yield self.record(random)

    def record(self, random: np.random.Generator) -> Measured:
        """What would have been measured, with errors of its own."""
        position_rad, velocity_rad_s = self._motion
        torque_nm, seen_at_all = self.torque.value.copy(), np.zeros(self.torque.value.size, dtype=bool)
        coupling = None if self.readings.coupling is None else self.readings.coupling.drawn(random)
        for truth in self.truths:
            seen = _within(self.torque.time_s, truth.stretch.time_s)
            torque_nm[seen] = self._torque(truth, self.torque.time_s[seen], coupling, random)
            seen_at_all[seen] = True
        rate_nm_s = np.gradient(torque_nm, self.torque.time_s)
        position_rad = self.position_errors.drawn(position_rad, velocity_rad_s, random)
        drawn_nm = self.torque_errors.drawn(torque_nm, rate_nm_s, random)
        torque_nm = np.where(seen_at_all, drawn_nm, torque_nm)  # what is not simulated has its errors already
        return replace(
            self.readings.measured,
            motion=_with(self.motion_rows, "position_rad", position_rad),
            torque=_with(self.torque_rows, "torque_nm", torque_nm),
        )

    @cached_property  # of every simulated record
    def _motion(self) -> tuple[FloatArray, FloatArray]:
        """Position and velocity at the encoder's readings, (n,) each; zero velocity outside the stretches."""
        position_rad = np.asarray(self.motion_rows["position_rad"], dtype=np.float64).copy()
        velocity_rad_s, read_s = np.zeros(position_rad.size), self.position.time_s + self.late_s
        for truth in self.truths:
            own = _within(self.position.time_s, truth.stretch.time_s)
            position_rad[own] = truth.motion(read_s[own])
            velocity_rad_s[own] = truth.motion(read_s[own], 1)
        return position_rad, velocity_rad_s

    def _torque(
        self, truth: Truth, time_s: FloatArray, coupling: Coupling | None, random: np.random.Generator
    ) -> FloatArray:
        travel_s = random.choice(self.travel_s, truth.stretch.sent_s.size)
        if averaging_s := truth.stretch.torque_averaging_s:
            time_s = time_s + averaging_s * random.uniform(-0.5, 0.5, time_s.size)
        return np.asarray(truth.torque(self.solution, travel_s, coupling)(time_s))


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
