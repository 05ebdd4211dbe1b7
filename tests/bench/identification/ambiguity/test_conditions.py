"""The three conditions, from evidence for and against each of them."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.conditions import Evidence, ZeroRange, conditions, evidence_of
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.results import SourceMap, Trace
from norton_bench.identification.signals import signals
from norton_bench.identification.source_map import Settling
from norton_bench.identification.validation import validate
from norton_bench.identification.without_model import without_model
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S

COMMAND, VELOCITY = np.array([-0.08, 0.0, 0.08]), np.array([-40.0, -16.0, -4.0, 4.0, 16.0, 40.0])
VISCOUS = 0.9 * COMMAND[:, None] - 1e-3 * VELOCITY - 0.02 * np.sign(VELOCITY)
SETTLED = Settling(22, 0.4, 0.05, (0.047, 0.053), 0.01, (0.005, 0.02))
NO_GAP = ZeroRange(1e-5, (0.0, 1e-4), 2e-4, 12)


def table(torque_nm=VISCOUS, std_nm=1e-4):
    shape = torque_nm.shape
    return ImpedanceTable(COMMAND, VELOCITY, torque_nm, np.full(shape, std_nm), np.full(shape, 0.3))


def trace(left_over):
    rng, count = np.random.default_rng(3), 8000
    torque = rng.normal(size=count)
    return Trace(np.arange(count) * 1e-3, torque, torque + left_over * rng.normal(size=count), "N*m")


def source(apart_rad_s):
    """Two branches, so far apart at every command."""
    levels = np.concatenate([np.linspace(-0.08, 0.08, 9), np.linspace(0.08, -0.08, 9)])
    rising = np.arange(18) < 9
    velocity = 600 * levels + np.where(rising, apart_rad_s, 0.0)
    drawn = velocity + np.random.default_rng(4).normal(0, 0.1, (200, 18))
    return SourceMap(levels, velocity, np.full(18, 0.1), rising, drawn)


ALL = Evidence((trace(0.03),), table(), source(0.0), NO_GAP, SETTLED)


def verdicts(**other):
    return [judged.holds for judged in conditions(replace(ALL, **other))]


def test_what_was_seen_to_hold_holds_with_its_figure_inside_its_interval():
    judged = conditions(ALL)
    assert [each.condition for each in judged] == ["impedance form", "unique zero", "stable zero dynamics"]
    for each in judged:
        assert each.holds
        assert each.interval[0] <= each.value <= each.interval[1]
    assert judged[0].value == pytest.approx(0.03, rel=0.1)
    assert judged[1].value == pytest.approx(1e-3, rel=0.01)


def test_what_was_not_measured_cannot_be_told():
    assert [judged.holds for judged in conditions(Evidence())] == [None, None, None]
    assert all("cannot be told" in str(judged) for judged in conditions(Evidence()))


@pytest.mark.parametrize(("left_over", "holds"), [(0.05, True), (0.35, None), (0.9, False)])
def test_the_impedance_form_is_as_usable_as_it_predicts(left_over, holds):
    assert verdicts(unseen=(trace(left_over),))[0] is holds


def test_the_better_prediction_counts():
    assert verdicts(unseen=(trace(0.9), trace(0.05)))[0] is True


def test_backlash_is_an_interval_of_zeros_with_its_width():
    judged = conditions(replace(ALL, gap=ZeroRange(8e-3, (7.5e-3, 8.5e-3), 2e-4, 12)))[1]
    assert judged.holds is False
    assert (judged.value, judged.unit) == (8e-3, "rad")
    assert "backlash" in str(judged)


def test_friction_that_falls_with_velocity_may_vanish_twice():
    falling = VISCOUS + 0.02 * np.sign(VELOCITY) * (np.abs(VELOCITY) > 10)
    assert verdicts(table=table(falling))[1] is False


def test_a_table_lost_in_scatter_tells_nothing():
    assert verdicts(table=table(std_nm=0.02))[1] is None


def test_two_branches_of_the_source_are_two_zeros():
    assert verdicts(source=source(20.0))[1] is False
    assert verdicts(source=source(20.0), table=None)[1] is False


def test_the_free_motion_alone_tells_of_one_velocity_a_command():
    assert verdicts(table=None, gap=None)[1] is True


@pytest.mark.parametrize(("left", "holds"), [(0.02, True), (0.2, None), (0.8, False)])
def test_the_zero_dynamics_are_as_stable_as_they_settle(left, holds):
    assert verdicts(settling=replace(SETTLED, left=left, left_interval=(0.8 * left, 1.2 * left)))[2] is holds


@pytest.mark.long
def test_an_experiment_as_it_is_fitted(experiment, result):
    unseen = synthetic.validation(9)
    stretches = signals(experiment, TICK_S, Use.IDENTIFY)
    modelless = without_model(result, stretches, signals(unseen, TICK_S, Use.VALIDATE), experiment.segments)
    checked = validate(result, unseen, tick_s=TICK_S)
    evidence = evidence_of(result, stretches, experiment, validation=checked, modelless=modelless, source=None)
    form, zero, _ = conditions(evidence)
    assert form.holds
    assert form.value < 0.1
    assert zero.holds is not False
