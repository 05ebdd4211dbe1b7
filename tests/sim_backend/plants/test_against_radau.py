"""Every plant against scipy's Radau on its equations, written here once more."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_sim.plant import Plant
from tests.sim_backend.plants.actuators import MODULATOR, truth_of

MS = 1_000_000
TICKS = 60

# The torque on the source and on the port's body by what joins them, for the state below; time [s], command settled.
Joined = Callable[[float, np.ndarray, float], tuple[float, float]]


def dahl(phi: float, omega: float, coulomb: float, stiffness: float, damping: float) -> tuple[float, float]:
    """Rate of φ, and the torque (section IV.D)."""
    if coulomb == 0:
        return 0.0, 0.0
    rate = omega - stiffness / coulomb * abs(omega) * phi
    return rate, stiffness * phi + damping * rate


def friction(body, phi: float, omega: float, more: float = 0.0) -> tuple[float, float]:
    rate, torque = dahl(
        phi,
        omega,
        body.coulomb_torque_nm + more,
        body.presliding_stiffness_nm_rad,
        body.presliding_damping_nm_s_rad,
    )
    return rate, torque + body.viscous_damping_nm_s_rad * omega


def muscle(actuator) -> Joined:
    def joined(_t, x, c):
        return 0.0, (math.pi - x[0]) ** 2 * max(c, 0.0) - actuator.spring_nm_rad * x[0]

    return joined


def spring(actuator) -> Joined:
    part = actuator.spring if hasattr(actuator, "spring") else actuator.backlash
    half = getattr(part, "width_rad", 0.0) / 2

    def joined(_t, x, c):
        delta = x[6] - x[0]
        beyond = delta - min(max(delta, -half), half)
        slip = x[7] - x[1] if beyond != 0 or half == 0 else 0.0
        torque = part.stiffness_nm_rad * beyond + part.damping_nm_s_rad * slip
        if actuator.servo is None:
            drive = actuator.motor.torque_constant_nm_a * c * actuator.amplifier_gain
        else:
            drive = actuator.servo.stiffness_nm_rad * (c - x[6]) - actuator.servo.damping_nm_s_rad * x[7]
        return drive - torque, torque

    return joined


def rates(truth, joined: Joined, targets: tuple[float, float]) -> Callable[[float, np.ndarray], list[float]]:
    """State: θ, ω, φ of port, load (3 to 5) and source (6 to 8); then both amplifiers' outputs, in command units."""
    actuator, load, sensor = truth.actuator, truth.load, truth.torque_sensor
    source = actuator.link.source

    def f(t: float, x: np.ndarray) -> list[float]:
        on_source, on_port = joined(t, x, x[9])
        port = sensor.stiffness_nm_rad * (x[0] - x[3]) + sensor.damping_nm_s_rad * (x[1] - x[4])
        phi, resists = friction(actuator.output, x[2], x[1])
        load_phi, load_resists = friction(load, x[5], x[4])
        source_rates = [0.0, 0.0, 0.0]
        if source is not None:
            carried = spring_torque(actuator, x)
            more = getattr(actuator, "load_friction", 0.0) * abs(carried)
            source_phi, source_resists = friction(source, x[8], x[7], more)
            source_rates = [x[7], (on_source - source_resists) / source.inertia_kg_m2, source_phi]
        return [
            x[1],
            (on_port - port - resists) / actuator.output.inertia_kg_m2,
            phi,
            x[4],
            (load.torque_gain * x[10] + port - load_resists) / load.inertia_kg_m2,
            load_phi,
            *source_rates,
            actuator.amplifier_bandwidth_rad_s * (targets[0] - x[9]),
            load.amplifier_bandwidth_rad_s * (targets[1] - x[10]),
        ]

    return f


def spring_torque(actuator, x: np.ndarray) -> float:
    """The elastic part alone."""
    if not hasattr(actuator, "backlash"):
        return 0.0
    delta, half = x[6] - x[0], actuator.backlash.width_rad / 2
    return actuator.backlash.stiffness_nm_rad * (delta - min(max(delta, -half), half))


def radau(truth, joined: Joined, targets: np.ndarray) -> np.ndarray:
    """θ, ω of the port and of the load, and the source's θ, after each tick."""
    x, rows = np.zeros(11), []
    for tick, target in enumerate(targets):
        span = (tick * 1e-3, (tick + 1) * 1e-3)
        x = solve_ivp(rates(truth, joined, target), span, x, method="Radau", rtol=1e-7, atol=1e-10).y[:, -1]
        rows.append(x[[0, 1, 3, 4, 6]])
    return np.array(rows)


def simulated(truth, targets: np.ndarray, substep_s: float = math.inf) -> np.ndarray:
    plant, rows = Plant(truth, 0, substep_s=substep_s), []
    for tick, (command, load_nm) in enumerate(targets, start=1):
        plant.command("actuator", command)
        plant.command("load", load_nm)
        plant.advance(tick * MS)
        moved = [
            value(machine)
            for machine in ("actuator", "load")
            for value in (plant.true_position_rad, plant.true_velocity_rad_s)
        ]
        rows.append([*moved, plant._state[2, 0]])
    return np.array(rows)


def targets(command: float, seed: int = 3) -> np.ndarray:
    """Commands up to ``command`` and load torques, held for 5 ms each."""
    draws = np.random.default_rng(seed).uniform([-command, -0.1], [command, 0.1], size=(TICKS // 5, 2))
    return np.repeat(draws, 5, axis=0)


def worst(found: np.ndarray, reference: np.ndarray) -> float:
    """Greatest deviation, each signal relative to its own greatest value."""
    scale = np.abs(reference).max(axis=0)
    return float((np.abs(found - reference).max(axis=0)[scale > 0] / scale[scale > 0]).max())


CASES = {
    "muscle": ("pneumatic_muscle", {}, 0.3, muscle),
    "series elastic": ("series_elastic", {}, 0.3, spring),
    "series elastic, torque": ("series_elastic", {"servo": None}, 0.03, spring),
    "gears": ("gear_train", {}, 0.3, spring),
    "gears, torque": ("gear_train", {"servo": None}, 0.03, spring),
}


@pytest.mark.long
@pytest.mark.parametrize(("model", "changes", "command", "equations"), CASES.values(), ids=CASES)
def test_everyday_substeps_agree_with_radau(model, changes, command, equations):
    truth, wanted = truth_of(model, **changes), targets(command)
    assert worst(simulated(truth, wanted), radau(truth, equations(truth.actuator), wanted)) < 4e-3


@pytest.mark.long
@pytest.mark.parametrize("case", ["muscle", "series elastic", "gears"])
def test_fine_substeps_converge_to_radau(case):
    model, changes, command, equations = CASES[case]
    truth, wanted = truth_of(model, **changes), targets(command)[:30]
    reference = radau(truth, equations(truth.actuator), wanted)
    coarse, fine = (worst(simulated(truth, wanted, substep), reference) for substep in (10e-6, 1e-6))
    assert fine < 3e-4  # teeth that touch begin to be damped at once: of first order there
    assert fine < 0.3 * coarse


def test_an_arm_follows_the_path_of_least_jerk_as_radau_does():
    truth = truth_of("arm")
    arm, wanted = truth.actuator, np.tile([0.5, 0.0], (TICKS, 1))

    def joined(t, x, _c):
        p = min(t / arm.movement_s, 1.0)
        place = 0.5 * (10 * p**3 - 15 * p**4 + 6 * p**5)
        speed = 0.5 / arm.movement_s * 30 * p**2 * (1 - p) ** 2
        stiffness = arm.stiffness_nm_rad + arm.moving_stiffness_nm_rad * 16 * p**2 * (1 - p) ** 2
        return 0.0, stiffness * (place - x[0]) + arm.damping_nm_s_rad * (speed - x[1])

    assert worst(simulated(truth, wanted)[:, :4], radau(truth, joined, wanted)[:, :4]) < 1e-3


@pytest.mark.long
def test_a_variable_spring_follows_its_modulator_as_radau_does():
    """Two more states: the modulator's amplifier, in its command's unit, and the angle of its motor."""
    truth = truth_of("variable_stiffness", modulator=MODULATOR)
    actuator, modulator, wanted = truth.actuator, truth.modulator, targets(0.3)
    modulations = np.repeat([1.0, 6.0, 2.0], TICKS // 3)  # the second one is beyond the stop

    def joined(_t, x, c):
        delta, slip = x[6] - x[0], x[7] - x[1]
        k = actuator.spring.stiffness_nm_rad + actuator.spring.stiffening_nm_rad2 * x[12]
        torque = k * delta + actuator.spring.hardening_nm_rad3 * delta**3 + actuator.spring.damping_nm_s_rad * slip
        drive = actuator.servo.stiffness_nm_rad * (c - x[6]) - actuator.servo.damping_nm_s_rad * x[7]
        return drive - torque, torque

    x, rows = np.zeros(13), []
    for tick, (target, modulation) in enumerate(zip(wanted, modulations, strict=True)):
        mechanics = rates(truth, joined, target)

        def f(t, x, mechanics=mechanics, modulation=modulation):
            moves = modulator.bandwidth_rad_s * (modulator.travel * x[11] - x[12])
            stopped = x[12] >= actuator.spring.stop_rad and moves > 0
            lag = modulator.amplifier_bandwidth_rad_s * (modulation - x[11])
            return [*mechanics(t, x), lag, 0.0 if stopped else moves]

        span = (tick * 1e-3, (tick + 1) * 1e-3)
        x = solve_ivp(f, span, x, method="Radau", rtol=1e-7, atol=1e-10).y[:, -1]
        rows.append([*x[[0, 1, 3, 4, 6]], x[12]])

    plant, found = Plant(truth, 0), []
    for tick, ((command, load_nm), modulation) in enumerate(zip(wanted, modulations, strict=True), start=1):
        plant.command("actuator", command)
        plant.command("load", load_nm)
        plant.command("modulator", modulation)
        plant.advance(tick * MS)
        moved = [
            value(machine)
            for machine in ("actuator", "load")
            for value in (plant.true_position_rad, plant.true_velocity_rad_s)
        ]
        found.append([*moved, plant._state[2, 0], plant.true_position_rad("modulator")])
    assert worst(np.array(found), np.array(rows)) < 4e-3
