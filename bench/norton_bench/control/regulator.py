"""The bench's own dynamics, linear and sampled once a tick, and the regulator that is designed from them."""

from dataclasses import dataclass, replace
from math import ceil, floor, sqrt

import numpy as np
from scipy.linalg import expm

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError

POSITION, VELOCITY, TWIST, TWIST_RATE, AMPLIFIER = range(5)
STATES = 5
COMMAND, DISTURBANCE, FREE_ACCELERATION = range(3)


# The bench between two machines as the controller sees it: linear, sampled, with its delays.
#
# State: load position and velocity [rad, rad/s], twist of the sensor and its rate [rad, rad/s], torque of the load's
# amplifier [N m]. Friction of the load enters as a known torque; whatever drives the actuator enters as the
# acceleration that its shaft would have if it were free [rad/s²]: its motion source, differentiated.
#
# dω/dt = (T + τ + d) / I_l τ = k_s δ + b_s dδ/dt d²δ/dt² = a_f − τ / I_m − dω/dt dT/dt = β (G u − T)
@dataclass(frozen=True)
class SampledBench:
    """What the linear model above is made of."""

    gain: float
    bandwidth_rad_s: float
    load_inertia_kgm2: float
    actuator_inertia_kgm2: float
    stiffness_nm_rad: float
    damping_nms_rad: float
    command_delay_s: float
    torque_delay_s: float  # of the reading that a tick sees: transport and age
    position_delay_s: float
    age_difference_s: float = 0.0  # by which readings of the actuator's position are older than those of the load's
    load_spring_nm_rad: float = 0.0  # the load's friction where it sticks: a spring and a damper
    load_damper_nms_rad: float = 0.0
    actuator_spring_nm_rad: float = 0.0  # and the actuator's
    actuator_damper_nms_rad: float = 0.0

    def matrices(self) -> tuple[FloatArray, FloatArray]:
        """Continuous time: A (5, 5) and B (5, 3) for the inputs command, disturbance, free acceleration."""
        a, b = np.zeros((STATES, STATES)), np.zeros((STATES, 3))
        a[POSITION, VELOCITY] = a[TWIST, TWIST_RATE] = 1.0
        a[VELOCITY] = (self.torque_row() - self._load_friction_row()) / self.load_inertia_kgm2
        a[VELOCITY, AMPLIFIER] = b[VELOCITY, DISTURBANCE] = 1.0 / self.load_inertia_kgm2
        a[TWIST_RATE] = -(self.torque_row() + self._actuator_friction_row()) / self.actuator_inertia_kgm2 - a[VELOCITY]
        b[TWIST_RATE, DISTURBANCE] = -1.0 / self.load_inertia_kgm2
        b[TWIST_RATE, FREE_ACCELERATION] = 1.0
        a[AMPLIFIER, AMPLIFIER] = -self.bandwidth_rad_s
        b[AMPLIFIER, COMMAND] = self.bandwidth_rad_s * self.gain
        return a, b

    def torque_row(self) -> FloatArray:
        """The port torque as a row over the state."""
        row = np.zeros(STATES)
        row[TWIST], row[TWIST_RATE] = self.stiffness_nm_rad, self.damping_nms_rad
        return row

    def with_damping(self, ratio: float) -> "SampledBench":
        """The same bench with the sensor's resonance damped by at least ``ratio`` of critical."""
        reduced = 1 / (1 / self.load_inertia_kgm2 + 1 / self.actuator_inertia_kgm2)
        least = 2 * ratio * sqrt(self.stiffness_nm_rad * reduced)
        return replace(self, damping_nms_rad=max(self.damping_nms_rad, least))

    def _load_friction_row(self) -> FloatArray:
        row = np.zeros(STATES)
        row[POSITION], row[VELOCITY] = self.load_spring_nm_rad, self.load_damper_nms_rad
        return row

    def _actuator_friction_row(self) -> FloatArray:
        row = np.zeros(STATES)
        row[POSITION] = row[TWIST] = self.actuator_spring_nm_rad
        row[VELOCITY] = row[TWIST_RATE] = self.actuator_damper_nms_rad
        return row

    def outputs(self) -> FloatArray:
        """What is measured, (3, 5): port torque, load position, actuator position."""
        rows = np.zeros((3, STATES))
        rows[0] = self.torque_row()
        rows[1, POSITION] = rows[2, POSITION] = rows[2, TWIST] = 1.0
        return rows

    def delays_s(self) -> tuple[float, float, float]:
        """Of the three outputs."""
        return self.torque_delay_s, self.position_delay_s, max(self.position_delay_s + self.age_difference_s, 0.0)


def propagate(a: FloatArray, b: FloatArray, duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Φ and Γ over ``duration_s`` with inputs held."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    flow = expm(block * duration_s)
    return flow[:n, :n], flow[:n, n:]


@dataclass(frozen=True)
class Sampled:
    """A linear model at the ticks, with the command in force changing ``fraction_s`` after a tick.

    The command sent at tick k acts from tick k + ``whole`` on, ``fraction_s`` into it.
    """

    a: FloatArray
    b: FloatArray  # first column: the command; the rest: held from tick to tick
    tick_s: float
    whole: int
    fraction_s: float

    def flow(self, after_s: float) -> FloatArray:
        """From (state, command in force, next command, other inputs) to the state ``after_s`` into the tick."""
        early_s = min(after_s, self.fraction_s)
        phi, gamma = propagate(self.a, self.b, after_s)
        late_phi, late_gamma = propagate(self.a, self.b[:, :1], after_s - early_s)
        _, early_gamma = propagate(self.a, self.b[:, :1], early_s)
        return np.hstack([phi, late_phi @ early_gamma, late_gamma, gamma[:, 1:]])


def sampled(a: FloatArray, b: FloatArray, tick_s: float, command_delay_s: float) -> Sampled:
    """``a``, ``b`` at the ticks, the first input delayed."""
    whole = floor(command_delay_s / tick_s)
    return Sampled(a, b, tick_s, whole, command_delay_s - whole * tick_s)


def look_back(delay_s: float, tick_s: float) -> tuple[int, float]:
    """An instant ``delay_s`` ago as (ticks back, time after that tick)."""
    back = max(1, ceil(delay_s / tick_s - 1e-9))
    return back, back * tick_s - delay_s


FREE, FREE_RATE, LOAD = STATES, STATES + 1, STATES + 2
WIDTH = STATES + 3  # deviations from the reference
# Disturbances are random walks to the observer; here they forget slowly, which Riccati's equation needs.
FORGETTING_S = 1.0
# An error of position weighs as much as the error of velocity that mends it in this time.
MENDING_S = 0.01


@dataclass(frozen=True)
class Regulator:
    """The feedback of prescribed motion: least squares of tracking errors against changes of the command.

    minimise Σ (Il Δv / T)² + (Il Δx / T²)² + ρ (Δu)², T the time in which an error of position is to be mended

    Changes of the command are what costs, so that a standing disturbance leaves no standing error.

    Gains on the deviations (WIDTH,) and on the last commands, newest first (commands in flight,).
    """

    on_state: FloatArray
    on_commands: FloatArray


def design_regulator(bench: SampledBench, effort: float, tick_s: float) -> Regulator:
    """``effort`` is √ρ: the error, as a torque, that is worth one newton metre of change within a tick."""
    transition, change = _transition(bench, tick_s)
    errors = np.zeros((2, len(transition)))
    errors[0, VELOCITY] = bench.load_inertia_kgm2 / MENDING_S
    errors[1, POSITION] = bench.load_inertia_kgm2 / MENDING_S**2
    scale = _scale(bench, len(transition))
    f, g, h = transition * scale / scale[:, None], change / scale[:, None], errors * scale / effort
    value = solve_riccati(f, g, h.T @ h)
    gain = np.linalg.solve(np.eye(1) + g.T @ value @ g, g.T @ value @ f)[0] / scale
    return Regulator(gain[:WIDTH], gain[WIDTH:])


def _transition(bench: SampledBench, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """State (deviations, last commands newest first) from tick to tick, and its input, the change of the command."""
    a5, b5 = bench.matrices()
    a, b = np.zeros((WIDTH, WIDTH)), np.zeros((WIDTH, 1))
    a[:STATES, :STATES], b[:STATES] = a5, b5[:, :1]
    a[:STATES, LOAD], a[:STATES, FREE] = b5[:, 1], b5[:, 2]
    a[FREE, FREE_RATE] = 1.0
    for disturbance in (FREE, FREE_RATE, LOAD):
        a[disturbance, disturbance] = -1.0 / FORGETTING_S
    model = sampled(a, b, tick_s, bench.command_delay_s)
    flow, in_flight = model.flow(tick_s), model.whole + 1
    size = WIDTH + in_flight
    transition, change = np.zeros((size, size)), np.zeros((size, 1))
    transition[:WIDTH, :WIDTH] = flow[:, :WIDTH]
    transition[:WIDTH, WIDTH + model.whole] += flow[:, WIDTH]
    if model.whole:
        transition[:WIDTH, WIDTH + model.whole - 1] += flow[:, WIDTH + 1]
    else:
        transition[:WIDTH, WIDTH] += flow[:, WIDTH + 1]
        change[:WIDTH, 0] = flow[:, WIDTH + 1]
    transition[WIDTH, WIDTH] = change[WIDTH, 0] = 1.0
    transition[WIDTH + 1 :, WIDTH:-1] = np.eye(in_flight - 1)
    return transition, change


def _scale(bench: SampledBench, size: int) -> FloatArray:
    """Typical sizes, which keep the Riccati equation well conditioned."""
    twist, scale = 1e-2 / bench.stiffness_nm_rad, np.full(size, 1e-2)
    free = 1e-2 / bench.load_inertia_kgm2
    scale[:WIDTH] = [1e-3, 1.0, twist, 300 * twist, 1e-2, free, 100 * free, 1e-2]
    return scale


MOST_DOUBLINGS = 50  # 2**50 ticks: a mode that has not settled by then is not seen, or not moved, at all
SETTLED = 1e-12  # of the largest element; rounding leaves some 1e-14


def solve_riccati(a: FloatArray, b: FloatArray, cost: FloatArray) -> FloatArray:
    """The discrete algebraic Riccati equation, for states that hold a line of past readings or commands.

    X of X = A'XA - A'XB (1 + B'XB)^-1 B'XA + Q, with Q = ``cost``; transposed A and B give an observer's
    covariance.

    By structure-preserving doubling (Chu, Fan, Lin and Wang, International Journal of Control 77, 2004): each round
    doubles the horizon, so some 14 suffice. scipy's ``solve_discrete_are`` gives the same to twelve digits, but its
    reordering of a Schur form gives up on some benches, whose shift of past states makes A singular.

    Raises ExperimentError where it does not settle.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        value = _doubled(a, b @ b.T, cost)
    if value is None:
        raise ExperimentError("no controller can be designed for this calibration; run 'calibrate' again, for longer")
    return value


def _doubled(a: FloatArray, gramian: FloatArray, value: FloatArray) -> FloatArray | None:
    """What the value of a longer and longer horizon settles at; None where it grows for ever."""
    identity = np.eye(len(a))
    for _ in range(MOST_DOUBLINGS):
        solved = np.linalg.solve(identity + gramian @ value, np.hstack([a, gramian]))
        flow, reach = solved[:, : len(a)], solved[:, len(a) :]
        more = a.T @ value @ flow
        gramian = gramian + a @ reach @ a.T
        value, a = value + (more + more.T) / 2, a @ flow
        if not np.isfinite(value).all():
            return None
        if np.max(np.abs(more)) <= SETTLED * np.max(np.abs(value)):
            return value
    return None
