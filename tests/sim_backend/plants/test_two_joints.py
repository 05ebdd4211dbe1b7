"""Two joints of one arm against scipy's Radau on their equations, written here once more."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.rig.load import load_rig
from norton_drivers.errors import WiringError
from norton_sim.joined import open_two_joints, true_joints
from norton_sim.truth import read_truth

MS = 1_000_000
TICKS = 60
FOLDER = Path(__file__).parents[3] / "rigs" / "two-joints"


def shipped() -> tuple[list, dict]:
    rigs = [load_rig(FOLDER / f"{joint}.toml") for joint in ("shoulder", "elbow")]
    arm = tomllib.loads((FOLDER / "arm.toml").read_text())["simulated"]
    return [(rig.wiring, rig.simulated, rig.place) for rig in rigs], arm


def least_jerk(t: float, began: float, start: float, target: float, movement: float) -> tuple[float, float]:
    """Flash and Hogan (1985), from rest to rest."""
    p = min(max((t - began) / movement, 0.0), 1.0)
    away = target - start
    return start + away * (10 * p**3 - 15 * p**4 + 6 * p**5), away * (30 * p**2 - 60 * p**3 + 30 * p**4) / movement


def radau(truths, arm: dict, targets: np.ndarray, elbow_rad: float) -> np.ndarray:
    """Both ports' and both loads' angles and velocities after each tick; each joint reaches once, at time zero.

    State of each joint: port's angle and velocity, load's angle, velocity and Dahl state, torque of the load's
    amplifier.
    """
    number = {key: float(str(text).split()[0]) for key, text in arm.items()}
    m1, m2, l1 = number["upper_mass"], number["lower_mass"], number["upper_length"]
    c1, c2 = number["upper_centre"], number["lower_centre"]
    i1, i2 = number["upper_inertia"], number["lower_inertia"]
    cross = np.array([[0, number["shoulder_by_elbow"]], [number["elbow_by_shoulder"], 0]])
    cross_damping = [[0, number["shoulder_by_elbow_damping"]], [number["elbow_by_shoulder_damping"], 0]]

    def f(t, x, commands, loads_nm):
        s = x.reshape(2, 6)
        theta, omega = s[:, 0], s[:, 1]
        own = np.diag([each.actuator.output.inertia_kg_m2 for each in truths])
        # By the links' kinetic energy: the centre of mass of the lower one moves by both angles.
        e = elbow_rad + theta[1]
        i12 = i2 + m2 * (c2**2 + l1 * c2 * math.cos(e))
        i11 = i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2 + 2 * l1 * c2 * math.cos(e))
        inertia = np.array([[i11, i12], [i12, i2 + m2 * c2**2]]) + own
        h = m2 * l1 * c2 * math.sin(e)
        coriolis = np.array([-h * (2 * omega[0] * omega[1] + omega[1] ** 2), h * omega[0] ** 2])
        source = [
            least_jerk(t, 0.0, 0.0, c, each.actuator.movement_s) for c, each in zip(commands, truths, strict=True)
        ]
        stiffness, damping = cross.copy(), np.array(cross_damping)
        port, load_rates = np.zeros(2), np.zeros((2, 3))
        for j, each in enumerate(truths):
            p = t / each.actuator.movement_s
            stiffness[j, j] = (
                each.actuator.stiffness_nm_rad + each.actuator.moving_stiffness_nm_rad * 16 * (p - p * p) ** 2
            )
            damping[j, j] = each.actuator.damping_nm_s_rad
            load, sensor = each.load, each.torque_sensor
            port[j] = sensor.stiffness_nm_rad * (theta[j] - s[j, 2]) + sensor.damping_nm_s_rad * (omega[j] - s[j, 3])
            slip = s[j, 3] - load.presliding_stiffness_nm_rad / load.coulomb_torque_nm * abs(s[j, 3]) * s[j, 4]
            resists = load.presliding_stiffness_nm_rad * s[j, 4] + load.presliding_damping_nm_s_rad * slip
            resists += load.viscous_damping_nm_s_rad * s[j, 3]
            lag = load.amplifier_bandwidth_rad_s * (load.torque_gain * loads_nm[j] - s[j, 5])
            load_rates[j] = (s[j, 5] + port[j] - resists) / load.inertia_kg_m2, slip, lag
        viscous = np.array([each.actuator.output.viscous_damping_nm_s_rad for each in truths])
        exerted = stiffness @ (np.array([q for q, _ in source]) - theta)
        exerted += damping @ (np.array([v for _, v in source]) - omega)
        turned = np.linalg.solve(inertia, exerted - viscous * omega - coriolis - port)
        return np.column_stack([omega, turned, s[:, 3], load_rates]).ravel()

    x, rows = np.zeros(12), []
    for tick, (*commands, load_1, load_2) in enumerate(targets):
        span = (tick * 1e-3, (tick + 1) * 1e-3)
        found = solve_ivp(f, span, x, method="Radau", rtol=1e-8, atol=1e-11, args=(commands, (load_1, load_2)))
        x = found.y[:, -1]
        rows.append(x.reshape(2, 6)[:, :4].ravel())
    return np.array(rows)


@pytest.mark.long
@pytest.mark.parametrize("elbow_rad", [1.6, 0.3])
def test_moves_as_the_equations_say(elbow_rad):
    benches, arm = shipped()
    arm["elbow"] = f"{elbow_rad} rad"
    pushes = np.repeat(np.random.default_rng(5).uniform(-12, 12, size=(TICKS // 5, 2)), 5, axis=0)
    targets = np.column_stack([np.full(TICKS, 0.4), np.full(TICKS, -0.3), pushes])
    truths = [read_truth(simulated, seed=None, place=place, command_unit="rad") for _, simulated, place in benches]
    reference = radau(truths, arm, targets, elbow_rad)
    backends, rows = open_two_joints(benches, arm, seed=None, place="here"), []
    shoulder, elbow = (backend.world.plant for backend in backends)
    for tick, (*commands, load_1, load_2) in enumerate(targets, start=1):
        for plant, command, load_nm in ((shoulder, commands[0], load_1), (elbow, commands[1], load_2)):
            plant.command("actuator", command)
            plant.command("load", -load_nm)  # mounted face to face
        backends[0].world.advance(tick * MS)
        rows.append(
            [
                value(machine)
                for plant in (shoulder, elbow)
                for machine in ("actuator", "load")
                for value in (plant.true_position_rad, plant.true_velocity_rad_s)
            ]
        )
    scale = np.abs(reference).max(axis=0)
    assert scale.min() > 1e-3  # all of them move
    assert np.max(np.abs(np.array(rows) - reference) / scale) < 2e-4


def test_benches_of_one_arm_live_in_one_time():
    backends = open_two_joints(*shipped(), seed=None, place="here")
    backends[1].clock.wait_until_ns(5 * MS)
    assert [backend.clock.now_ns() for backend in backends] == [5 * MS, 5 * MS]
    assert [backend.world.plant.now_ns for backend in backends] == [5 * MS, 5 * MS]


def test_a_jammed_joint_stands_and_the_other_moves():
    backends = open_two_joints(*shipped(), seed=None, place="here")
    shoulder, elbow = (backend.world.plant for backend in backends)
    elbow.jam("actuator")
    elbow.command("load", 5.0)
    shoulder.command("load", 5.0)
    backends[0].world.advance(20 * MS)
    assert elbow.true_velocity_rad_s("actuator") == 0.0
    assert shoulder.true_position_rad("actuator") < -1e-3


def test_true_matrices_are_those_of_the_posture():
    true = true_joints(*shipped(), place="here")
    np.testing.assert_allclose(true["stiffness"], [[22, 6], [4, 16]])
    np.testing.assert_allclose(true["damping"], [[1.12, 0.3], [0.2, 0.82]])
    np.testing.assert_allclose(true["inertia"], true["inertia"].T)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"elbow": "1.6 N*m"}, r"here: \[simulated\] elbow: "),
        ({"uper_mass": "1 kg"}, r'here: \[simulated\] uper_mass is not known; did you mean "upper_mass"\?'),
    ],
)
def test_mistakes_are_told_with_their_place(change, sentence):
    benches, arm = shipped()
    with pytest.raises(WiringError, match=sentence):
        open_two_joints(benches, {**arm, **change}, seed=None, place="here")


def test_a_joint_that_is_no_arm_is_refused():
    benches, arm = shipped()
    motor = load_rig(FOLDER.parent / "sim-odrive.toml")
    with pytest.raises(WiringError, match=r'the simulated elbow must be of model = "arm"'):
        open_two_joints([benches[0], (motor.wiring, motor.simulated, motor.place)], arm, seed=None, place="here")
