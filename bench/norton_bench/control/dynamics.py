"""The bench between two machines as the controller sees it: linear, sampled, with its delays.

State: load position and velocity [rad, rad/s], twist of the sensor and its rate [rad, rad/s], torque of the load's
amplifier [N m]. Friction of the load enters as a known torque; whatever drives the actuator enters as the acceleration
that its shaft would have if it were free [rad/s²]: its motion source, differentiated.

    dω/dt = (T + τ + d) / I_l                 τ = k_s δ + b_s dδ/dt
    d²δ/dt² = a_f − τ / I_m − dω/dt
    dT/dt = β (G u − T)
"""

from dataclasses import dataclass, replace
from math import ceil, floor, sqrt

import numpy as np
from scipy.linalg import expm

from norton_bench.arrays import FloatArray

POSITION, VELOCITY, TWIST, TWIST_RATE, AMPLIFIER = range(5)
STATES = 5
COMMAND, DISTURBANCE, FREE_ACCELERATION = range(3)


@dataclass(frozen=True)
class Bench:
    """What the linear model is made of (see the module)."""

    gain: float
    bandwidth_rad_s: float
    load_inertia_kgm2: float
    actuator_inertia_kgm2: float
    stiffness_nm_rad: float
    damping_nms_rad: float
    command_delay_s: float
    torque_delay_s: float  # of the reading that a tick sees: transport and age
    position_delay_s: float
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

    def with_damping(self, ratio: float) -> "Bench":
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
        return self.torque_delay_s, self.position_delay_s, self.position_delay_s


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
