"""What the paper says of the motor and what mechanics says of any bench, held against the plant."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_sim import integrator as columns
from norton_sim.integrator import ACTUATOR, LOAD
from norton_sim.packing import PackedBench, pack
from norton_sim.plant import Plant
from norton_sim.truth import Truth, read_truth

RIG = Path(__file__).parents[2] / "rigs" / "sim-odrive.toml"
SIMULATED = tomllib.loads(RIG.read_text())["simulated"]
MS = 1_000_000

FACTOR = st.floats(math.log(0.25), math.log(4)).map(math.exp)
SCALED = (
    "amplifier_bandwidth_rad_s",
    "inertia_kg_m2",
    "viscous_damping_nm_s_rad",
    "coulomb_torque_nm",
    "presliding_stiffness_nm_rad",
    "presliding_damping_nm_s_rad",
)
MACHINE_FACTORS = st.fixed_dictionaries(dict.fromkeys(SCALED, FACTOR))


def rig_truth(**without: None) -> Truth:
    """The shipped rig's true values, without the keys given."""
    return read_truth({**SIMULATED, **without}, seed=None, place="")


def changed(truth: Truth, table: str, **changes: object) -> Truth:
    return truth.model_copy(update={table: getattr(truth, table).model_copy(update=changes)})


def scaled(truth: Truth, table: str, factors: dict[str, float]) -> Truth:
    values = {name: factor * getattr(getattr(truth, table), name) for name, factor in factors.items()}
    return changed(truth, table, **values)


def smooth_alone() -> Truth:
    """The actuator alone, as the paper has it: no load, no cogging."""
    truth = changed(rig_truth(), "actuator", cogging=None)
    return truth.model_copy(update={"load": None})


def run(state: np.ndarray, bench: PackedBench, from_ns: int, to_ns: int, substep_s: float = math.inf) -> None:
    step_s = min(substep_s, bench.substep_s)
    columns.advance(state, bench.machines, bench.stiffness, bench.damping, step_s, from_ns, to_ns)


def still_state() -> np.ndarray:
    state = np.zeros((2, columns.STATE_COLUMNS))
    state[:, columns.CURRENT_RATE] = 1000.0
    return state


def moved(truth: Truth) -> tuple[PackedBench, np.ndarray]:
    """A bench whose actuator is moved, not driven: nothing can change the velocity that is written into its state."""
    bench = pack(truth.model_copy(update={"load": None}), "free")
    bench.machines[ACTUATOR, columns.INVERSE_INERTIA] = 0.0
    return bench, still_state()


def friction_along(displacements_rad: np.ndarray, velocity_rad_s: float) -> np.ndarray:
    """Dahl torque [N m] after each displacement, travelled at one speed."""
    bench, state = moved(rig_truth())
    torques, now_ns = [], 0
    for displacement in displacements_rad:
        state[ACTUATOR, columns.VELOCITY] = math.copysign(velocity_rad_s, displacement)
        to_ns = now_ns + round(abs(displacement) / velocity_rad_s * 1e9)
        run(state, bench, now_ns, to_ns)
        torques.append(state[ACTUATOR, columns.FRICTION])
        now_ns = to_ns
    return np.array(torques)


def test_friction_follows_dahls_curve_out_and_back():
    motor = rig_truth().actuator.motor
    out = np.full(20, 2e-4)
    torques = friction_along(np.concatenate([out, -out]), 0.1)
    travelled = np.cumsum(out)
    rise = motor.tau_c * (1 - np.exp(-motor.sigma_0 * travelled / motor.tau_c))
    fall = -motor.tau_c + (rise[-1] + motor.tau_c) * np.exp(-motor.sigma_0 * travelled / motor.tau_c)
    np.testing.assert_allclose(torques, np.concatenate([rise, fall]), rtol=1e-6)


@given(st.lists(st.floats(-3e-3, 3e-3).filter(lambda d: abs(d) > 1e-5), min_size=1, max_size=8))
@settings(max_examples=30)
def test_friction_does_not_know_how_fast_the_path_was_travelled(path):
    slow, fast = friction_along(np.array(path), 0.02), friction_along(np.array(path), 2.0)
    np.testing.assert_allclose(slow, fast, atol=1e-3 * rig_truth().actuator.motor.tau_c)


@given(st.lists(st.floats(-3e-3, 3e-3).filter(lambda d: abs(d) > 1e-6), min_size=1, max_size=30))
@settings(max_examples=30)
def test_friction_only_takes_energy(path):
    """However the contact is pushed, ∫F dθ is at least the energy σ0 φ²/2 that it can give back."""
    motor = rig_truth().actuator.motor
    pieces = np.repeat(np.array(path) / 50, 50)
    torques = np.concatenate([[0.0], friction_along(pieces, 1.0)])
    work = float(((torques[1:] + torques[:-1]) / 2 * pieces).sum())
    assert work >= torques[-1] ** 2 / (2 * motor.sigma_0) - 1e-3 * motor.tau_c * np.abs(pieces).sum()


@given(
    actuator=MACHINE_FACTORS,
    load=MACHINE_FACTORS,
    commands=st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-1, 1)), min_size=5, max_size=20),
)
@settings(max_examples=25)
def test_friction_never_exceeds_coulombs(actuator, load, commands):
    truth = scaled(scaled(rig_truth(), "actuator", actuator), "load", load)
    truth = changed(truth, "actuator", presliding_damping_nm_s_rad=0.0)
    bench, state = pack(truth, "free"), still_state()
    bounds = np.array([truth.actuator.motor.tau_c, truth.load.motor.tau_c])
    for tick, (e_actuator, e_load) in enumerate(commands):
        state[ACTUATOR, columns.CURRENT_TARGET] = truth.actuator.motor.Ka * e_actuator
        state[LOAD, columns.CURRENT_TARGET] = truth.load.motor.Ka * e_load
        for part in range(20):
            run(state, bench, tick * MS + part * 50_000, tick * MS + (part + 1) * 50_000)
            assert (np.abs(state[:, columns.FRICTION]) <= bounds * (1 + 1e-12)).all()


@pytest.mark.parametrize("command", [-0.3, -0.1, -0.03, -0.02, 0.0, 0.01, 0.02, 0.03, 0.1, 0.3])
def test_free_motion_settles_on_the_three_branches_of_the_source(command):
    """ω_N = (Km Ka e_c ∓ τc)/B beyond the threshold of ±τc, and 0 between (IV.D)."""
    plant = Plant(smooth_alone(), 0)
    plant.command("actuator", command)
    plant.advance(1500 * MS)
    torque, coulomb, viscous = 0.05 * 18 * command, 0.02, 1e-3
    expected = math.copysign(max(abs(torque) - coulomb, 0.0), torque) / viscous
    assert plant.true_velocity_rad_s("actuator") == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert plant.true_port_torque_nm() == 0.0


@pytest.mark.parametrize("command", [0.2, 0.05, -0.05, -0.2])
def test_blocked_torque_after_a_slow_approach_is_ambiguous_by_twice_coulombs(command):
    """IV.D: B ω_N after an approach from ω > 0 if Km Ka e_c ≥ τc, but B ω_N − 2 τc if Km Ka e_c ≤ −τc."""
    truth = smooth_alone()
    bench, state = pack(truth, "clamped"), still_state()
    motor = truth.actuator.motor
    state[ACTUATOR, columns.CURRENT_TARGET] = motor.Ka * command
    for tick in range(1500):  # the far end of the sensor slows from 2 rad/s to standstill
        state[LOAD, columns.VELOCITY] = max(0.0, 2.0 * (1 - tick / 1000))
        run(state, bench, tick * MS, (tick + 1) * MS)
    twist_rad = state[ACTUATOR, columns.ANGLE] - state[LOAD, columns.ANGLE]
    source = motor.B * motor.source_velocity(command)
    expected = source if command > 0 else source - 2 * motor.tau_c
    assert bench.stiffness * twist_rad == pytest.approx(expected, abs=0.02 * motor.tau_c)


def stored_energy_j(state: np.ndarray, truth: Truth) -> float:
    """Kinetic, of the sensor's spring, and what the friction contacts can give back."""
    twist_rad = state[ACTUATOR, columns.ANGLE] - state[LOAD, columns.ANGLE]
    energy = truth.torque_sensor.stiffness_nm_rad * twist_rad**2 / 2
    for row, motor in ((ACTUATOR, truth.actuator.motor), (LOAD, truth.load.motor)):
        energy += motor.Im * state[row, columns.VELOCITY] ** 2 / 2
        energy += state[row, columns.FRICTION] ** 2 / (2 * motor.sigma_0)
    return float(energy)


def powers_w(state: np.ndarray, truth: Truth) -> tuple[float, float]:
    """Power given by the motors and power lost, by the paper's equations."""
    slip = state[ACTUATOR, columns.VELOCITY] - state[LOAD, columns.VELOCITY]
    given_w, lost_w = 0.0, truth.torque_sensor.damping_nm_s_rad * slip**2
    for row, machine in ((ACTUATOR, truth.actuator), (LOAD, truth.load)):
        motor, omega = machine.motor, state[row, columns.VELOCITY]
        phi = state[row, columns.FRICTION] / motor.sigma_0
        given_w += machine.mounted * motor.Km * state[row, columns.CURRENT] * omega
        kept_w = motor.sigma_0 * phi * motor.dahl_rate(omega, phi)
        lost_w += motor.B * omega**2 + motor.dahl_torque(omega, phi) * omega - kept_w
    return given_w, lost_w


def test_energy_of_the_coupled_pair_balances():
    truth = changed(rig_truth(), "actuator", cogging=None)
    bench, state = pack(truth, "free"), still_state()
    draws = np.random.default_rng(2).uniform([-0.3, -0.2], [0.3, 0.2], size=(20, 2))
    given_w, lost_w, step_ns = [], [], 5_000
    for tick in range(100):
        state[:, columns.CURRENT_TARGET] = draws[tick // 5] * [truth.actuator.motor.Ka, truth.load.motor.Ka]
        for part in range(MS // step_ns):
            given, lost = powers_w(state, truth)
            given_w.append(given)
            lost_w.append(lost)
            now_ns = tick * MS + part * step_ns
            run(state, bench, now_ns, now_ns + step_ns, 1e-6)
    given_j, lost_j = np.sum(given_w) * step_ns * 1e-9, np.sum(lost_w) * step_ns * 1e-9
    assert lost_j > 0
    assert given_j == pytest.approx(lost_j + stored_energy_j(state, truth), rel=1e-3)


@given(
    actuator=MACHINE_FACTORS,
    load=MACHINE_FACTORS,
    stiffness=st.floats(50, 1000),
    velocities=st.tuples(st.floats(-80, 80), st.floats(-80, 80)),
    twist=st.floats(-0.01, 0.01),
)
@settings(max_examples=40)
def test_a_bench_left_to_itself_only_loses_energy(actuator, load, stiffness, velocities, twist):
    truth = scaled(scaled(changed(rig_truth(), "actuator", cogging=None), "actuator", actuator), "load", load)
    truth = changed(truth, "torque_sensor", stiffness_nm_rad=stiffness)
    bench, state = pack(truth, "free"), still_state()
    state[:, columns.VELOCITY] = velocities
    state[ACTUATOR, columns.ANGLE] = twist
    start_j = before_j = stored_energy_j(state, truth)
    for tick in range(50):
        run(state, bench, tick * MS, (tick + 1) * MS)
        after_j = stored_energy_j(state, truth)
        assert after_j <= before_j * (1 + 5e-3)  # a splitting step stores its energy a little beside the true one's
        before_j = after_j
    assert before_j < start_j or start_j == 0


@given(
    actuator=MACHINE_FACTORS,
    load=MACHINE_FACTORS,
    stiffness=st.floats(50, 1000),
    presliding=st.floats(2, 100),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40)
def test_any_bench_driven_at_its_limits_stays_stable_and_accurate(actuator, load, stiffness, presliding, seed):
    """Commands change at 1 kHz, time is cut in four calls a tick; a substep four times finer tells the same."""
    truth = scaled(scaled(rig_truth(), "actuator", actuator), "load", load)
    truth = changed(truth, "torque_sensor", stiffness_nm_rad=stiffness)
    truth = changed(truth, "actuator", presliding_stiffness_nm_rad=presliding)
    fine_s = pack(truth, "free").substep_s / 4
    usual, fine = (velocities(Plant(truth, 0, substep_s=s), seed) for s in (math.inf, fine_s))
    assert np.isfinite(usual).all()
    assert np.abs(usual - fine).max() <= 0.01 * np.abs(fine).max()


def test_a_bench_too_stiff_for_the_usual_substep_gets_a_shorter_one():
    """A coupling of 3e5 N m/rad rings at 1.6e5 rad/s, which 20 µs would answer by exploding."""
    truth = changed(rig_truth(), "torque_sensor", stiffness_nm_rad=3e5)
    truth = changed(truth, "actuator", inertia_kg_m2=1.25e-5)
    plant = Plant(truth, 0)
    found = velocities(plant, 1)
    assert np.abs(found[:, 0] - found[:, 1]).max() < 0.02 * np.abs(found).max()


def velocities(plant: Plant, seed: int) -> np.ndarray:
    """Both velocities each millisecond under random commands of the greatest magnitudes: shape (40, 2)."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(40, 2))
    rows = []
    for tick, (actuator, load) in enumerate(signs):
        plant.command("actuator", 0.5 * actuator)
        plant.command("load", load)
        for quarter in range(1, 5):
            plant.advance(tick * MS + quarter * MS // 4)
        rows.append([plant.true_velocity_rad_s("actuator"), plant.true_velocity_rad_s("load")])
    return np.array(rows)
