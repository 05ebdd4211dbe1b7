"""One stretch of a bench as if its fit were true.

The smoothed motion is taken for the true one and the fit for the true actuator. The measuring chain is as it was
measured: noise and steps of the torque readings, counts of the encoder, the instants at which readings are taken, and
how unevenly commands travel."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import ceil

import numpy as np
import numpy.typing as npt
from scipy.fft import next_fast_len
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import map_coordinates, spline_filter1d
from scipy.special import exprel

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.fed_back import lag_of_place
from norton_bench.identification.joint_regression import Driven, JointRegression
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.separable import Solution
from norton_bench.identification.shape import COULOMB, DAMPING, GAIN, INERTIA, LINEAR, VISCOUS, Shape
from norton_bench.identification.signals import FINE, OF_MOTION, Signals, TimeSeries
from norton_bench.models.terms import LIGHTEST_OUTPUT, OUTPUT_INERTIA, Factor

Spectrum = npt.NDArray[np.complex128]
# The simulated friction follows the path this many times as finely as the fit does.
FINER = 4
# The motion that was measured tells the port's torque up to nearly half the rate of the readings. Above that, inertia
# and coupling alone decide what the sensor feels of the motors.
PORT = Kernel(cutoff=0.45, half_width=24.0)
# In cycles a step of an even grid: below the cutoff of what reads it off between its steps.
HIGHEST_SHOWN = 0.25
# No grid is finer by more than this: what held commands drive behind a lag falls with the square of the frequency.
FINEST = 4
# Of a step of an even grid: a contact that holds what oscillates is simulated in these, 8 a period at HIGHEST_SHOWN.
SUBSTEPS = 2
# What readings tell of a motion without loss, and no more.
SHAFT = Kernel(cutoff=0.22, half_width=16.0)
# A kernel that takes off less than this passes all: what its ripple takes off slow motion would become a drift.
LEAST_SHARE = 1e-3
NO_RESTS = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class EvenSpline:
    """A cubic spline through values on an even grid, which takes a tenth of the time of one on any grid. At its ends it
    goes on as if mirrored."""

    start_s: float
    step_s: float
    coefficients: FloatArray

    @classmethod
    def of(cls, time_s: FloatArray, values: FloatArray) -> "EvenSpline":
        coefficients = np.asarray(spline_filter1d(values, order=3, mode="mirror"), dtype=np.float64)
        return cls(float(time_s[0]), float(time_s[-1] - time_s[0]) / (time_s.size - 1), coefficients)

    def __call__(self, at_s: FloatArray) -> FloatArray:
        steps = (at_s - self.start_s) / self.step_s
        return np.asarray(map_coordinates(self.coefficients, steps[None, :], order=3, mode="mirror", prefilter=False))


@dataclass(frozen=True)
class SimulatedStretch:
    """One stretch as if the fit were true: its motion, and the torque under that motion without a command.

    ``motion`` is on the motion's clock, ``passive_nm`` (n,) at ``time_s`` on the torque's, FINE times a tick.
    ``share`` (m,) is the friction's, h, FINER times as often; zeros for a motor behind a joint.
    """

    stretch: Signals
    motion: BSpline
    time_s: FloatArray
    passive_nm: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, stretch: Signals, solution: Solution, coupling: Coupling | None) -> "SimulatedStretch":
        """``coupling``: what is behind the torque sensor, where it is known."""
        shape, linear = solution.shape, solution.linear
        step_s = stretch.tick_s / FINE
        time_s = stretch.time_s[0] + np.arange(stretch.path_rad.size) * step_s
        finer_s = time_s[0] + np.arange(time_s.size * FINER) * (step_s / FINER)
        delayed_s = np.clip(finer_s + shape.motion_delay_s, time_s[0], time_s[-1])
        at_s = delayed_s[::FINER]
        if isinstance(solution.regression, JointRegression):  # the motor behind it moves as it is driven
            motion = make_interp_spline(time_s, _filtered(stretch.path_rad, SHAFT), k=5)
            return cls(stretch, motion, time_s, -output_of(solution) * motion(at_s, 2), np.zeros(finer_s.size))
        read_s, reading = np.clip(finer_s, time_s[0], time_s[-1]), (OF_MOTION, stretch.position_period_s)

        def with_turns(path_rad: FloatArray, added_rad: FloatArray, *passed: tuple[Kernel, float]) -> FloatArray:
            h = _friction_share(stretch, solution, make_interp_spline(time_s, path_rad + added_rad, k=5), read_s)
            added_finer_rad = make_interp_spline(time_s, added_rad, k=5)(read_s)
            return _turns(solution, h, added_finer_rad, step_s / FINER, coupling, passed)[::FINER]

        # Along the motion as it was read, and along the one that comes of it.
        smooth_rad = _filtered(stretch.path_rad, SHAFT)
        sharper_rad = stretch.path_rad + with_turns(stretch.path_rad, np.zeros(time_s.size), reading)
        added_rad = with_turns(smooth_rad, sharper_rad - smooth_rad, (SHAFT, stretch.tick_s), reading)
        motion = make_interp_spline(time_s, smooth_rad + added_rad, k=5)
        h = _friction_share(stretch, solution, motion, delayed_s)
        path, velocity, acceleration = motion(at_s), motion(at_s, 1), motion(at_s, 2)
        damped = velocity * shape.damping(velocity, at_s - solution.regression.rows[0].middle_s)
        torque = -linear[INERTIA] * acceleration - linear[VISCOUS] * damped
        torque -= _friction_nm(solution, h, step_s / FINER)[::FINER]
        for index, periods in enumerate(solution.regression.cogging):
            cosine, sine = linear[len(LINEAR) + 2 * index : len(LINEAR) + 2 * index + 2]
            torque += cosine * np.cos(periods * path) + sine * np.sin(periods * path)
        return cls(stretch, motion, time_s, torque, h)

    def torque(self, solution: Solution, travel_s: FloatArray) -> EvenSpline:
        """At the port in PORT's band, on the torque's clock, where each command travelled longer than usual by
        ``travel_s`` (m,)."""
        motor_nm = self.motor(solution, travel_s, self.time_s)
        of_means = not isinstance(solution.regression, JointRegression)
        torque = self._passive_in_band_nm + _filtered(motor_nm, PORT, of_means=of_means)
        return EvenSpline.of(self.time_s, torque)

    def motor(self, solution: Solution, travel_s: FloatArray, at_s: FloatArray) -> FloatArray:
        """What drives the output, behind the amplifier's lag and the joint if there is one, on an even grid: (n,)."""
        stretch, shape, step_s = self.stretch, solution.shape, float(at_s[1] - at_s[0])
        acts_s = np.maximum.accumulate(stretch.sent_s + travel_s) + shape.command_delay_s  # nothing overtakes
        if isinstance(solution.regression, JointRegression):  # whose steps take means from one sample to the next
            acts_s -= 0.5 * step_s
        lag = mean_lag(acts_s, stretch.command, shape.bandwidth_rad_s, at_s, released=stretch.released_at_zero)
        read_s = np.clip(at_s + shape.motion_delay_s, self.time_s[0], self.time_s[-1])
        if isinstance(solution.regression, JointRegression):
            return self._of_joint(solution.regression, shape, lag, read_s, step_s)
        if stretch.servo is not None:
            lag = lag - lag_of_place(stretch.servo, shape.bandwidth_rad_s, self.motion(read_s), step_s)
        if shape.changes(Factor.GAIN):
            lag = lag * shape.gain(lag, self.motion(read_s), at_s - solution.regression.rows[0].middle_s)
        return np.asarray(solution.linear[GAIN] * lag)

    def _of_joint(
        self, regression: JointRegression, shape: Shape, lag: FloatArray, read_s: FloatArray, step_s: float
    ) -> FloatArray:
        """The joint's torque where the motor is driven by ``lag``, (n,) each; ``read_s`` is on the motion's clock."""
        path, states = self.motion(read_s), np.zeros((1, 3))
        states[0] = path[0], self.motion(read_s[0], 1), 0.0
        driven = Driven.after(lag, read_s - shape.motion_delay_s - regression.rows[0].middle_s, shape)
        begins = np.zeros(1, dtype=np.int64)
        return np.asarray(regression.model(shape).torque(driven, path, step_s, begins, states, 0.0))

    @property
    def finer_s(self) -> float:
        """Between two values of the friction's share."""
        return self.stretch.tick_s / FINE / FINER

    def at(self, at_s: FloatArray, values: FloatArray) -> FloatArray:
        """Of ``values`` (m,), as far apart as the friction's share, those at instants of the torque's clock, (n,)."""
        return np.interp(at_s, self.time_s[0] + np.arange(values.size) * self.finer_s, values)

    @cached_property  # of every simulated record
    def _passive_in_band_nm(self) -> FloatArray:
        return _filtered(self.passive_nm, PORT)


def mean_lag(
    acts_s: FloatArray, command: FloatArray, bandwidth_rad_s: float, at_s: FloatArray, *, released: bool
) -> FloatArray:
    """Of commands (m,) that act from these instants on: means over the steps of an even grid, (n,)."""
    step_s = float(at_s[1] - at_s[0])
    return np.asarray(loops.mean_lag_of_held(acts_s, command, bandwidth_rad_s, at_s[0], step_s, at_s.size, released))


@dataclass(frozen=True)
class Contact:
    """The friction's, under a quick motion so small that its share h stays what it is along the shaft's path.

    Of such a motion its deflection follows the share ``sticking``, 1 - h sign(v), and forgets it at the rate
    ``slip_1_s``, |v| σ0 / τc: (n,) each.
    """

    sticking: FloatArray
    slip_1_s: FloatArray
    stiffness_nm_rad: float
    damping_nms_rad: float

    @classmethod
    def of(cls, truth: SimulatedStretch, solution: Solution, at_s: FloatArray) -> "Contact":
        """At these instants of the torque's clock. A motor behind a joint has none at the sensor's spring, and one that
        comes out below nothing holds nothing."""
        if isinstance(solution.regression, JointRegression):
            return cls(np.zeros(at_s.size), np.zeros(at_s.size), 0.0, 0.0)
        shape, linear = solution.shape, solution.linear
        velocity = truth.motion(np.clip(at_s + shape.motion_delay_s, truth.time_s[0], truth.time_s[-1]), 1)
        sticking = 1.0 - np.clip(truth.at(at_s, truth.share) * np.sign(velocity), -1.0, 1.0)
        slip_1_s = np.abs(velocity) * shape.s_per_rad
        stiffness, damping = max(float(linear[COULOMB]), 0.0) * shape.s_per_rad, max(float(linear[DAMPING]), 0.0)
        return cls(sticking, slip_1_s, stiffness, damping)

    def within(self, time_s: float, moved_kgm2: float) -> FloatArray:
        """What it does to an oscillation in so short a time, in each step of its grid, as ``oscillator_with_contact``
        takes it, (n - 1, 4). The contact's torque accelerates the oscillation as it would ``moved_kgm2``."""
        sticking, slip = (0.5 * (values[1:] + values[:-1]) for values in (self.sticking, self.slip_1_s))
        left = np.exp(-time_s * slip)
        added = time_s * sticking * exprel(-time_s * slip)
        kept = np.exp(-time_s * self.damping_nms_rad / moved_kgm2 * sticking)
        back = time_s * (self.stiffness_nm_rad - self.damping_nms_rad * slip) / moved_kgm2
        return np.stack([left, added, kept, back], axis=1)


@dataclass(frozen=True)
class Driving:
    """What makes a coupling ring, above PORT's band: spectra [rad/s²/Hz] of the accelerations that both motors and the
    friction give their inertias, over an even grid of time ``at_s`` (n,), on the torque's clock; and what holds it."""

    at_s: FloatArray
    frequency_hz: FloatArray
    motor: Spectrum
    load: Spectrum
    friction: Spectrum  # of the motor, against its motion
    inertia_kgm2: float
    contact: Contact
    moved_kgm2: float  # what the contact's torque has to move to change the twist

    @classmethod
    def of(
        cls, truth: SimulatedStretch, solution: Solution, coupling: Coupling, travel_s: FloatArray, at_s: FloatArray
    ) -> "Driving":
        """Where each command of the motor travelled longer than usual by ``travel_s`` (m,)."""
        step_s, inertia_kgm2 = float(at_s[1] - at_s[0]), inertia_of(solution)
        motor_nm = truth.motor(solution, travel_s, at_s)
        load_nm = coupling.load_gain * mean_lag(
            coupling.sent_s + coupling.load_delay_s,
            coupling.command_nm,
            coupling.load_bandwidth_rad_s,
            at_s,
            released=coupling.load_released_at_zero,
        )
        frequency_hz = np.asarray(np.fft.rfftfreq(at_s.size, step_s), dtype=np.float64)
        # Grids hold means over their steps, and go straight from one to the next: three sincs off high frequencies.
        above = (1.0 - _passed(PORT, frequency_hz * truth.stretch.tick_s)) / np.sinc(frequency_hz * step_s) ** 3
        motor, load, friction = (
            np.asarray(np.fft.rfft(torque_nm / inertia) * above)
            for torque_nm, inertia in (
                (motor_nm, inertia_kgm2),
                (load_nm, coupling.load_inertia_kgm2),
                (truth.at(at_s, _friction_nm(solution, truth.share, truth.finer_s)), inertia_kgm2),
            )
        )
        contact, moved_kgm2 = (
            Contact.of(truth, solution, at_s),
            inertia_kgm2**2 * coupling.mobility_1_kgm2(inertia_kgm2),
        )
        return cls(at_s, frequency_hz, motor, load, friction, inertia_kgm2, contact, moved_kgm2)

    def blurred(self, uneven_s: float) -> "Driving":
        """On average over commands that travel so unevenly."""
        kept = np.exp(-0.5 * (2 * np.pi * self.frequency_hz * uneven_s) ** 2)
        return replace(self, motor=self.motor * kept, load=self.load * kept)

    def push(self, coupling: Coupling) -> Spectrum:
        """Of what drives the two ends of the spring apart."""
        turn_rad_s = 2 * np.pi * float(self.frequency_hz[1])
        driving = coupling.motor_amplitude * loops.delayed(self.motor, turn_rad_s * coupling.motor_extra_delay_s)
        driving -= coupling.load_amplitude * loops.delayed(self.load, turn_rad_s * coupling.load_extra_delay_s)
        return np.asarray(driving - self.friction)

    def ringing_at(self, time_s: FloatArray, coupling: Coupling) -> FloatArray:
        """The torque that the sensor feels, at some instants, (m,)."""
        return self.torque_at(time_s, self.push(coupling), coupling)

    def torque_at(self, time_s: FloatArray, push: Spectrum, coupling: Coupling) -> FloatArray:
        """What the sensor feels of this push, at some instants, (m,)."""
        torque_nm = self._torque_nm(push, coupling)
        order = np.argsort(time_s)
        found_nm = np.empty(time_s.size)
        found_nm[order] = TimeSeries(self.at_s, torque_nm, float(self.at_s[1] - self.at_s[0])).at(time_s[order])
        return found_nm

    def _torque_nm(self, push: Spectrum, coupling: Coupling) -> FloatArray:
        """The spring's, on the grid, (n,)."""
        mobility, substep_s = coupling.mobility_1_kgm2(self.inertia_kgm2), float(self.at_s[1] - self.at_s[0]) / SUBSTEPS
        damping = coupling.least_damped_nms_rad(self.inertia_kgm2)
        place, speed = loops.oscillator_with_contact(
            np.asarray(np.fft.irfft(push, self.at_s.size), dtype=np.float64),
            across_step(mobility * coupling.stiffness_nm_rad, mobility * damping, substep_s),
            self._of_contact,
            SUBSTEPS,
        )
        return np.asarray(coupling.stiffness_nm_rad * place + damping * speed)

    @cached_property  # of every spring
    def _of_contact(self) -> FloatArray:
        return self.contact.within(0.5 * float(self.at_s[1] - self.at_s[0]) / SUBSTEPS, self.moved_kgm2)


def across_step(stiffness: float, damping: float, step_s: float) -> FloatArray:
    """What an oscillator of this stiffness and damping over its mass does within a step: (2, 4), from displacement,
    velocity, and the acceleration that drives it at the step's begin and end, with a straight line between."""
    half = 0.5 * damping
    turns = np.sqrt(complex(stiffness - half**2))
    sine = (np.sin(turns * step_s) / turns).real if abs(turns) > 0.0 else step_s
    cosine = np.cos(turns * step_s).real
    flow = np.exp(-half * step_s) * np.array([[cosine + half * sine, sine], [-stiffness * sine, cosine - half * sine]])
    rise = np.array([-1.0, 1.0]) / step_s
    along = np.array([-damping * rise / stiffness**2, rise / stiffness])  # of what follows the line, without its place
    begin, end = (along + np.array([at, [0.0, 0.0]]) / stiffness for at in ([1.0, 0.0], [0.0, 1.0]))
    return np.concatenate([flow, end - flow @ begin], axis=1)


def even_grid(begin_s: float, end_s: float, tick_s: float, highest_hz: float) -> FloatArray:
    """Instants from ``begin_s`` to ``end_s`` or a little later, as far apart as a fit's samples, or so much nearer that
    they show this frequency, as far as FINEST allows."""
    finer = min(max(1, ceil(tick_s / FINE * highest_hz / HIGHEST_SHOWN)), FINEST)
    step_s = tick_s / FINE / finer
    size = next_fast_len(round((end_s - begin_s) / step_s) + 1, real=True)
    return np.asarray(begin_s + np.arange(size) * step_s)


def inertia_of(solution: Solution) -> float:
    """What turns at the actuator's end of the torque sensor [kg m²]."""
    return output_of(solution) if isinstance(solution.regression, JointRegression) else motor_inertia(solution)


def output_of(solution: Solution) -> float:
    """What turns beyond the joint [kg m²]."""
    return motor_inertia(solution) * max(float(solution.shape.row[OUTPUT_INERTIA]), LIGHTEST_OUTPUT)


def motor_inertia(solution: Solution) -> float:
    return abs(float(solution.linear[INERTIA]))


def _friction_share(stretch: Signals, solution: Solution, motion: BSpline, at_s: FloatArray) -> FloatArray:
    """h along the motion, at instants of its own clock, evenly spaced: (n,)."""
    shape, strengths = solution.shape, loops.EVEN
    if shape.changes(Factor.STRENGTH):
        port_nm = _port(stretch, solution, at_s - shape.motion_delay_s)
        middle_s = solution.regression.rows[0].middle_s
        strengths = shape.strength(motion(at_s, 1), motion(at_s), port_nm, at_s - middle_s)
    return np.asarray(loops.friction_path_of(motion(at_s), shape.s_per_rad, NO_RESTS, strengths)[0])


def _friction_nm(solution: Solution, h: FloatArray, step_s: float) -> FloatArray:
    """The torque of the friction contact, σ0 φ + σ1 dφ/dt, of share ``h`` (n,) at even steps: (n,)."""
    rate = np.gradient(h, step_s) / solution.shape.s_per_rad
    return np.asarray(solution.linear[COULOMB] * h + solution.linear[DAMPING] * rate)


def _turns(
    solution: Solution,
    h: FloatArray,
    added_rad: FloatArray,
    step_s: float,
    coupling: Coupling | None,
    passed: tuple[tuple[Kernel, float], ...],
) -> FloatArray:
    """What friction adds to a motion that has ``passed`` kernels of these samples [s]: (n,).

    Where a shaft turns round, its friction changes within less time than readings are apart, and they do not tell how
    it moves meanwhile; the law does. So fast, nothing else answers to the contact's torque than the inertia on the
    sensor's spring.

    ``h`` (n,) is the friction's share where ``added_rad`` (n,) was added. Of a contact that sticks, what is added
    changes the torque in turn, so this is a Newton step with its damping for the slope. Without that slope the motion
    of a light shaft with much damping would be further off after each step.
    """
    friction_nm = _friction_nm(solution, h, step_s)
    size, inertia_kgm2 = next_fast_len(h.size, real=True), motor_inertia(solution)
    frequency_hz = np.asarray(np.fft.rfftfreq(size, step_s), dtype=np.float64)
    share = 1.0 - np.prod([_passed(kernel, frequency_hz * sample_s) for kernel, sample_s in passed], axis=0)
    answer = np.zeros(frequency_hz.size, dtype=np.complex128)
    shown = share > LEAST_SHARE
    answer[shown] = share[shown] / (inertia_kgm2 * (2 * np.pi * frequency_hz[shown]) ** 2)
    if coupling is not None:
        answer[shown] *= 1.0 - coupling.response(frequency_hz[shown], inertia_kgm2) / inertia_kgm2
    sticks_nm_rad = 2j * np.pi * frequency_hz * max(float(solution.linear[DAMPING]), 0.0)
    changed = np.fft.rfft(friction_nm - np.mean(friction_nm), size) - sticks_nm_rad * np.fft.rfft(added_rad, size)
    spectrum = answer * changed / (1.0 - answer * sticks_nm_rad)
    return np.asarray(np.fft.irfft(spectrum, size)[: h.size], dtype=np.float64)


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


@cache
def _passes(kernel: Kernel) -> tuple[FloatArray, FloatArray]:
    """Frequencies [cycles a sample], evenly spaced, and the share of an amplitude that passes it: (n,) each."""
    offsets = np.arange(-round(kernel.half_width * FINE), round(kernel.half_width * FINE) + 1) / FINE
    taps = kernel.taps(offsets, 0, exact_to=3)
    frequency = np.linspace(0.0, 0.5 * FINE, round(8 * kernel.half_width * FINE))
    return frequency, np.cos(2 * np.pi * np.outer(frequency, offsets)) @ taps


def _passed(kernel: Kernel, frequency: FloatArray) -> FloatArray:
    """The share of an amplitude that passes, at frequencies in cycles a sample: (n,)."""
    return np.asarray(np.interp(frequency, *_passes(kernel), right=0.0))


def _filtered(values: FloatArray, kernel: Kernel, *, of_means: bool = False) -> FloatArray:
    """A signal known FINE times a tick, or its means over these steps, through a low-pass."""
    reach = round(kernel.half_width * FINE)
    taps = kernel.taps(np.arange(-reach, reach + 1) / FINE, 0, of_means=of_means, exact_to=3)[None, :]
    return np.asarray(loops.filter_at(values, taps, -reach, 1, values.size)[0])
