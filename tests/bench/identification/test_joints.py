"""A motor behind a joint, from the recording: what is told apart, what asks for the joint, and the slopes of its fit."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.cleaning import clean
from norton_bench.identification.departures import BACKLASH, COMPLIANCE, STRIBECK, Departure
from norton_bench.identification.joint_fit import solve_behind
from norton_bench.identification.judged_fit import asked_for, fit_judged
from norton_bench.identification.model_error import expanded, model_error
from norton_bench.identification.sanity_checks import FailedCheck
from norton_bench.identification.separable import solve
from norton_bench.identification.shape import GAIN, INERTIA
from norton_bench.identification.signals import signals
from norton_bench.models.parameters import Status
from norton_bench.models.terms import NetworkTerm, joint_values
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Departs

BENCH = synthetic.Bench(departs=Departs(joint_stiffness=10.0, joint_damping=4e-3, output_inertia=1e-5))


@pytest.fixture(scope="module")
def measured():
    return synthetic.experiment(seed=5, bench=BENCH)


@pytest.fixture(scope="module")
def solution(measured):
    stretches = signals(clean(measured).measured, TICK_S, Use.IDENTIFY)
    return solve_behind(solve(stretches), (NetworkTerm("compliance", (1.0, 1.0, 1.0)),), 0.0)


def test_the_joint_is_found_from_nothing_and_not_taken_for_the_sensors_spring(solution):
    """The sensor of that bench is a spring too, of 200 N m/rad, beyond the encoder; its stiffness is not this one."""
    assert solution.converged
    stiffness, damping, output, half = joint_values(solution.shape.row, float(solution.linear[INERTIA]))
    assert stiffness == pytest.approx(10.0, rel=0.02)
    assert damping == pytest.approx(4e-3, rel=0.05)
    assert output == pytest.approx(1e-5, rel=0.1)
    assert half == 0.0


def test_the_torque_is_the_sum_of_its_slopes(solution):
    """Euler's theorem, by which the gain's slope is had from the others: against a central difference."""
    regression, shape = solution.regression, solution.shape
    columns, _ = regression.columns(shape)
    step = np.zeros(regression.nominal.size)
    step[GAIN] = 1e-3 * regression.nominal[GAIN]
    above, below = (regression.prediction(regression.model(shape, regression.nominal + s * step)) for s in (1, -1))
    expected = (above - below) / (2 * step[GAIN])
    assert np.std(columns[GAIN] - expected) < 0.02 * np.std(expected)


def test_a_joint_is_asked_for_by_the_residual_and_leaves_noise(measured):
    told = fit_judged(clean(measured), command_unit="N*m", tick_s=TICK_S)
    assert [each.name for each in told.result.network.relative_terms] == ["compliance"]
    assert {each.status for each in told.result.estimates} == {Status.VALID}
    assert "a spring gives between motor and port" in told.result.verdict[0]
    assert told.error.departures == ()
    assert not told.error.unexplained


@pytest.fixture
def error(result, experiment):
    stretches = signals(experiment, TICK_S, Use.IDENTIFY)
    return model_error(result, expanded(result, stretches, ()), stretches, (), experiment)


def asked(fitted, error, kind):
    return asked_for(replace(error, departures=(Departure(kind, 5e-4, 0.5, 6e-4, 1e-9, np.zeros(7)),)), fitted)


def test_only_a_joint_may_be_why_a_rigid_motor_looks_as_if_it_changed(result, error):
    changed = replace(result, failed_checks=(FailedCheck("The inertia is not the same throughout.", midway=True),))
    assert asked(changed, error, COMPLIANCE).name == "compliance"
    assert asked(changed, error, STRIBECK) is None
    wrong = replace(result, failed_checks=(FailedCheck("The inertia comes out negative."),))
    assert asked(wrong, error, COMPLIANCE) is None


def test_play_is_named_and_not_fitted(result, error):
    assert asked(result, error, BACKLASH) is None
