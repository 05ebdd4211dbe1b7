"""The simulator's own integrator: two machines, each with amplifier and Dahl friction, joined by a damped spring.

The equations are those of :mod:`norton_bench.models.parameters` (paper, section IV.D), once for the actuator and once
for the load, with τ_port = k (θ_a − θ_l) + d (ω_a − ω_l) between them, and cogging and gravity on top. The scheme
is of second order:

- *drift*: at constant velocity the angles move on and the Dahl torque F = σ0 φ follows its exact flow over the
  displacement, F⁺ = s τc + (F − s τc) exp(−σ0 |Δθ| / τc);
- *kick*: at constant angles the velocities change under the exact mean of the amplifiers' lag and the elastic
  torques, with all damping (viscous, σ1, the spring's) taken by the trapezoidal rule, which no stiffness upsets;
- half a drift, a kick, half a drift (Strang); adjoining half drifts are joined.

State and parameters live in arrays made once, so that a call costs about a microsecond. Row 0 is the actuator, row 1
the load; columns are named below. Angles and torques are in the bench's sense.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

ACTUATOR, LOAD = 0, 1

# Columns of the state.
ANGLE = 0  # rad
VELOCITY = 1  # rad/s
FRICTION = 2  # N m, the elastic part σ0 φ of the Dahl torque
CURRENT = 3  # A
CURRENT_TARGET = 4  # A, where the amplifier is heading
CURRENT_RATE = 5  # rad/s, how fast
TRACKED_COUNT = 6  # counts, the drive's estimate of its position
TRACKED_RATE = 7  # counts/s, and of its velocity
POWERED = 8  # 1 while the amplifier follows a command, else 0
STATE_COLUMNS = 9

# Columns of the machines' parameters.
INVERSE_INERTIA = 0  # 1/(kg m²); 0 stands for a machine that nothing can accelerate
VISCOUS = 1  # N m s/rad
COULOMB = 2  # N m
STIFFNESS = 3  # N m/rad, σ0
DAMPING = 4  # N m s/rad, σ1
TORQUE_CONSTANT = 5  # N m/A, negative for a machine mounted the other way round
COGGING_AMPLITUDE = 6  # N m
COGGING_PERIODS = 7  # per turn
COUNTS_PER_RAD = 8  # negative for a machine mounted the other way round
TRACKER_BANDWIDTH = 9  # rad/s
COUNT_OFFSET = 10  # counts, 0 unless the encoder misreads
GRAVITY_AMPLITUDE = 11  # N m
GRAVITY_ZERO = 12  # rad
COGGING_PHASE = 13  # rad
MACHINE_COLUMNS = 14

# ODrive runs its encoder estimator once per control period.
ENCODER_PERIOD_NS = 125_000


@njit(cache=True, nogil=True)
def advance(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    stiffness: float,
    damping: float,
    substep_s: float,
    now_ns: int,
    to_ns: int,
) -> None:
    """Move ``state`` from ``now_ns`` to ``to_ns`` in place.

    Shapes: ``state`` (2, STATE_COLUMNS), ``machines`` (2, MACHINE_COLUMNS). ``stiffness`` [N m/rad] and ``damping``
    [N m s/rad] are the joining spring's; no substep is longer than ``substep_s`` [s]. The drives' encoder estimators
    run at their own period, at multiples of it since the epoch.
    """
    while now_ns < to_ns:
        sample_ns = (now_ns // ENCODER_PERIOD_NS + 1) * ENCODER_PERIOD_NS
        stop_ns = min(sample_ns, to_ns)
        _integrate(state, machines, stiffness, damping, substep_s, (stop_ns - now_ns) * 1e-9)
        if stop_ns == sample_ns:
            track(state[ACTUATOR], machines[ACTUATOR])
            track(state[LOAD], machines[LOAD])
        now_ns = stop_ns


@njit(cache=True, nogil=True)
def _integrate(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    stiffness: float,
    damping: float,
    substep_s: float,
    duration_s: float,
) -> None:
    """Equal substeps over ``duration_s``."""
    count = math.ceil(duration_s / substep_s)
    h = duration_s / count
    drift(state[ACTUATOR], machines[ACTUATOR], machines[ACTUATOR, COULOMB], h / 2)
    drift(state[LOAD], machines[LOAD], machines[LOAD, COULOMB], h / 2)
    for step in range(count):
        actuator_torque = motor_torque(state[ACTUATOR], machines[ACTUATOR], mean_current(state[ACTUATOR], h))
        load_torque = motor_torque(state[LOAD], machines[LOAD], mean_current(state[LOAD], h))
        spring = stiffness * (state[ACTUATOR, ANGLE] - state[LOAD, ANGLE])
        kick(state, machines, damping, actuator_torque - spring, load_torque + spring, h)
        stretch = h if step < count - 1 else h / 2
        drift(state[ACTUATOR], machines[ACTUATOR], machines[ACTUATOR, COULOMB], stretch)
        drift(state[LOAD], machines[LOAD], machines[LOAD, COULOMB], stretch)


@njit(cache=True, nogil=True, inline="always")
def drift(state: NDArray[np.float64], machine: NDArray[np.float64], coulomb: float, h: float) -> None:
    """Angle and Dahl torque over ``h`` at constant velocity, exactly; ``coulomb`` [N m] bounds the latter."""
    displacement = state[VELOCITY] * h
    state[ANGLE] += displacement
    bound = math.copysign(coulomb, displacement)
    slip = -math.expm1(-machine[STIFFNESS] * abs(displacement) / coulomb)
    state[FRICTION] += (bound - state[FRICTION]) * slip


@njit(cache=True, nogil=True, inline="always")
def mean_current(state: NDArray[np.float64], h: float) -> float:
    """The amplifier's mean current over ``h`` [A]; it moves on along its exact lag."""
    lag = state[CURRENT_RATE] * h
    settled = -math.expm1(-lag)
    missing = state[CURRENT_TARGET] - state[CURRENT]
    mean = state[CURRENT_TARGET] - missing * settled / lag
    state[CURRENT] += missing * settled
    return float(mean)


@njit(cache=True, nogil=True, inline="always")
def motor_torque(state: NDArray[np.float64], machine: NDArray[np.float64], current: float) -> float:
    """What turns a body but for damping and what it is joined to [N m]."""
    cogging = machine[COGGING_AMPLITUDE] * math.sin(machine[COGGING_PERIODS] * state[ANGLE] + machine[COGGING_PHASE])
    torque = machine[TORQUE_CONSTANT] * current - cogging - state[FRICTION]
    if machine[GRAVITY_AMPLITUDE] != 0.0:
        torque -= machine[GRAVITY_AMPLITUDE] * math.sin(state[ANGLE] - machine[GRAVITY_ZERO])
    return float(torque)


@njit(cache=True, nogil=True, inline="always")
def own_damping(state: NDArray[np.float64], machine: NDArray[np.float64], coulomb: float) -> float:
    """B + σ1 (1 − s F/τc) [N m s/rad]: the friction contact damps only as far as it does not slide."""
    sliding = math.copysign(1.0, state[VELOCITY]) * state[FRICTION] / coulomb
    return float(machine[VISCOUS] + machine[DAMPING] * (1.0 - sliding))


@njit(cache=True, nogil=True, inline="always")
def kick(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    damping: float,
    actuator_torque: float,
    load_torque: float,
    h: float,
) -> None:
    """Velocities over ``h`` at constant angles: (1 + A) ω⁺ = (1 − A) ω + h W τ, with A = h/2 · W C."""
    actuator_gain = h * machines[ACTUATOR, INVERSE_INERTIA]
    load_gain = h * machines[LOAD, INVERSE_INERTIA]
    a11 = actuator_gain / 2 * (own_damping(state[ACTUATOR], machines[ACTUATOR], machines[ACTUATOR, COULOMB]) + damping)
    a22 = load_gain / 2 * (own_damping(state[LOAD], machines[LOAD], machines[LOAD, COULOMB]) + damping)
    a12 = -actuator_gain / 2 * damping
    a21 = -load_gain / 2 * damping
    actuator, load = state[ACTUATOR, VELOCITY], state[LOAD, VELOCITY]
    right_1 = (1.0 - a11) * actuator - a12 * load + actuator_gain * actuator_torque
    right_2 = (1.0 - a22) * load - a21 * actuator + load_gain * load_torque
    determinant = (1.0 + a11) * (1.0 + a22) - a12 * a21
    state[ACTUATOR, VELOCITY] = ((1.0 + a22) * right_1 - a12 * right_2) / determinant
    state[LOAD, VELOCITY] = ((1.0 + a11) * right_2 - a21 * right_1) / determinant


@njit(cache=True, nogil=True)
def track(state: NDArray[np.float64], machine: NDArray[np.float64]) -> None:
    """One period of the tracking loop with which an ODrive estimates velocity (Firmware encoder.cpp, update)."""
    period_s = ENCODER_PERIOD_NS * 1e-9
    proportional = 2.0 * machine[TRACKER_BANDWIDTH]
    integral = 0.25 * proportional * proportional
    state[TRACKED_COUNT] += period_s * state[TRACKED_RATE]
    count = math.floor(state[ANGLE] * machine[COUNTS_PER_RAD]) + machine[COUNT_OFFSET]
    error = count - math.floor(state[TRACKED_COUNT])
    state[TRACKED_COUNT] += period_s * proportional * error
    state[TRACKED_RATE] += period_s * integral * error
    if abs(state[TRACKED_RATE]) < 0.5 * period_s * integral:
        state[TRACKED_RATE] = 0.0  # the firmware calls this standing still
