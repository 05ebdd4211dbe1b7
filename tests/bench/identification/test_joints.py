"""A motor behind a joint, from the recording: what asks for the joint, what is found, and the slopes of the fit."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification import joint_fit
from norton_bench.identification.departures import BACKLASH, CHANGE, COMPLIANCE, STRIBECK, Departure
from norton_bench.identification.joint_fit import box
from norton_bench.identification.judged_fit import JudgedFit, asked_for, objection
from norton_bench.identification.model_error import expanded, model_error
from norton_bench.identification.sanity_checks import FailedCheck
from norton_bench.identification.shape import GAIN
from norton_bench.identification.signals import signals
from norton_bench.models.parameters import Status
from norton_bench.models.terms import JOINT_STIFFNESS, NetworkTerm
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.few_draws import judged_with_few_draws
from tests.bench.identification.synthetic import TICK_S, Departs

pytestmark = pytest.mark.long

# Deviations that chance passes once in 400 runs of ten numbers.
FAR = 3.7
BENCH = synthetic.Bench(departs=Departs(joint_stiffness=10.0, joint_damping=4e-3, output_inertia=1e-5))


@pytest.fixture(scope="module")
def told():
    return judged_with_few_draws(synthetic.varied(5, BENCH))


def test_a_joint_is_asked_for_by_the_residual_and_leaves_noise(told):
    assert [each.name for each in told.result.network.relative_terms] == ["compliance"]
    assert "a spring gives between motor and port" in told.result.verdict[0]
    assert told.error.departures == ()
    assert not told.error.unexplained


def test_motor_and_joint_are_found_from_nothing(told):
    """The torque sensor of that bench is a spring too, of 200 N m/rad beyond the encoder: it is not mixed up."""
    true = {one: getattr(synthetic.Truth(), one) for one in synthetic.NAMES}
    true |= {"joint_stiffness": 10.0, "joint_damping": 4e-3, "output_inertia": 1e-5}
    for name, value in true.items():
        estimate = told.result.estimate(name)
        assert estimate.status is Status.VALID, name
        assert abs(estimate.value - value) < FAR * estimate.std, (name, estimate, value)
    assert told.result.estimate("joint_stiffness").value == pytest.approx(10.0, rel=0.02)
    assert told.result.network.covariance_names[7:] == ("joint_stiffness", "joint_damping", "output_inertia")


def test_no_joint_is_searched_for_that_rings_faster_than_readings_tell(told):
    regression, shape = told.fitted.ground.solution.regression, told.fitted.ground.solution.shape
    _, greatest = box(regression, shape)
    stiffest = shape.at(greatest)
    assert np.sqrt(stiffest.row[JOINT_STIFFNESS]) == pytest.approx(np.pi / TICK_S)


def test_a_search_that_comes_to_no_end_on_the_whole_record_is_given_up(told, monkeypatch):
    """It costs seconds a step there, and finer steps need many more of them."""
    searched = []
    monkeypatch.setattr(joint_fit, "_descend", lambda at, **_: (at, False))
    monkeypatch.setattr(joint_fit, "_with_cogging", searched.append)
    near = told.fitted.ground.solution
    assert not joint_fit.solve_behind(near, near.shape.terms, zero_nm=0.0).converged
    assert not searched


def test_the_torque_is_the_sum_of_its_slopes(told):
    """Euler's theorem, by which the gain's slope is had from the others: against a central difference."""
    regression, shape = told.fitted.ground.solution.regression, told.fitted.ground.solution.shape
    columns, _ = regression.columns(shape)
    step = np.zeros(regression.nominal.size)
    step[GAIN] = 1e-3 * regression.nominal[GAIN]
    above, below = (regression.prediction(regression.model(shape, regression.nominal + s * step)) for s in (1, -1))
    expected = (above - below) / (2 * step[GAIN])
    assert np.std(columns[GAIN] - expected) < 0.02 * np.std(expected)


def test_slopes_with_the_joint_are_those_of_the_prediction(told):
    regression, shape = told.fitted.ground.solution.regression, told.fitted.ground.solution.shape
    slopes = regression.jacobian(shape, regression.columns(shape)[0], regression.nominal)
    for unknown, own in enumerate(0.3 * regression.steps(shape)):
        step = np.zeros(slopes.shape[0])
        step[unknown] = own
        above, below = (regression.prediction(regression.model(shape.at(shape.as_array() + s * step))) for s in (1, -1))
        expected = (above - below) / (2 * own)
        assert np.std(slopes[unknown] - expected) < 0.05 * np.std(expected)


@pytest.fixture
def error(result, experiment):
    stretches = signals(experiment, TICK_S, Use.IDENTIFY)
    return model_error(result, expanded(result, stretches, ()), (), experiment)


def departed(kind):
    return Departure(kind, 5e-4, 0.5, 6e-4, 1e-9, np.zeros(7))


def asked(fitted, error, kind):
    return asked_for(replace(error, departures=(departed(kind),)), fitted)


def test_only_a_joint_may_be_why_a_rigid_motor_looks_as_if_it_changed(result, error):
    doubtful = tuple(replace(each, status=Status.DOUBTFUL) for each in result.estimates)
    result = replace(result, estimates=doubtful)
    changed = replace(result, failed_checks=(FailedCheck("The inertia is not the same throughout.", midway=True),))
    assert asked(changed, error, COMPLIANCE).name == "compliance"
    assert asked(changed, error, STRIBECK) is None
    wrong = replace(result, failed_checks=(FailedCheck("The inertia comes out negative."),))
    assert asked(wrong, error, COMPLIANCE) is None


@pytest.mark.parametrize("kind", [BACKLASH, CHANGE])
def test_of_play_or_a_change_a_spring_is_tried_which_must_leave_nothing_but_noise(result, error, kind):
    """Behind play the torque of a spring is still off; beside a spring nothing is tried for play."""
    term = asked(result, error, kind)
    assert term.name == "compliance"
    joint = NetworkTerm("compliance", (10.0, 4e-3, 1e-5))
    sprung = replace(result, network=replace(result.network, terms=(joint,)))
    assert asked(sprung, error, kind) is None
    known = [replace(result.estimates[0], name=each) for each in joint.named()]
    better = replace(sprung, torque_rms_nm=0.5 * result.torque_rms_nm, estimates=(*result.estimates, *known))
    before = JudgedFit(result, result, (), (), None, replace(error, departures=(departed(kind),)))
    clean_error = replace(error, departures=(), unexplained=False)
    for left, kept in ((clean_error, True), (replace(clean_error, unexplained=True), False), (before.error, False)):
        assert (objection(JudgedFit(better, better, (), (), None, left), before, term) == "") is kept
