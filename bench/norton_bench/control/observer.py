"""The Kalman observer: where the bench is now, from readings that are all some time old.

Its state adds to the bench's own (:mod:`norton_bench.control.regulator`) the actuator's free acceleration and a
disturbance torque on the load, both as random walks, and the offset between the two encoders. The states at the last
few ticks are kept with it, so that a reading corrects what it really saw.
"""

from dataclasses import dataclass, field
from itertools import product
from math import isfinite

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control import core
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.regulator import (
    POSITION,
    STATES,
    TWIST,
    TWIST_RATE,
    VELOCITY,
    Sampled,
    SampledBench,
    look_back,
    sampled,
    solve_riccati,
)
from norton_bench.sample import Sample

FREE, FREE_RATE, LOAD, OFFSET = STATES, STATES + 1, STATES + 2, STATES + 3
WIDTH = STATES + 4
INPUTS = 4  # command in force, next command, known torque on the load, known part of the free acceleration
GRID = 16  # instants within a tick for which output rows are kept
# Ticks without any reading that are told apart; a longer pause takes the gain of this one.
LONGEST_GAP = 40


@dataclass(frozen=True)
class Noise:
    """What the observer believes: deviations of readings, and of the random walks over one second."""

    torque_nm: float
    position_rad: float
    free_rad_s2: float
    free_rate_rad_s3: float
    load_nm: float


@dataclass(frozen=True)
class Observer:
    """Everything that the running observer needs, as arrays.

    ``rows`` (GRID + 1, 3, WIDTH + INPUTS) gives the outputs at instants within a tick, ``step`` (WIDTH, WIDTH + INPUTS)
    the state at the next tick. ``gains`` (LONGEST_GAP + 1, (past + 1)·WIDTH, 3) correct the states at this and the
    ``past`` last ticks, after so many ticks in which no reading came: what the state has gone astray by meanwhile is in
    position and velocity as well as in the accelerations, which a gain for every tick would correct far too much.
    """

    step: FloatArray
    rows: FloatArray
    gains: FloatArray
    nominal: tuple[tuple[int, int], ...]  # of each output: ticks back and instant on the grid
    past: int
    whole: int

    @property
    def gain(self) -> FloatArray:
        """Where readings come at every tick."""
        return np.asarray(self.gains[0])


def place(delay_s: float, tick_s: float) -> tuple[int, int]:
    """An instant ``delay_s`` ago as (ticks back, place on the grid of that tick)."""
    back, after_s = look_back(delay_s, tick_s)
    return back, round(after_s / tick_s * GRID)


def holds_at_any_age(observer: Observer, bench: SampledBench, tick_s: float) -> bool:
    """Whether the observer is stable however old the readings are when a tick uses them, up to one tick."""
    size = (observer.past + 1) * WIDTH
    shift = np.eye(size, k=-WIDTH)
    shift[:WIDTH, :WIDTH] = observer.step[:, :WIDTH]
    for places in product(*(_places(delay_s, tick_s) for delay_s in bench.delays_s())):
        expected = np.zeros((3, size))
        for i, (back, instant) in enumerate(places):
            expected[i, back * WIDTH : (back + 1) * WIDTH] = observer.rows[instant, i, :WIDTH]
        if np.max(np.abs(np.linalg.eigvals(shift @ (np.eye(size) - observer.gain @ expected)))) >= 1.0:
            return False
    return True


def _places(delay_s: float, tick_s: float) -> list[tuple[int, int]]:
    """Where readings may lie that are ``delay_s`` old on average, half a tick of it their age.

    The youngest, the oldest, and either side of a whole tick between: there a reading is compared with another of the
    past states, and what the gain does changes at once. Between these it changes little by little.
    """
    youngest_s, oldest_s = delay_s - 0.5 * tick_s, delay_s + 0.5 * tick_s
    places = [place(youngest_s, tick_s), place(oldest_s, tick_s)]
    younger, older = places[0][0], places[1][0]
    return [*places, (younger, 0), (older, GRID)] if younger < older else places


def design_observer(bench: SampledBench, noise: Noise, tick_s: float, past: int) -> Observer:
    """The steady-state Kalman observer for the nominal bench."""
    model = _extended(bench, tick_s)
    step = model.flow(tick_s)
    outputs = _outputs(bench)
    rows = np.stack([outputs @ model.flow(tick_s * i / GRID) for i in range(GRID + 1)])
    gains = _gains(model, outputs, bench, noise, past)
    nominal = tuple(place(delay_s, tick_s) for delay_s in bench.delays_s())
    return Observer(step, rows, gains, nominal, past, model.whole)


def _extended(bench: SampledBench, tick_s: float) -> Sampled:
    """The bench with its disturbances as states; inputs: command, torque on the load, free acceleration."""
    a5, b5 = bench.matrices()
    a, b = np.zeros((WIDTH, WIDTH)), np.zeros((WIDTH, 3))
    a[:STATES, :STATES], b[:STATES] = a5, b5
    a[:STATES, LOAD], a[:STATES, FREE] = b5[:, 1], b5[:, 2]
    a[FREE, FREE_RATE] = 1.0
    return sampled(a, b, tick_s, bench.command_delay_s)


def _outputs(bench: SampledBench) -> FloatArray:
    rows = np.zeros((3, WIDTH))
    rows[:, :STATES] = bench.outputs()
    rows[2, OFFSET] = 1.0
    return rows


def _gains(model: Sampled, outputs: FloatArray, bench: SampledBench, noise: Noise, past: int) -> FloatArray:
    size = (past + 1) * WIDTH
    transition, seen = np.zeros((size, size)), np.zeros((3, size))
    transition[:WIDTH, :WIDTH] = model.flow(model.tick_s)[:, :WIDTH]
    transition[WIDTH:, :-WIDTH] = np.eye(size - WIDTH)
    for output, delay_s in enumerate(bench.delays_s()):
        back, after_s = look_back(delay_s, model.tick_s)
        seen[output, back * WIDTH : (back + 1) * WIDTH] = outputs[output] @ model.flow(after_s)[:, :WIDTH]
    process = np.zeros((size, size))
    process[:WIDTH, :WIDTH] = _process_noise(model, bench, noise)
    scale = np.tile(_scale(bench, noise), past + 1)
    reading = np.array([noise.torque_nm, noise.position_rad, noise.position_rad])
    f = transition * scale / scale[:, None]
    h = seen * scale / reading[:, None]
    q = process / np.outer(scale, scale)
    covariance, gains = solve_riccati(f.T, h.T, q), np.empty((LONGEST_GAP + 1, size, 3))
    for gain in gains:
        gain[:] = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + np.eye(3)) * scale[:, None] / reading
        covariance = f @ covariance @ f.T + q  # nothing came
    return gains


def _process_noise(model: Sampled, bench: SampledBench, noise: Noise) -> FloatArray:
    """Of one tick: random walks of free acceleration, load torque and encoder offset, a little of everything else."""
    density = np.zeros(WIDTH)
    density[FREE], density[LOAD] = noise.free_rad_s2**2, noise.load_nm**2
    density[FREE_RATE] = noise.free_rate_rad_s3**2
    density[OFFSET] = (0.1 * noise.position_rad) ** 2
    # What no state stands for, per second: cogging, eccentricity, the sensor's own bearings.
    density[1] = (0.1 * noise.load_nm / bench.load_inertia_kgm2) ** 2 * model.tick_s
    density[3] = (0.1 * noise.free_rad_s2) ** 2 * model.tick_s
    covariance = np.zeros((WIDTH, WIDTH))
    for i in range(8):
        phi = model.flow(model.tick_s * (i + 0.5) / 8)[:, :WIDTH]
        covariance += phi @ np.diag(density) @ phi.T * model.tick_s / 8
    return covariance


def _scale(bench: SampledBench, noise: Noise) -> FloatArray:
    """Typical sizes, which keep the Riccati equation well conditioned."""
    twist = noise.torque_nm / bench.stiffness_nm_rad
    return np.array(
        [noise.position_rad, 0.1, twist, 100 * twist, noise.torque_nm, 10.0, 1e3, noise.torque_nm, noise.position_rad]
    )


# The running observer: what the bench between the two amplifiers is doing at this tick.
@dataclass
class Estimator:
    """Once a tick :meth:`sense`, then :meth:`advance` with the command that was sent.

    ``states``, now and at the last ticks, are laid out as :mod:`norton_bench.control.observer` says; ``commands``
    holds what was sent, the last one first. The contacts of both machines are carried along the load's position:
    under zero torque the actuator's is the same.
    """

    calibration: LoadCalibration
    tick_s: float
    observer: Observer
    commands: FloatArray = field(init=False)
    seen: bool = field(default=False, init=False)  # whether every signal has arrived at least once
    _mobility: float = field(default=0.0, init=False)  # of the actuator, while its friction counts as known

    def __post_init__(self) -> None:
        c, past = self.calibration, self.observer.past
        self.laws = friction_laws(c)
        self.friction_law = self.laws[0]
        self._delays_s = c.torque_delay_s, c.position_delay_s, c.position_delay_s
        self._clocks, self._begun_ns = np.zeros((3, 5)), 0
        self._unread = np.zeros(1, dtype=np.int64)  # ticks since the states were last corrected
        self.contacts = np.zeros((2, 2))  # load's, actuator's: its force [N m], and the load's position at which it was
        self.contact = self.contacts[0]
        self.states, self._inputs = np.zeros((past + 1, WIDTH)), np.zeros((past + 1, INPUTS))
        self.commands = np.zeros(self.observer.whole + 2)
        self._compile()

    def motion(self) -> tuple[float, float]:
        """Position and velocity of the load [rad, rad/s]."""
        return float(self.states[0, POSITION]), float(self.states[0, VELOCITY])

    @property
    def contact_nm(self) -> float:
        """The force of the load's friction contact."""
        return float(self.contact[0])

    def torque_nm(self) -> float:
        """The port torque now."""
        return port_torque_nm(self.calibration, self.states[0])

    def use(self, observer: Observer, *, knows_friction: bool) -> None:
        """Go on with another observer of the same past; ``knows_friction``: the actuator's is no disturbance to it."""
        inertia_kgm2 = self.calibration.actuator_inertia_kgm2
        mobility = 1.0 / inertia_kgm2 if knows_friction and inertia_kgm2 else 0.0
        if mobility != self._mobility:
            known_nm = core.friction_over(self.contacts[1, 0], self.states[0, VELOCITY], self.tick_s, self.laws[1])
            self.states[:, FREE] += (mobility - self._mobility) * known_nm
        self.observer, self._mobility = observer, mobility

    def sense(self, sample: Sample) -> bool:
        """Take in what arrived; False where a signal is missing or is no number (the state then stays as it is)."""
        readings = (sample.torque_nm, sample.load_position_rad, sample.position_rad)
        if not isfinite(sample.torque_nm + sample.load_position_rad + sample.position_rad):
            return False
        if not self.seen:
            self._settle(sample)
        late_ns = sample.lateness_ns  # the controller steps from deadline to deadline
        ages_s = (
            1e-9 * (sample.torque_age_ns - late_ns),
            1e-9 * (sample.load_motion_age_ns - late_ns),
            1e-9 * (sample.motion_age_ns - late_ns),
        )
        counts = sample.torque_count, sample.load_motion_count, sample.motion_count
        core.sense(
            self.states,
            self._inputs,
            self.contacts,
            self._clocks,
            readings,
            ages_s,
            self._delays_s,
            counts,
            1e-9 * (sample.tick_ns - late_ns - self._begun_ns),
            self.tick_s,
            self.observer.rows,
            self.observer.gains,
            self._unread,
            self.laws,
            POSITION,
        )
        return True

    def advance(self, command_nm: float) -> None:
        """Let one tick pass with ``command_nm`` on its way to the load."""
        if not self.seen:
            core.put_first(self.commands, command_nm)
            return
        core.advance(
            self.states,
            self._inputs,
            self.contacts,
            self.commands,
            command_nm,
            self._unread,
            self.laws,
            self._mobility,
            self.observer.step,
            VELOCITY,
            self.tick_s,
        )

    def _compile(self) -> None:
        """Before the loop runs: compiling takes seconds. Leaves everything at zero, and nothing seen."""
        self.advance(0.0)
        self.sense(
            Sample(
                0,
                torque_nm=0.0,
                torque_age_ns=0,
                torque_count=1,
                position_rad=0.0,
                motion_age_ns=0,
                motion_count=1,
                load_position_rad=0.0,
                load_motion_age_ns=0,
                load_motion_count=1,
            )
        )
        self.advance(0.0)
        self.seen = False
        self._clocks[:] = 0.0
        self._unread[:] = 0

    def _settle(self, sample: Sample) -> None:
        """Begin at rest where the readings are."""
        self._begun_ns = sample.tick_ns - sample.lateness_ns
        self._clocks[:, 1] = self.tick_s
        twist = sample.torque_nm / self.calibration.sensor_stiffness_nm_rad
        self.states[:] = 0.0
        self.states[:, POSITION] = self.contacts[:, 1] = sample.load_position_rad
        if isfinite(sample.load_velocity_rad_s):
            self.states[:, VELOCITY] = sample.load_velocity_rad_s
            self.states[:, POSITION] -= sample.load_velocity_rad_s * self.tick_s * np.arange(len(self.states))
        self.states[:, TWIST] = twist
        self.states[:, OFFSET] = sample.position_rad - sample.load_position_rad - twist
        self._inputs[:] = 0.0
        self.seen = True


def port_torque_nm(calibration: LoadCalibration, state: FloatArray) -> float:
    """The torque of the sensor's spring and damper in a state (WIDTH,)."""
    c = calibration
    return float(c.sensor_stiffness_nm_rad * state[TWIST] + c.sensor_damping_nms_rad * state[TWIST_RATE])


def friction_laws(calibration: LoadCalibration) -> FloatArray:
    """B, τc, σ0 and σ1 of the load and of the actuator, (2, 4); the actuator's are 0 where they are not known."""
    c, laws = calibration, np.zeros((2, 4))
    for row, friction in zip(laws, (c, c.actuator_friction), strict=True):
        if friction is not None:
            row[:] = (
                friction.viscous_damping_nms_rad,
                friction.coulomb_torque_nm,
                friction.presliding_stiffness_nm_rad,
                friction.presliding_damping_nms_rad,
            )
    return laws
