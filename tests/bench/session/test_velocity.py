"""A servo that holds a velocity from rig file to network: a short session on the simulated bench, and its fit."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import RigError
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.source_map import source_map
from norton_bench.models.parameters import Status
from norton_bench.procedures.options import STEPS as STEPS_OPTIONS
from norton_bench.procedures.options import CalibrateOptions, FreeOptions, ImposedOptions, TareOptions
from norton_bench.rig.load import load_rig, parse_rig, true_parameters
from norton_bench.session.dry_run import dry_run
from norton_bench.session.engine import record_session
from norton_bench.session.items import Session, Step
from norton_bench.session.run import guard_model_of
from norton_bench.session.schema import standard_session
from tests.bench.half_rate import half_rate
from tests.bench.session.free_servo import motion_in_mujoco, true_places

pytestmark = pytest.mark.long

RIG = Path(__file__).parents[3] / "rigs" / "sim-mit-velocity.toml"
STEPS = (
    Step("tare", TareOptions(duration_s=0.5)),
    Step("calibrate", CalibrateOptions(duration_s=4.0)),
    Step("free", FreeOptions(levels=4, dwell_s=0.3, duration_s=2.0)),
    Step("imposed", ImposedOptions(duration_s=2.0)),
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    rig = half_rate(RIG.stem)
    return record_session(
        rig, Session(STEPS, "a short one"), out=tmp_path_factory.mktemp("velocity"), seed=51, live=False
    )


@pytest.fixture(scope="module")
def fitted(recorded):
    rig = half_rate(RIG.stem)
    return fit(recorded.measured, command_unit=rig.command.unit, tick_s=rig.tick_s, draws=0)


def test_every_parameter_is_found(fitted):
    """Deviations here are those of the residual alone: they do not hold what an encoder's counts leave unknown."""
    truth = {name: value for name, (value, _) in true_parameters(load_rig(RIG)).items()}
    assert fitted.converged
    for estimate in fitted.estimates:
        assert estimate.status is Status.VALID, estimate
        true = truth[estimate.name]
        assert estimate.value == pytest.approx(true, abs=0.01 * true + 4.0 * estimate.std), estimate


def test_the_recording_keeps_what_is_known_of_the_devices(recorded):
    chain = recorded.measured.chain
    assert chain == load_rig(RIG).chain
    assert chain.answers_commands == {"actuator"}, "an ODrive sends by itself"


def test_the_source_that_is_measured_is_that_of_the_motor_behind_its_loop(recorded):
    truth = {name: value for name, (value, _) in true_parameters(load_rig(RIG)).items()}
    gain, damping, friction = (truth[name] for name in ("torque_gain", "viscous_damping", "coulomb_torque"))
    seen = source_map(recorded.measured)
    expected = np.sign(seen.command) * np.maximum(gain * np.abs(seen.command) - friction, 0.0) / (gain + damping)
    assert seen.velocity_rad_s == pytest.approx(expected, abs=0.1)


def test_its_mujoco_file_follows_an_unseen_command_as_the_plant_does(fitted):
    rig, time_s = load_rig(RIG), np.arange(3000) * 1e-3
    asked = 6.0 * np.sin(2 * np.pi * 0.7 * time_s) + 3.0 * np.sin(2 * np.pi * 2.3 * time_s)
    _, velocities = motion_in_mujoco(fitted.network, asked)
    velocity = np.gradient(true_places(rig, asked), rig.tick_s)
    assert np.sqrt(np.mean((velocity - velocities) ** 2)) < 0.02 * np.sqrt(np.mean(velocity**2))


def test_units_are_a_servos(fitted):
    units = {estimate.name: estimate.unit for estimate in fitted.estimates}
    assert units["torque_gain"] == "N*m/(rad/s)"
    assert units["torque_limit"] == "N*m"
    assert fitted.network.servo == load_rig(RIG).servo


def test_the_guard_does_not_expect_a_current_or_a_torque_of_a_command_alone(recorded):
    model = guard_model_of(recorded.knowledge)
    assert model.load is not None
    assert (model.actuator, model.amperes_per_command) == (None, None)


def test_the_standard_session_keeps_to_the_limits():
    rig = load_rig(RIG)
    session = standard_session(rig)
    assert [step.do for step in session.steps] == ["tare", "calibrate", "free", "imposed", "validate"]
    dry_run(session, rig)


@pytest.mark.parametrize("name", ["blocked", "refine", "iterate_zero_torque"])
def test_what_moves_a_motor_refuses_a_servo(name):
    with pytest.raises(RigError, match=f"step '{name}' is for a motor, and the command of this actuator is a velocity"):
        dry_run(Session((Step(name, STEPS_OPTIONS[name]()),), "a session"), load_rig(RIG))


@pytest.mark.parametrize(
    ("written", "instead", "sentence"),
    [
        (
            'unit = "rad/s", limit = "20 rad/s"',
            'unit = "N*m", limit = "1 N*m"',
            r'takes commands in "rad/s"; write unit = "rad/s", or mode = "torque"',
        ),
        ('mode = "velocity"', 'mode = "torque"', r'"rad/s", but driver = "mit" as it is set here takes .* mode = "vel'),
        (
            'damping = "0.04 N*m*s/rad"',
            'damping = "0 N*m*s/rad"',
            r'\[actuator\] damping: mode = "velocity" needs it',
        ),
        ('mode = "velocity" ', 'mode = "velocity"\nstiffness = "2 N*m/rad" #', r'mode = "velocity" has none'),
        (
            'limit = "20 rad/s"',
            'limit = "30 rad/s"',
            r"\[actuator.command\] limit.*30 rad/s is what a free shaft would turn at, and \[limits\] velocity = 20",
        ),
    ],
)
def test_a_wrong_servo_is_told_in_a_sentence(written, instead, sentence):
    text = RIG.read_text().replace(written, instead, 1)
    assert text != RIG.read_text()
    with pytest.raises(RigError, match=sentence):
        parse_rig(text, place="servo.toml")
