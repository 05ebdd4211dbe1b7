"""Exports for robot simulators: URDF run by MuJoCo, Isaac Lab's configuration read, ranges against the covariance."""

import ast
import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import NetworkTerm
from norton_bench.networks.export.robots import DRAWS, export_isaac_lab, export_ranges, export_urdf
from tests.bench.networks.some import MOTOR, PNEUMATIC

TICK_S = 1e-3
COMMAND = 0.06 * np.sin(2 * np.pi * 3 * np.arange(800) * TICK_S)
STRIBECK = replace(MOTOR, terms=(NetworkTerm("stribeck", (0.006, 5.0)),))
NAMES = ("inertia", "coulomb_torque", "stribeck_torque")
DEVIATIONS = np.array([1e-7, 2e-4, 3e-4])
CORRELATED = np.array([[1.0, 0.2, 0.0], [0.2, 1.0, -0.8], [0.0, -0.8, 1.0]]) * np.outer(DEVIATIONS, DEVIATIONS)
KNOWN = replace(STRIBECK, covariance_names=NAMES, covariance=tuple(map(tuple, CORRELATED.tolist())))


def test_urdf_moves_as_the_network_does_where_there_is_neither_lag_nor_presliding():
    model = mujoco.MjModel.from_xml_string(export_urdf(MOTOR, "motor").text)
    model.opt.timestep = 1e-4
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_solref[:] = (2e-4, 1.0)
    data, velocity = mujoco.MjData(model), np.empty(COMMAND.size)
    for k, held in enumerate(COMMAND):
        velocity[k] = data.qvel[0]
        data.qfrc_applied[0] = MOTOR.torque_gain * held
        mujoco.mj_step(model, data, 10)
    dry = replace(
        MOTOR, amplifier_bandwidth_rad_s=1e5, presliding_stiffness_nm_rad=2e3, presliding_damping_nms_rad=1e-4
    )
    expected = dry.free_motion(COMMAND, TICK_S)[1]
    assert np.sqrt(np.mean((velocity - expected) ** 2)) < 0.01 * np.std(expected)


def test_urdf_says_what_it_leaves_out():
    exported = export_urdf(STRIBECK, "motor")
    assert [
        next(word for word in ("path of the command", "Presliding", "term stribeck") if word in sentence)
        for sentence in exported.left_out
    ] == ["path of the command", "Presliding", "term stribeck"]
    assert all(sentence in exported.text for sentence in exported.left_out)


def test_isaac_labs_configuration_is_python_with_the_networks_values():
    tree = ast.parse(export_isaac_lab(STRIBECK, "2nd-motor.v1").text)
    (assigned,) = (each for each in tree.body if isinstance(each, ast.Assign))
    values = {each.arg: ast.literal_eval(each.value) for each in assigned.value.keywords}
    assert assigned.targets[0].id == "_2ND_MOTOR_V1_ACTUATOR"
    assert values == {
        "joint_names_expr": [".*"],
        "stiffness": 0.0,
        "damping": 0.0,
        "armature": MOTOR.inertia_kgm2,
        "friction": pytest.approx(0.026),
        "dynamic_friction": MOTOR.coulomb_torque_nm,
        "viscous_friction": MOTOR.viscous_damping_nms_rad,
    }


def test_ranges_are_those_of_the_covariance():
    content = json.loads(export_ranges(KNOWN, "motor").text)
    coulomb = content["parameters"]["coulomb_torque"]
    assert coulomb == {"value": 0.02, "low": pytest.approx(0.019608), "high": pytest.approx(0.020392), "unit": "N*m"}
    draws = np.array(content["draws"]["values"])
    assert (draws.shape, tuple(content["draws"]["names"])) == ((DRAWS, len(NAMES)), NAMES)
    # Of 200 draws a mean is known to 0.07 deviations, a deviation to 5 %, a correlation to 0.07.
    assert np.all(np.abs(draws.mean(axis=0) - (MOTOR.inertia_kgm2, 0.02, 0.006)) < 0.28 * DEVIATIONS)
    assert np.all(np.abs(draws.std(axis=0) / DEVIATIONS - 1.0) < 0.2)
    assert np.corrcoef(draws.T)[1, 2] == pytest.approx(-0.8, abs=0.15)


def test_no_draw_is_what_no_machine_has():
    vague = replace(KNOWN, covariance_names=("coulomb_torque",), covariance=((0.02**2,),))
    draws = np.array(json.loads(export_ranges(vague, "motor").text)["draws"]["values"])
    assert draws.min() > 0.0


@pytest.mark.parametrize("export", [export_urdf, export_isaac_lab, export_ranges])
def test_what_is_no_motor_with_a_scale_is_refused(export):
    with pytest.raises(UsageError, match="identified motor"):
        export(PNEUMATIC, "muscle")
    ratios: NortonNetwork = MOTOR.with_provenance({"scale": "free motion only"})
    with pytest.raises(UsageError, match="only ratios"):
        export(ratios, "motor")


def test_without_covariance_there_is_no_range():
    with pytest.raises(UsageError, match="no covariance"):
        export_ranges(MOTOR, "motor")
