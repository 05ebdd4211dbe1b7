"""A planar arm of two joints, each with a bench of its own: what joins the plants of two benches.

    I(θ) dω/dt + c(θ, ω) = K(t) (x_N − θ) + D (v_N − ω) − friction − τ

Angles are those of the joints: the shoulder's, and the elbow's from the upper arm. I(θ) and the Coriolis torques c are
those of two links in a plane (Hollerbach and Flash, Biol. Cybern. 44, 1982), with what turns at either port itself on
the diagonal. The diagonals of K and D are those of the joints' own plants
(:class:`norton_sim.plants.muscles.ArmTruth`), beside them stand the cross terms of muscles that span both joints; they
need not be alike. Source, sensor, load and the scheme of integration are those of :mod:`norton_sim.chain`.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from norton_sim.chain import SOURCE
from norton_sim.integrator import (
    ACTUATOR,
    ANGLE,
    COULOMB,
    ENCODER_PERIOD_NS,
    INVERSE_INERTIA,
    LOAD,
    VELOCITY,
    drift,
    mean_current,
    motor_torque,
    own_damping,
    track,
)
from norton_sim.plants.assembled import DAMPER, MOVEMENT
from norton_sim.plants.muscles import follow_command, place, stiffness
from norton_sim.tables import Angle, Damping, Inertia, Length, Mass, Stiffness, Table

# What one joint is, in tuples of arrays: state, machines, link and reach as chain.advance takes them.
Tables = tuple[NDArray[np.float64], NDArray[np.float64]]
Sensors = tuple[tuple[float, float], tuple[float, float]]

# Columns of the row that joins them.
UPPER = 0  # kg m², I₁ + I₂ + m₁ c₁² + m₂ (l₁² + c₂²)
ACROSS = 1  # kg m², m₂ l₁ c₂
LOWER = 2  # kg m², I₂ + m₂ c₂²
ELBOW = 3  # rad, the elbow's angle where its encoder reads zero
STIFFNESS_12, STIFFNESS_21 = 4, 5  # N m/rad, at the shoulder by the elbow and the other way round
DAMPING_12, DAMPING_21 = 6, 7  # N m s/rad
ARM_COLUMNS = 8


class TwoJointsTruth(Table):
    """``centre`` is how far a link's centre of mass lies from its joint; its inertia is about that centre.

    ``elbow_by_shoulder`` is the torque at the elbow for a motion of the shoulder, ``shoulder_by_elbow`` the other.
    """

    upper_mass_kg: Mass = Field(alias="upper_mass", gt=0, examples=["1.93 kg"])
    upper_length_m: Length = Field(alias="upper_length", gt=0, examples=["0.31 m"])
    upper_centre_m: Length = Field(alias="upper_centre", ge=0, examples=["0.165 m"])
    upper_inertia_kg_m2: Inertia = Field(alias="upper_inertia", ge=0, examples=["0.0141 kg*m^2"])
    lower_mass_kg: Mass = Field(alias="lower_mass", gt=0, examples=["1.52 kg"])
    lower_centre_m: Length = Field(alias="lower_centre", ge=0, examples=["0.19 m"])
    lower_inertia_kg_m2: Inertia = Field(alias="lower_inertia", gt=0, examples=["0.0188 kg*m^2"])
    elbow_rad: Angle = Field(alias="elbow", examples=["1.6 rad"])
    shoulder_by_elbow_nm_rad: Stiffness = Field(alias="shoulder_by_elbow", default=0.0)
    elbow_by_shoulder_nm_rad: Stiffness = Field(alias="elbow_by_shoulder", default=0.0)
    shoulder_by_elbow_damping_nm_s_rad: Damping = Field(alias="shoulder_by_elbow_damping", default=0.0)
    elbow_by_shoulder_damping_nm_s_rad: Damping = Field(alias="elbow_by_shoulder_damping", default=0.0)

    @property
    def row(self) -> NDArray[np.float64]:
        """Shape (ARM_COLUMNS,)."""
        row = np.zeros(ARM_COLUMNS)
        row[LOWER] = self.lower_inertia_kg_m2 + self.lower_mass_kg * self.lower_centre_m**2
        row[UPPER] = row[LOWER] + self.upper_inertia_kg_m2 + self.upper_mass_kg * self.upper_centre_m**2
        row[UPPER] += self.lower_mass_kg * self.upper_length_m**2
        row[ACROSS] = self.lower_mass_kg * self.upper_length_m * self.lower_centre_m
        row[ELBOW] = self.elbow_rad
        row[STIFFNESS_12], row[STIFFNESS_21] = self.shoulder_by_elbow_nm_rad, self.elbow_by_shoulder_nm_rad
        row[DAMPING_12] = self.shoulder_by_elbow_damping_nm_s_rad
        row[DAMPING_21] = self.elbow_by_shoulder_damping_nm_s_rad
        return row

    def inertia_kg_m2(self, elbow_turned_rad: float) -> NDArray[np.float64]:
        """I(θ) of the links alone, shape (2, 2)."""
        upper, across, lower, elbow_rad = self.row[:4]
        bent = across * math.cos(elbow_rad + elbow_turned_rad)
        return np.array([[upper + 2 * bent, lower + bent], [lower + bent, lower]])


@njit(cache=True, nogil=True)
def advance(
    states: Tables,
    machines: Tables,
    sensors: Sensors,
    links: Tables,
    reaches: Tables,
    arm: NDArray[np.float64],
    substep_s: float,
    now_ns: int,
    to_ns: int,
) -> None:
    """Move ``states`` from ``now_ns`` to ``to_ns`` in place: of shoulder and elbow, each as ``chain.advance`` does.

    Shapes, of each joint: state (3, STATE_COLUMNS), machines (3, MACHINE_COLUMNS), link (LINK_COLUMNS,), reach
    (REACH_COLUMNS,); ``sensors`` are its torque sensor's stiffness [N m/rad] and damping [N m s/rad]. ``arm`` has
    shape (ARM_COLUMNS,).
    """
    for joint in range(2):
        follow_command(reaches[joint], states[joint][ACTUATOR], links[joint], now_ns * 1e-9)
    while now_ns < to_ns:
        sample_ns = (now_ns // ENCODER_PERIOD_NS + 1) * ENCODER_PERIOD_NS
        stop_ns = min(sample_ns, to_ns)
        _integrate(states, machines, sensors, links, reaches, arm, substep_s, now_ns * 1e-9, (stop_ns - now_ns) * 1e-9)
        if stop_ns == sample_ns:
            for joint in range(2):
                track(states[joint][ACTUATOR], machines[joint][ACTUATOR])
                track(states[joint][LOAD], machines[joint][LOAD])
        now_ns = stop_ns


@njit(cache=True, nogil=True)
def _integrate(
    states: Tables,
    machines: Tables,
    sensors: Sensors,
    links: Tables,
    reaches: Tables,
    arm: NDArray[np.float64],
    substep_s: float,
    now_s: float,
    duration_s: float,
) -> None:
    """Equal substeps over ``duration_s``."""
    count = math.ceil(duration_s / substep_s)
    h = duration_s / count
    _drift(states, machines, links, reaches, h / 2, now_s + h / 2)
    for step in range(count):
        middle_s = now_s + (step + 0.5) * h
        _kick(states, machines, sensors, links, reaches, arm, middle_s, h)
        length = h if step < count - 1 else h / 2
        _drift(states, machines, links, reaches, length, middle_s + length)


@njit(cache=True, nogil=True)
def _drift(states: Tables, machines: Tables, links: Tables, reaches: Tables, h: float, end_s: float) -> None:
    """Angles and friction over ``h`` at constant velocity; the sources are where their paths say."""
    for joint in range(2):
        state, machine = states[joint], machines[joint]
        drift(state[ACTUATOR], machine[ACTUATOR], machine[ACTUATOR, COULOMB], h)
        drift(state[LOAD], machine[LOAD], machine[LOAD, COULOMB], h)
        state[SOURCE, ANGLE], state[SOURCE, VELOCITY], _ = place(reaches[joint], end_s, links[joint][MOVEMENT])


@njit(cache=True, nogil=True)
def _kick(
    states: Tables,
    machines: Tables,
    sensors: Sensors,
    links: Tables,
    reaches: Tables,
    arm: NDArray[np.float64],
    now_s: float,
    h: float,
) -> None:
    """Velocities over ``h`` at constant angles, all damping by the trapezoidal rule: of both ports and both loads.

    The loads' velocities are taken out first: each is damped against its own port alone. The Coriolis torques are those
    of the mean velocity, by one repetition.
    """
    torque, carried, share = np.zeros(2), np.zeros(2), np.zeros(2)
    slowing, damping = np.zeros((2, 2)), np.zeros((2, 2))
    before, ahead = np.zeros(2), np.zeros(2)
    damping[0, 1], damping[1, 0] = arm[DAMPING_12], arm[DAMPING_21]
    for joint in range(2):
        state, link = states[joint], links[joint]
        before[joint] = state[ACTUATOR, VELOCITY]
        ahead[joint] = state[SOURCE, ANGLE] - state[ACTUATOR, ANGLE]
        damping[joint, joint] = link[DAMPER]
        torque[joint], slowing[joint, joint], carried[joint], share[joint] = _beside_load(
            state, machines[joint], sensors[joint], h
        )
        torque[joint] += stiffness(reaches[joint], now_s, link) * ahead[joint]
    torque[0] += arm[STIFFNESS_12] * ahead[1]
    torque[1] += arm[STIFFNESS_21] * ahead[0]
    for joint in range(2):
        for other in range(2):
            source = states[other][SOURCE, VELOCITY]
            torque[joint] += damping[joint, other] * (source - before[other] / 2)
            slowing[joint, other] += damping[joint, other]
    after = _turned(states, machines, arm, before, before, torque, slowing, h)
    after = _turned(states, machines, arm, before, (before + after) / 2, torque, slowing, h)
    for joint in range(2):
        states[joint][ACTUATOR, VELOCITY] = after[joint]
        states[joint][LOAD, VELOCITY] = carried[joint] + share[joint] * after[joint]


@njit(cache=True, nogil=True)
def _beside_load(
    state: NDArray[np.float64], machines: NDArray[np.float64], sensor: tuple[float, float], h: float
) -> tuple[float, float, float, float]:
    """Torque and damping at a port, without its muscles; the load's velocity after the kick is ``carried`` and its
    ``share`` of the port's."""
    stiff, damper = sensor
    mean_current(state[ACTUATOR], h)
    spring_nm = stiff * (state[ACTUATOR, ANGLE] - state[LOAD, ANGLE])
    port, load = state[ACTUATOR, VELOCITY], state[LOAD, VELOCITY]
    port_damping = own_damping(state[ACTUATOR], machines[ACTUATOR], machines[ACTUATOR, COULOMB])
    load_damping = own_damping(state[LOAD], machines[LOAD], machines[LOAD, COULOMB])
    gain = h * machines[LOAD, INVERSE_INERTIA]
    load_nm = motor_torque(state[LOAD], machines[LOAD], mean_current(state[LOAD], h)) + spring_nm
    load_slowed = load_damping * load + damper * (load - port)
    slower = 1.0 + gain / 2 * (load_damping + damper)
    share = gain / 2 * damper / slower
    carried = (load + gain * (load_nm - load_slowed / 2)) / slower
    torque = motor_torque(state[ACTUATOR], machines[ACTUATOR], 0.0) - spring_nm
    torque += damper * carried / 2 - (port_damping * port + damper * (port - load)) / 2
    return torque, port_damping + damper - damper * share, carried, share


@njit(cache=True, nogil=True)
def _turned(
    states: Tables,
    machines: Tables,
    arm: NDArray[np.float64],
    before: NDArray[np.float64],
    velocity: NDArray[np.float64],
    torque: NDArray[np.float64],
    slowing: NDArray[np.float64],
    h: float,
) -> NDArray[np.float64]:
    """Both ports' velocities after (I + h/2 S) ω⁺ = I ω + h (τ − c(θ, ω)); a jammed joint stands."""
    elbow = arm[ELBOW] + states[1][ACTUATOR, ANGLE]
    bent, centrifugal = arm[ACROSS] * math.cos(elbow), arm[ACROSS] * math.sin(elbow)
    own_1, own_2 = machines[0][ACTUATOR, INVERSE_INERTIA], machines[1][ACTUATOR, INVERSE_INERTIA]
    i11 = arm[UPPER] + 2 * bent + (1.0 / own_1 if own_1 != 0.0 else 0.0)
    i12 = arm[LOWER] + bent
    i22 = arm[LOWER] + (1.0 / own_2 if own_2 != 0.0 else 0.0)
    coriolis_1 = -centrifugal * (2 * velocity[0] + velocity[1]) * velocity[1]
    coriolis_2 = centrifugal * velocity[0] * velocity[0]
    a11, a12 = i11 + h / 2 * slowing[0, 0], i12 + h / 2 * slowing[0, 1]
    a21, a22 = i12 + h / 2 * slowing[1, 0], i22 + h / 2 * slowing[1, 1]
    right_1 = i11 * before[0] + i12 * before[1] + h * (torque[0] - coriolis_1)
    right_2 = i12 * before[0] + i22 * before[1] + h * (torque[1] - coriolis_2)
    if own_1 == 0.0:
        a11, a12, right_1 = 1.0, 0.0, 0.0
    if own_2 == 0.0:
        a21, a22, right_2 = 0.0, 1.0, 0.0
    determinant = a11 * a22 - a12 * a21
    return np.array([(a22 * right_1 - a12 * right_2) / determinant, (a11 * right_2 - a21 * right_1) / determinant])
