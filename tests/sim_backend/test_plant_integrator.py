"""The plant's integrator against scipy's Radau on the paper's equations."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_sim.plant import Plant
from norton_sim.tables import Gravity
from norton_sim.truth import Truth, read_truth

RIG = Path(__file__).parents[2] / "rigs" / "sim-odrive.toml"
MS = 1_000_000


@pytest.fixture(scope="module")
def truth() -> Truth:
    return read_truth(tomllib.loads(RIG.read_text())["simulated"], seed=None, place="")


@pytest.fixture(scope="module")
def commands() -> np.ndarray:
    """Torques for actuator and load, held for 5 ms each: shape (60, 2). Both machines reverse several times."""
    draws = np.random.default_rng(3).uniform([-0.2, -0.1], [0.2, 0.1], size=(12, 2))
    return np.repeat(draws, 5, axis=0)


def equations(truth: Truth, stiffness: float, damping: float, e_actuator: float, e_load: float):
    """The paper's equations (IV.D) for both machines; state (θ, ω, φ, i) of the actuator, then of the load."""
    actuator, load, cogging = truth.actuator.motor, truth.load.motor, truth.actuator.cogging

    def weight(machine, angle: float) -> float:
        arm = machine.gravity
        return 0.0 if arm is None else arm.amplitude_nm * np.sin(angle - arm.zero_rad)

    def rates(_time: float, x: np.ndarray) -> list[float]:
        angle, omega, phi, i, load_angle, load_omega, load_phi, load_i = x
        port = stiffness * (angle - load_angle) + damping * (omega - load_omega)
        detent = cogging.amplitude_nm * np.sin(cogging.periods_per_turn * angle) + weight(truth.actuator, angle)
        return [
            omega,
            actuator.acceleration(i, omega, phi, port + detent),
            actuator.dahl_rate(omega, phi),
            actuator.current_rate(i, e_actuator),
            load_omega,
            load.acceleration(load_i, load_omega, load_phi, weight(truth.load, load_angle) - port),
            load.dahl_rate(load_omega, load_phi),
            load.current_rate(load_i, e_load),
        ]

    return rates


def radau(truth: Truth, commands: np.ndarray, stiffness: float, damping: float) -> np.ndarray:
    """Angles, velocities, currents of both and the port torque after each command: shape (n, 7)."""
    x, rows = np.zeros(8), []
    for e_actuator, e_load in commands:
        rates = equations(truth, stiffness, damping, e_actuator, e_load)
        x = solve_ivp(rates, (0, 1e-3), x, method="Radau", rtol=1e-10, atol=1e-14).y[:, -1]
        port = stiffness * (x[0] - x[4]) + damping * (x[1] - x[5])
        rows.append([x[0], x[1], x[3], x[4], x[5], x[7], port])
    return np.array(rows)


def plant_rows(truth: Truth, commands: np.ndarray, substep_s: float, shaft: str = "free") -> np.ndarray:
    plant, rows = Plant(truth, 0, shaft, substep_s=substep_s), []
    for tick, (e_actuator, e_load) in enumerate(commands, start=1):
        plant.command("actuator", e_actuator)
        if truth.load is not None:
            plant.command("load", truth.load.mounted * e_load)
        plant.advance(tick * MS)
        rows.append(row(plant, truth))
    return np.array(rows)


def row(plant: Plant, truth: Truth) -> list[float]:
    mounted = truth.load.mounted if truth.load is not None else 1
    return [
        plant.true_position_rad("actuator"),
        plant.true_velocity_rad_s("actuator"),
        plant.true_current_a("actuator"),
        plant.true_position_rad("load"),
        plant.true_velocity_rad_s("load"),
        mounted * plant.true_current_a("load"),
        plant.true_port_torque_nm(),
    ]


def worst(found: np.ndarray, reference: np.ndarray) -> float:
    """Greatest deviation, each signal relative to its own greatest value."""
    scale = np.abs(reference).max(axis=0)
    return float((np.abs(found - reference).max(axis=0)[scale > 0] / scale[scale > 0]).max())


@pytest.mark.long
def test_coupled_pair_converges_to_radau_with_second_order(truth, commands):
    sensor = truth.torque_sensor
    reference = radau(truth, commands, sensor.stiffness_nm_rad, sensor.damping_nm_s_rad)
    substeps = np.array([12.5e-6, 6.25e-6, 3.125e-6, 1.5625e-6])
    errors = np.array([worst(plant_rows(truth, commands, substep), reference) for substep in substeps])
    order = np.polyfit(np.log(substeps), np.log(errors), 1)[0]
    assert 1.7 < order < 2.4, errors
    assert worst(plant_rows(truth, commands, 0.5e-6), reference) < 1e-6


@pytest.mark.long
def test_arms_that_hang_on_either_side_agree_with_radau(truth, commands):
    hung = {"gravity": Gravity(amplitude="0.2 N*m", zero="0.4 rad")}
    heavy = truth.model_copy(
        update={"actuator": truth.actuator.model_copy(update=hung), "load": truth.load.model_copy(update=hung)}
    )
    sensor = truth.torque_sensor
    reference = radau(heavy, commands, sensor.stiffness_nm_rad, sensor.damping_nm_s_rad)
    assert worst(plant_rows(heavy, commands, 0.5e-6), reference) < 1e-6
    assert worst(plant_rows(truth, commands, 1.0), reference) > 0.01


@pytest.mark.long
def test_substeps_of_everyday_use_are_accurate(truth, commands):
    sensor = truth.torque_sensor
    reference = radau(truth, commands, sensor.stiffness_nm_rad, sensor.damping_nm_s_rad)
    assert worst(plant_rows(truth, commands, 1.0), reference) < 1e-3


@pytest.mark.long
def test_free_motor_agrees_with_radau(truth, commands):
    alone = commands * [1, 0]
    reference = radau(truth, alone, 0.0, 0.0)
    free = truth.model_copy(update={"load": None})
    assert worst(plant_rows(free, alone, 0.5e-6), reference) < 1e-6


@pytest.mark.long
def test_a_clamped_motor_agrees_with_radau(truth, commands):
    alone = commands * [1, 0]
    sensor = truth.torque_sensor
    heavy = truth.model_copy(update={"load": truth.load.model_copy(update={"inertia_kg_m2": 1e9})})
    reference = radau(heavy, alone, sensor.stiffness_nm_rad, sensor.damping_nm_s_rad)
    clamped = truth.model_copy(update={"load": None})
    found = plant_rows(clamped, alone, 0.5e-6, shaft="clamped")
    assert worst(found[:, [0, 1, 2, 6]], reference[:, [0, 1, 2, 6]]) < 1e-6


def test_how_time_is_cut_into_calls_hardly_matters(truth, commands):
    whole, pieces = Plant(truth, 0), Plant(truth, 0)
    cuts = np.sort(np.random.default_rng(5).integers(0, 60 * MS, 300))
    for plant in (whole, pieces):
        plant.command("actuator", 0.15)
    whole.advance(60 * MS)
    for cut in cuts:
        pieces.advance(int(cut))
    pieces.advance(60 * MS)
    assert row(pieces, truth) == pytest.approx(row(whole, truth), rel=1e-4)
