"""One stretch of a bench as if its fit were true, and the errors that its readings have.

The smoothed motion is taken for the true one and the fit for the true actuator. The measuring chain is as it was
measured: noise and steps of the torque readings, counts of the encoder, the instants at which readings are taken, and
how unevenly commands travel."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi, sqrt

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import minimize

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.fed_back import lag_of_place
from norton_bench.identification.joint_regression import Driven, JointRegression
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.readings import NOISE_FEWEST_BLOCKS, NOISE_ORDER, NOISE_VARIANCE, NORMAL_MEDIAN_SQUARE
from norton_bench.identification.separable import Solution
from norton_bench.identification.shape import COULOMB, DAMPING, GAIN, INERTIA, LINEAR, VISCOUS, Shape
from norton_bench.identification.signals import FINE, Signals, TimeSeries
from norton_bench.models.terms import LIGHTEST_OUTPUT, OUTPUT_INERTIA, Factor
from norton_drivers.servo import Servo

# A stiff sensor twists too little for its damping to be seen; no bolted joint has less than this share of critical.
LEAST_DAMPING_RATIO = 0.005
# Of critical damping: from that to a joint's that rubs, and beyond (Bachmann et al., Vibration Problems in Structures,
# 1995, app. C).
RATIOS = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
# A ringing is heard where readings are likelier for one end of these than for the other by very strong evidence, as a
# logarithm (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995).
AUDIBLE = 5.0
# Of the search, which ends where steps are a small part of what is known.
MOST_TRIES = 30
CLOSE, LITTLE_LIKELIER = 0.02, 0.1
SMALLEST_NMS_RAD = 1e-12  # of a damping that somebody knows for sure
# Steps of the curvature: of the stiffness, in deviations, and of the damping's logarithm.
PROBES = (0.2, 0.1)


# The spring between the two motors, as far as the torque sensor's readings feel it.
def least_damping_nms_rad(stiffness_nm_rad: float, mobility_1_kgm2: float) -> float:
    """Of a spring between two inertias; ``mobility_1_kgm2`` is the sum of their inverses."""
    return 2 * LEAST_DAMPING_RATIO * sqrt(max(stiffness_nm_rad, 0.0) / mobility_1_kgm2)


@dataclass(frozen=True)
class Coupling:
    """What the calibration tells of it and of the load drive, whose delay is on the torque's clock.

    Steps of the commands reach the sensor through it faster than its readings come, and sampling folds them down into
    the band that is fitted. ``command_nm`` (m,) was sent to the load drive at ``sent_s`` (m,).
    """

    stiffness_nm_rad: float
    stiffness_std_nm_rad: float
    damping_nms_rad: float
    damping_std_nms_rad: float
    load_inertia_kgm2: float
    load_gain: float
    load_bandwidth_rad_s: float
    load_delay_s: float
    sent_s: FloatArray
    command_nm: FloatArray
    load_released_at_zero: bool = False  # as in records.Chain

    def drawn(self, random: np.random.Generator) -> "Coupling":
        """One of the springs that this may be: where its resonance lies near the rate of the readings, a little more or
        less of either decides how much of the steps the readings fold down."""
        stiffer = self.stiffer(random.standard_normal())
        damping_nms_rad = self.damping_nms_rad + self.damping_std_nms_rad * random.standard_normal()
        return replace(stiffer, damping_nms_rad=damping_nms_rad)

    def stiffer(self, deviations: float) -> "Coupling":
        """By so many deviations of the stiffness's logarithm."""
        factor = float(np.exp(deviations * self.stiffness_std_nm_rad / self.stiffness_nm_rad))
        return replace(self, stiffness_nm_rad=self.stiffness_nm_rad * factor)

    def resonance_hz(self, inertia_kgm2: float) -> float:
        """At which both inertias ring on the spring, that of the actuator being ``inertia_kgm2``."""
        mobility = 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2
        return sqrt(self.stiffness_nm_rad * mobility) / (2 * pi)

    def damped(self, ratio: float, inertia_kgm2: float) -> "Coupling":
        """The same spring with this share of critical damping."""
        mobility = 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2
        return replace(self, damping_nms_rad=2 * ratio * sqrt(self.stiffness_nm_rad / mobility))

    def response(self, frequency_hz: FloatArray, inertia_kgm2: float) -> npt.NDArray[np.complex128]:
        """Torque of the spring over the difference of the accelerations that drive its ends [N m s²/rad], (n,)."""
        mobility = 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2
        s = 2j * np.pi * frequency_hz
        damping = max(self.damping_nms_rad, least_damping_nms_rad(self.stiffness_nm_rad, mobility))
        spring = self.stiffness_nm_rad + damping * s
        return np.asarray(spring / (s**2 + mobility * spring))


def likeliest(coupling: Coupling, inertia_kgm2: float, gain: Callable[[Coupling], float]) -> Coupling:
    """The same with the likeliest spring, and how well that is known then.

    The calibration hardly tells the damping of a stiff spring, but sampled ringing may show it: ``gain`` is the
    logarithm of a spring's likelihood, but for a constant. What the calibration tells is the prior, normal. The search
    begins at the best of some shares of critical damping; the deviations are those of a normal peak (Laplace).
    """
    if np.ptp([gain(coupling.damped(ratio, inertia_kgm2)) for ratio in (RATIOS[0], RATIOS[-1])]) < AUDIBLE:
        return coupling

    def spring(at: FloatArray) -> Coupling:
        return coupling.stiffer(float(at[0])).damped(float(np.exp(at[1])), inertia_kgm2)

    def cost(at: FloatArray) -> float:
        tried = spring(at)
        off = (tried.damping_nms_rad - coupling.damping_nms_rad) / max(coupling.damping_std_nms_rad, SMALLEST_NMS_RAD)
        return 0.5 * float(at[0] ** 2 + off**2) - gain(tried)

    start = min((np.array([0.0, np.log(ratio)]) for ratio in RATIOS), key=cost)
    simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    best = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": MOST_TRIES, "xatol": CLOSE, "fatol": LITTLE_LIKELIER},
    ).x
    best[1] = np.clip(best[1], np.log(LEAST_DAMPING_RATIO), 0.0)
    result, least = spring(best), cost(best)
    stiffer, damped = (_deviation(cost(best - step), least, cost(best + step), max(step)) for step in np.diag(PROBES))
    relative = coupling.stiffness_std_nm_rad / coupling.stiffness_nm_rad
    return replace(
        result,
        stiffness_std_nm_rad=result.stiffness_nm_rad * relative * min(stiffer, 1.0),
        damping_std_nms_rad=min(result.damping_nms_rad * damped, coupling.damping_std_nms_rad),
    )


def _deviation(before: float, least: float, after: float, step: float) -> float:
    """Of a normal peak, from negative logarithms at it and a step to either side; infinite where they are flat."""
    curvature = (before - 2.0 * least + after) / step**2
    return 1.0 / sqrt(curvature) if curvature > 0.0 else float("inf")


Spectrum = npt.NDArray[np.complex128]
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
    """One stretch of a bench as if its fit were true, and the errors that its readings have.

    The smoothed motion is taken for the true one and the fit for the true actuator. The measuring chain is as it
    was measured: noise and steps of the torque readings, counts of the encoder, the instants at which readings are
    taken, and how unevenly commands travel.

    Errors of one stream's readings, as measured: independent noise, a step in which values come, and how far the
    instants at which they are taken scatter.
    """

    noise: float
    step: float
    jitter_s: float

    @classmethod
    def of(cls, stream: TimeSeries, step: float) -> "ReadingErrors":
        """The variance of a reading's error is a + b·rate²: b is that of its instant."""
        squares = np.diff(stream.value, NOISE_ORDER) ** 2 / NOISE_VARIANCE
        rate = np.gradient(stream.value, stream.time_s)[NOISE_ORDER // 2 : -(NOISE_ORDER // 2)]
        count = squares.size // BLOCK
        if count < NOISE_FEWEST_BLOCKS:
            return cls(0.0, step, 0.0)
        blocks = squares[: count * BLOCK].reshape(count, BLOCK)
        # The median passes over shocks; for normal errors it is this much of the mean.
        power = np.median(blocks, axis=1) / NORMAL_MEDIAN_SQUARE
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
class SimulatedStretch:
    """One stretch as if the fit were true: its motion, and the torque under that motion without a command.

    ``motion`` is on the motion's clock, ``passive_nm`` (n,) at ``time_s`` on the torque's, FINE times a tick.
    """

    stretch: Signals
    motion: BSpline
    time_s: FloatArray
    passive_nm: FloatArray

    @classmethod
    def of(cls, stretch: Signals, solution: Solution) -> "SimulatedStretch":
        shape, linear = solution.shape, solution.linear
        step_s = stretch.tick_s / FINE
        time_s = stretch.time_s[0] + np.arange(stretch.path_rad.size) * step_s
        motion = make_interp_spline(time_s, _filtered(stretch.path_rad, SHAFT), k=5)
        finer_s = time_s[0] + shape.motion_delay_s + np.arange(time_s.size * FINER) * (step_s / FINER)
        finer_s = np.clip(finer_s, time_s[0], time_s[-1])
        at_s = finer_s[::FINER]
        path, velocity, acceleration = motion(at_s), motion(at_s, 1), motion(at_s, 2)
        if isinstance(solution.regression, JointRegression):  # the motor behind it moves as it is driven
            return cls(stretch, motion, time_s, -output_of(solution) * acceleration)
        strengths, middle_s = loops.EVEN, solution.regression.rows[0].middle_s
        if shape.changes(Factor.STRENGTH):
            port_nm = _port(stretch, solution, finer_s - shape.motion_delay_s)
            strengths = shape.strength(motion(finer_s, 1), motion(finer_s), port_nm, finer_s - middle_s)
        h = loops.friction_path_of(motion(finer_s), shape.s_per_rad, NO_RESTS, strengths)[0]
        rate = np.gradient(h, step_s / FINER) / shape.s_per_rad
        damped = velocity * shape.damping(velocity, at_s - middle_s)
        torque = -linear[INERTIA] * acceleration - linear[VISCOUS] * damped
        torque -= linear[COULOMB] * h[::FINER] + linear[DAMPING] * rate[::FINER]
        for index, periods in enumerate(solution.regression.cogging):
            cosine, sine = linear[len(LINEAR) + 2 * index : len(LINEAR) + 2 * index + 2]
            torque += cosine * np.cos(periods * path) + sine * np.sin(periods * path)
        return cls(stretch, motion, time_s, torque)

    def torque(self, solution: Solution, travel_s: FloatArray, coupling: Coupling | None) -> BSpline:
        """At the port, on the torque's clock, where each command travelled longer than usual by ``travel_s`` (m,)."""
        motor_nm = self.motor(solution, travel_s)
        of_means = not isinstance(solution.regression, JointRegression)
        torque = self._passive_in_band_nm + _filtered(motor_nm, PORT, of_means=of_means)
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
        """What drives the output, behind the amplifier's lag and the joint if there is one, (n,)."""
        stretch, shape = self.stretch, solution.shape
        acts_s = np.maximum.accumulate(stretch.sent_s + travel_s) + shape.command_delay_s  # nothing overtakes
        if isinstance(solution.regression, JointRegression):  # whose steps take means from one sample to the next
            acts_s -= 0.5 * stretch.tick_s / FINE
        lag = self.lag(acts_s, stretch.command, shape.bandwidth_rad_s, released=stretch.released_at_zero)
        if isinstance(solution.regression, JointRegression):
            return self._of_joint(solution.regression, shape, lag)
        if stretch.servo is not None:
            lag = lag - self._held_back(shape, stretch.servo)
        if shape.changes(Factor.GAIN):
            read_s = np.clip(self.time_s + shape.motion_delay_s, self.time_s[0], self.time_s[-1])
            lag = lag * shape.gain(lag, self.motion(read_s), self.time_s - solution.regression.rows[0].middle_s)
        return np.asarray(solution.linear[GAIN] * lag)

    def _of_joint(self, regression: JointRegression, shape: Shape, lag: FloatArray) -> FloatArray:
        """The joint's torque where the motor is driven by ``lag``, (n,) each."""
        read_s = np.clip(self.time_s + shape.motion_delay_s, self.time_s[0], self.time_s[-1])
        path, states = self.motion(read_s), np.zeros((1, 3))
        states[0] = path[0], self.motion(read_s[0], 1), 0.0
        driven = Driven.after(lag, self.time_s - regression.rows[0].middle_s, shape)
        model = regression.model(shape)
        begins = np.zeros(1, dtype=np.int64)
        return np.asarray(model.torque(driven, path, self.stretch.tick_s / FINE, begins, states, 0.0))

    def _held_back(self, shape: Shape, servo: Servo) -> FloatArray:
        """What a servo takes off its command behind the amplifier's lag, (n,)."""
        read_s = np.clip(self.time_s + shape.motion_delay_s, self.time_s[0], self.time_s[-1])
        return lag_of_place(servo, shape.bandwidth_rad_s, self.motion(read_s), self.stretch.tick_s / FINE)

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
    """What turns at the actuator's end of the torque sensor [kg m²]."""
    return output_of(solution) if isinstance(solution.regression, JointRegression) else motor_inertia(solution)


def output_of(solution: Solution) -> float:
    """What turns beyond the joint [kg m²]."""
    return motor_inertia(solution) * max(float(solution.shape.row[OUTPUT_INERTIA]), LIGHTEST_OUTPUT)


def motor_inertia(solution: Solution) -> float:
    return abs(float(solution.linear[INERTIA]))


def _port(stretch: Signals, solution: Solution, time_s: FloatArray) -> FloatArray:
    """The torque at the port as it was measured, at instants (n,) of its own clock; zero where nothing measures it."""
    if stretch.torque_nm is None:
        return np.zeros(time_s.size)
    zero_nm = solution.regression.rows[0].zero_nm
    return np.asarray(np.interp(time_s, stretch.time_s, _smooth(stretch.torque_nm)) - zero_nm)


def _smooth(values: FloatArray) -> FloatArray:
    """Through the fit's low-pass, a value a tick."""
    reach = round(FULL_BAND.half_width)
    taps = FULL_BAND.taps(np.arange(-reach, reach + 1, dtype=np.float64), 0)[None, :]
    return np.asarray(loops.filter_at(values, taps, -reach, 1, values.size)[0])


def _filtered(values: FloatArray, kernel: Kernel, *, of_means: bool = False) -> FloatArray:
    """A signal known FINE times a tick, or its means over these steps, through a low-pass."""
    reach = round(kernel.half_width * FINE)
    taps = kernel.taps(np.arange(-reach, reach + 1) / FINE, 0, of_means=of_means, exact_to=3)[None, :]
    return np.asarray(loops.filter_at(values, taps, -reach, 1, values.size)[0])
