"""A servo from rig file to network: a short session on the simulated bench, through its frames, and its fit."""

from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.identification.fit import fit
from norton_bench.models.parameters import Status
from norton_bench.procedures.options import CalibrateOptions, ImposedOptions, TareOptions
from norton_bench.rig.load import load_rig, parse_rig, true_parameters
from norton_bench.session.dry_run import dry_run
from norton_bench.session.engine import record_session
from norton_bench.session.items import Session, Step
from norton_bench.session.schema import standard_session

RIG = Path(__file__).parents[3] / "rigs" / "sim-servo.toml"
STEPS = (
    Step("tare", TareOptions(duration_s=0.5)),
    Step("calibrate", CalibrateOptions(duration_s=4.0)),
    Step("imposed", ImposedOptions(duration_s=4.0)),
)
# Cogging of 0.3 mN m is simulated. A short session does not travel its period: it is a stiffness of up to 42 times that.
COGGING_STIFFNESS_NM_RAD = 42 * 0.3e-3


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    rig = load_rig(RIG)
    recorded = record_session(rig, Session(STEPS, "a short one"), out=tmp_path_factory.mktemp("servo"), seed=51)
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


@pytest.mark.parametrize(
    ("written", "instead", "sentence"),
    [
        ('unit = "rad", limit = "1 rad"', 'unit = "N*m", limit = "1 N*m"', r'takes commands in "rad"; write unit = "rad", or mode = "torque"'),
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
