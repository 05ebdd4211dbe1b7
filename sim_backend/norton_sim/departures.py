"""What a simulated torque motor does that the paper's motor does not: its true friction, torque and damping vary.

The rig file's ``[simulated.actuator.departures]`` names them; docs/plants.md has the equations. At every substep the
motor's parameters become what they are there and then, and the integrator's own scheme goes on with these.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from norton_sim.integrator import (
    ACTUATOR,
    ANGLE,
    COULOMB,
    CURRENT,
    ENCODER_PERIOD_NS,
    LOAD,
    TORQUE_CONSTANT,
    VELOCITY,
    VISCOUS,
    drift,
    kick,
    mean_current,
    motor_torque,
    track,
)
from norton_sim.tables import Angle, Current, Number, QuadraticDrag, Rate, Seconds, Table

# Columns of a row of departures.
DROP = 0  # share of the Coulomb torque that fast sliding loses
DROP_INVERSE_VELOCITY = 1  # s/rad
ASYMMETRY = 2  # share by which it is greater forwards, and less backwards
LOAD_FRICTION = 3  # N m of friction for each N m at the port
FRICTION_SHARE, FRICTION_PERIODS = 4, 5  # by position
RIPPLE_SHARE, RIPPLE_PERIODS = 6, 7  # of the torque constant, by position
SATURATION, SATURATION_INVERSE_CURRENT = 8, 9  # of the torque constant, by current
DRAG = 10  # N m s²/rad²
DAMPING_RATE = 11  # 1/s, of the viscous damping
GAIN_SHARE, GAIN_RATE = 12, 13  # of the torque constant, settling at that rate [1/s]
FRICTION_PHASE, RIPPLE_PHASE = 14, 15  # rad
DEPARTURE_COLUMNS = 16


class Stribeck(Table):
    """The Coulomb torque is τc (1 − drop (1 − exp(−(ω/velocity)²)))."""

    drop: Number = Field(ge=0, lt=1, examples=["30 %"])
    velocity_rad_s: Rate = Field(alias="velocity", gt=0, examples=["5 rad/s"])


class ByPosition(Table):
    """A factor 1 + share · cos(periods · θ + phase)."""

    share: Number = Field(gt=-1, lt=1, examples=["3 %"])
    periods_per_turn: int = Field(ge=1, examples=[6])
    phase_rad: Angle = Field(alias="phase", default=0.0)


class Saturation(Table):
    """The torque constant is Km / (1 + k (i/current)²), less by ``share`` at ``current``: k = share / (1 − share)."""

    share: Number = Field(ge=0, lt=1, examples=["10 %"])
    current_a: Current = Field(alias="current", gt=0, examples=["2 A"])


class InTime(Table):
    """A parameter that changes by ``share`` within the time ``over``, from the simulation's beginning on."""

    share: Number = Field(gt=-1, examples=["10 %"])
    over_s: Seconds = Field(alias="over", gt=0, examples=["120 s"])


class Departures(Table):
    """All of them; what is not written is not there. ``warming`` settles exponentially, ``damping_drift`` goes on."""

    stribeck: Stribeck | None = None
    asymmetry: Number = Field(default=0.0, gt=-1, lt=1, examples=["10 %"])
    load_friction: Number = Field(default=0.0, ge=0, lt=1, examples=["5 %"])
    friction_by_position: ByPosition | None = None
    ripple: ByPosition | None = None
    saturation: Saturation | None = None
    quadratic_drag_nm_s2_rad2: QuadraticDrag = Field(alias="quadratic_drag", default=0.0, ge=0)
    damping_drift: InTime | None = None
    warming: InTime | None = None

    def row(self) -> NDArray[np.float64]:
        """As the integrator works on them, shape (DEPARTURE_COLUMNS,)."""
        row = np.zeros(DEPARTURE_COLUMNS)
        row[ASYMMETRY], row[LOAD_FRICTION] = self.asymmetry, self.load_friction
        row[DRAG] = self.quadratic_drag_nm_s2_rad2
        if self.stribeck is not None:
            row[DROP], row[DROP_INVERSE_VELOCITY] = self.stribeck.drop, 1.0 / self.stribeck.velocity_rad_s
        if self.friction_by_position is not None:
            row[FRICTION_SHARE] = self.friction_by_position.share
            row[FRICTION_PERIODS] = self.friction_by_position.periods_per_turn
            row[FRICTION_PHASE] = self.friction_by_position.phase_rad
        if self.ripple is not None:
            row[RIPPLE_SHARE], row[RIPPLE_PERIODS] = self.ripple.share, self.ripple.periods_per_turn
            row[RIPPLE_PHASE] = self.ripple.phase_rad
        if self.saturation is not None:
            row[SATURATION] = self.saturation.share / (1.0 - self.saturation.share)
            row[SATURATION_INVERSE_CURRENT] = 1.0 / self.saturation.current_a
        if self.damping_drift is not None:
            row[DAMPING_RATE] = self.damping_drift.share / self.damping_drift.over_s
        if self.warming is not None:
            row[GAIN_SHARE], row[GAIN_RATE] = self.warming.share, 1.0 / self.warming.over_s
        return row


@njit(cache=True, nogil=True)
def advance(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    joint: tuple[float, float],
    row: NDArray[np.float64],
    substep_s: float,
    now_ns: int,
    to_ns: int,
) -> None:
    """As :func:`norton_sim.integrator.advance`, with the departures ``row`` (DEPARTURE_COLUMNS,) of the actuator.

    ``joint`` is the joining spring's stiffness [N m/rad] and damping [N m s/rad].
    """
    while now_ns < to_ns:
        sample_ns = (now_ns // ENCODER_PERIOD_NS + 1) * ENCODER_PERIOD_NS
        stop_ns = min(sample_ns, to_ns)
        _integrate(state, machines, joint, row, substep_s, now_ns * 1e-9, (stop_ns - now_ns) * 1e-9)
        if stop_ns == sample_ns:
            track(state[ACTUATOR], machines[ACTUATOR])
            track(state[LOAD], machines[LOAD])
        now_ns = stop_ns


@njit(cache=True, nogil=True)
def _integrate(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    joint: tuple[float, float],
    row: NDArray[np.float64],
    substep_s: float,
    now_s: float,
    duration_s: float,
) -> None:
    """Equal substeps over ``duration_s``."""
    count = math.ceil(duration_s / substep_s)
    h = duration_s / count
    there = machines.copy()  # what the parameters are there and then
    for step in range(count):
        spring = joint[0] * (state[ACTUATOR, ANGLE] - state[LOAD, ANGLE])
        _depart(there[ACTUATOR], machines[ACTUATOR], state[ACTUATOR], row, spring, now_s + (step + 0.5) * h)
        drift(state[ACTUATOR], there[ACTUATOR], there[ACTUATOR, COULOMB], h / 2)
        drift(state[LOAD], there[LOAD], there[LOAD, COULOMB], h / 2)
        actuator_torque = motor_torque(state[ACTUATOR], there[ACTUATOR], mean_current(state[ACTUATOR], h))
        load_torque = motor_torque(state[LOAD], there[LOAD], mean_current(state[LOAD], h))
        spring = joint[0] * (state[ACTUATOR, ANGLE] - state[LOAD, ANGLE])
        kick(state, there, joint[1], actuator_torque - spring, load_torque + spring, h)
        drift(state[ACTUATOR], there[ACTUATOR], there[ACTUATOR, COULOMB], h / 2)
        drift(state[LOAD], there[LOAD], there[LOAD, COULOMB], h / 2)


@njit(cache=True, nogil=True, inline="always")
def _depart(
    there: NDArray[np.float64],
    named: NDArray[np.float64],
    state: NDArray[np.float64],
    row: NDArray[np.float64],
    port_nm: float,
    now_s: float,
) -> None:
    """The actuator's parameters ``there`` (MACHINE_COLUMNS,), from those ``named`` and from where it stands."""
    velocity, angle, current = state[VELOCITY], state[ANGLE], state[CURRENT]
    share = 1.0 + row[DROP] * math.expm1(-((velocity * row[DROP_INVERSE_VELOCITY]) ** 2))
    share *= 1.0 + math.copysign(row[ASYMMETRY], row[ASYMMETRY] * velocity)
    share *= 1.0 + row[FRICTION_SHARE] * math.cos(row[FRICTION_PERIODS] * angle + row[FRICTION_PHASE])
    there[COULOMB] = named[COULOMB] * share + row[LOAD_FRICTION] * abs(port_nm)
    there[VISCOUS] = named[VISCOUS] * (1.0 + row[DAMPING_RATE] * now_s) + row[DRAG] * abs(velocity)
    constant = 1.0 + row[RIPPLE_SHARE] * math.cos(row[RIPPLE_PERIODS] * angle + row[RIPPLE_PHASE])
    constant *= 1.0 - row[GAIN_SHARE] * math.expm1(-row[GAIN_RATE] * now_s)
    constant /= 1.0 + row[SATURATION] * (current * row[SATURATION_INVERSE_CURRENT]) ** 2
    there[TORQUE_CONSTANT] = named[TORQUE_CONSTANT] * constant
