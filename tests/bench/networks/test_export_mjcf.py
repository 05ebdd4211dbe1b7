"""Exported MJCF, run by MuJoCo itself, against the network on the same commands."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.models.parameters import PredictionError
from norton_bench.networks.export.mjcf import export_mjcf
from norton_bench.networks.family import coupled
from norton_bench.networks.kinds import Form, Kind, Load
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.operator import Operator
from tests.bench.networks.some import ALL_TERMS, JOINTS, MOTOR, MOTORS, PNEUMATIC

TICK_S = 1e-3
TIME_S = np.arange(800) * TICK_S


def run(text, command, extra_inertia=0.0):
    """Angle and velocity at the ticks, with a load's inertia put where the file says."""
    model = mujoco.MjModel.from_xml_string(text)
    model.body_inertia[model.body("output").id] += extra_inertia
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    steps = round(TICK_S / model.opt.timestep)
    motion = np.empty((2, command.size))
    for k, held in enumerate(command):
        motion[:, k] = data.qpos[0], data.qvel[0]
        data.ctrl[0] = held
        mujoco.mj_step(model, data, steps)
    return motion


def off(found, expected):
    return np.sqrt(np.mean((found - expected) ** 2)) / np.std(expected)


@pytest.mark.parametrize("extra_kgm2", [0.0, 1e-4])
def test_the_motor_moves_as_its_network_does(extra_kgm2):
    """Within 5 % of its velocity with the presliding that MJCF leaves out, within 1 % where there is hardly any."""
    command = 0.06 * np.sin(2 * np.pi * 3 * TIME_S)
    loaded = replace(MOTOR, inertia_kgm2=MOTOR.inertia_kgm2 + extra_kgm2)
    model = export_mjcf(MOTOR, "motor")
    _, velocity = run(model.text, command, extra_kgm2)
    assert off(velocity, loaded.free_motion(command, TICK_S)[1]) < 0.05
    abrupt = replace(loaded, presliding_stiffness_nm_rad=2000.0, presliding_damping_nms_rad=1e-4)
    assert off(velocity, abrupt.free_motion(command, TICK_S)[1]) < 0.01
    assert "Presliding is left out" in model.left_out[0]
    assert model.left_out[0].replace("--", "- -") in model.text


def test_the_motor_settles_on_its_source():
    for command in (0.06, -0.04):
        _, velocity = run(export_mjcf(MOTOR, "motor").text, np.full(600, command))
        assert velocity[-1] == pytest.approx(float(MOTOR.source_velocity(command)), rel=1e-3)
    _, velocity = run(export_mjcf(MOTOR, "motor").text, np.full(600, 0.9 * MOTOR.thresholds[1]))
    assert abs(velocity[-1]) < 0.1


@pytest.mark.parametrize("shape", [(Kind.THEVENIN, Form.IMPEDANCE), (Kind.THEVENIN, Form.ADMITTANCE)])
def test_a_linear_network_moves_a_load_as_it_does_itself(shape):
    """Within 0.5 %; MuJoCo's own integration of 0.5 ms is what is left."""
    network = LinearNetwork(
        Kind.THEVENIN,
        Form.IMPEDANCE,
        Operator.rational([2.0 * 80.0], [1.0, 80.0]),
        Operator.polynomial(3.0, 0.1, 0.01),
        ("V",),
    ).converted(*shape)
    command = np.sign(np.sin(2 * np.pi * 2 * TIME_S + 0.1))
    expected = coupled(network, command, Load(inertia_kgm2=0.02), TICK_S).position_rad
    model = export_mjcf(network, "arm")
    position, _ = run(model.text, command, 0.02)
    assert off(position, expected) < 0.005
    assert model.left_out == ()


# What each form has of the terms; load friction is nothing where no load is, and Stribeck's is slow sliding alone.
CARRIED = ("stribeck", "drag", "cogging")


@pytest.mark.parametrize("name", ["none", *CARRIED])
def test_a_dcmotor_moves_as_the_network_does(name):
    """Presliding, Stribeck friction, drag and every wave of cogging: within 1 % rms of the velocity."""
    network = MOTORS.get(name, MOTOR)
    command = 0.06 * np.sin(2 * np.pi * 3 * TIME_S)
    expected = network.free_motion(command, TICK_S, longest_step_s=2e-5)[1]
    model = export_mjcf(network, "motor", dcmotor=True)
    _, velocity = run(model.text, command)
    assert model.left_out == ()
    assert off(velocity, expected) < 0.01
    if name != "none":
        assert off(velocity, MOTOR.free_motion(command, TICK_S)[1]) > 2 * off(velocity, expected)


def test_a_dcmotor_steps_the_shorter_the_faster_it_was_seen():
    """σ0·|ω|·h/τc = 1 at the greatest velocity."""
    seen = replace(MOTOR, prediction=PredictionError(0.0, 0.0, 0.95, {"velocity": (-50.0, 80.0)}))
    model = mujoco.MjModel.from_xml_string(export_mjcf(seen, "motor", dcmotor=True).text)
    assert model.opt.timestep == pytest.approx(MOTOR.coulomb_torque_nm / (MOTOR.presliding_stiffness_nm_rad * 80.0))


@pytest.mark.parametrize("dcmotor", [False, True])
def test_every_term_that_is_left_out_is_named_with_its_cost(dcmotor):
    model = export_mjcf(ALL_TERMS, "motor", dcmotor=dcmotor)
    named = {name for name in MOTORS for each in model.left_out if each.startswith(f"The term {name} is left out")}
    assert named == set(MOTORS) - (set(CARRIED) if dcmotor else set())
    for sentence in model.left_out:
        assert re.search(r"That costs [\d.]+ % of the torque's rms", sentence)
        assert sentence.replace("--", "- -") in model.text


@pytest.mark.parametrize("dcmotor", [False, True])
@pytest.mark.parametrize("name", ["compliance", "backlash"])
def test_a_joint_is_left_out_with_its_cost_and_what_turns_beyond_it_stays(name, dcmotor):
    model = export_mjcf(JOINTS[name], "motor", dcmotor=dcmotor)
    sentence = model.left_out[-1]
    assert sentence.startswith(f"The term {name} is left out (k = 8 N*m/rad, d = 0.01")
    assert "That costs" in sentence
    one, other = (export_mjcf(each, "motor", dcmotor=dcmotor) for each in (JOINTS[name], JOINTS[name].rigid))
    armatures = [mujoco.MjModel.from_xml_string(each.text).dof_armature[0] for each in (one, other)]
    assert armatures[0] == armatures[1]


def linear(source, connection):
    return LinearNetwork(Kind.THEVENIN, Form.IMPEDANCE, source, connection, ("V",) * source.inputs)


GAIN, INERTIA = Operator.gains(1.0), Operator.polynomial(0.0, 0.1, 0.01)


@pytest.mark.parametrize(
    ("network", "says"),
    [
        (PNEUMATIC, "no words for a nonlinear network"),
        (linear(GAIN, Operator.polynomial(1.0, 0.1)), "no inertia of its own"),
        (linear(GAIN, Operator.rational([1.0, 2.0, 3.0], [1.0, 4.0])), "states of its own"),
        (linear(GAIN, Operator.polynomial(-1.0, 0.1, 0.01)), "no negative stiffness"),
        (linear(Operator.gains(1.0, 2.0), INERTIA), "takes 2 commands"),
        (linear(Operator.rational([1.0], [1.0, 2.0, 9.0]), INERTIA), "a gain and at most one lag"),
    ],
)
def test_what_mujoco_cannot_be_told_is_one_sentence(network, says):
    with pytest.raises(UsageError, match=says):
        export_mjcf(network, "n")


@pytest.mark.parametrize("network", [PNEUMATIC, linear(GAIN, INERTIA)])
def test_a_dcmotor_is_for_an_identified_motor(network):
    with pytest.raises(UsageError, match="is for an identified motor"):
        export_mjcf(network, "n", dcmotor=True)
