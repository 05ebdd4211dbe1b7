"""A servo from rig file to network: a short session on the simulated bench, through its frames, and its fit."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import RigError
from norton_bench.identification.judged_fit import fit
from norton_bench.models.parameters import Status
from norton_bench.procedures.options import STEPS as STEPS_OPTIONS
from norton_bench.procedures.options import CalibrateOptions, ImposedOptions, TareOptions
from norton_bench.rig.load import load_rig, parse_rig, true_parameters
from norton_bench.session.dry_run import dry_run
from norton_bench.session.engine import record_session
from norton_bench.session.items import Session, Step
from norton_bench.session.schema import standard_session
from tests.bench.half_rate import half_rate
from tests.bench.session.free_servo import motion_in_mujoco, true_places

pytestmark = pytest.mark.long

RIG = Path(__file__).parents[3] / "rigs" / "sim-servo.toml"
STEPS = (
    Step("tare", TareOptions(duration_s=0.5)),
    Step("calibrate", CalibrateOptions(duration_s=4.0)),
    Step("imposed", ImposedOptions(duration_s=2.0)),
)
# Of simulated cogging, whose period a short session does not travel: 0.3 mN m, 42 periods a turn.
COGGING_STIFFNESS_NM_RAD = 42 * 0.3e-3


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    rig = half_rate(RIG.stem)
    recorded = record_session(
        rig, Session(STEPS, "a short one"), out=tmp_path_factory.mktemp("servo"), seed=51, live=False
    )
    return fit(recorded.measured, command_unit=rig.command.unit, tick_s=rig.tick_s, draws=0)


def test_every_parameter_is_found(fitted):
    """Deviations here are those of the residual alone: they do not hold what an encoder's counts leave unknown."""
    truth = {name: value for name, (value, _) in true_parameters(load_rig(RIG)).items()}
    assert fitted.converged
    for estimate in fitted.estimates:
        assert estimate.status is Status.VALID, estimate
        unknown = COGGING_STIFFNESS_NM_RAD if estimate.name == "torque_gain" else 0.0
        unknown += 0.02 * truth[estimate.name] if estimate.name != "viscous_damping" else 2e-4
        assert estimate.value == pytest.approx(truth[estimate.name], abs=unknown + 4.0 * estimate.std), estimate


def test_its_mujoco_file_follows_an_unseen_goal_as_the_plant_does(fitted):
    time_s = np.arange(3000) * 1e-3
    goals = 0.3 * np.sin(2 * np.pi * 0.7 * time_s) + 0.15 * np.sin(2 * np.pi * 2.3 * time_s)
    places, _ = motion_in_mujoco(fitted.network, goals)
    place = true_places(load_rig(RIG), goals)
    assert np.sqrt(np.mean((place - places) ** 2)) < 0.01 * np.sqrt(np.mean(place**2))


def test_units_are_a_servos(fitted):
    units = {estimate.name: estimate.unit for estimate in fitted.estimates}
    assert units["torque_gain"] == "N*m/(rad)"
    assert units["torque_limit"] == "N*m"
    assert fitted.network.servo == load_rig(RIG).servo


def test_the_standard_session_keeps_to_the_limits():
    rig = load_rig(RIG)
    session = standard_session(rig)
    assert [step.do for step in session.steps] == ["tare", "calibrate", "free", "imposed", "validate"]
    dry_run(session, rig)


@pytest.mark.parametrize("name", ["blocked", "refine", "iterate_zero_torque"])
def test_what_moves_a_motor_refuses_a_servo(name):
    with pytest.raises(RigError, match=f"step '{name}' is for a motor, and the command of this actuator is a position"):
        dry_run(Session((Step(name, STEPS_OPTIONS[name]()),), "a session"), load_rig(RIG))


@pytest.mark.parametrize(
    ("written", "instead", "sentence"),
    [
        (
            'unit = "rad", limit = "1 rad"',
            'unit = "N*m", limit = "1 N*m"',
            r'takes commands in "rad"; write unit = "rad", or mode = "torque"',
        ),
        ('mode = "position"', 'mode = "torque"', r'"rad", but driver = "mit" as it is set here takes .* mode = "pos'),
        ('stiffness = "2 N*m/rad" ', 'stiffness = "2 N*m" ', r"\[actuator\] stiffness"),
        ('greatest_torque = "0.44 N*m" ', 'greatest_torque = "0 N*m" ', r"greatest_torque.*greater than 0"),
    ],
)
def test_a_wrong_servo_is_told_in_a_sentence(written, instead, sentence):
    text = RIG.read_text().replace(written, instead, 1)
    assert text != RIG.read_text()
    with pytest.raises(RigError, match=sentence):
        parse_rig(text, place="servo.toml")
