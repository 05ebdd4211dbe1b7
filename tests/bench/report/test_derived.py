"""Figures that follow from the network, and their intervals."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.models.parameters import Status
from norton_bench.report.facts_tables import derived_facts
from norton_bench.result import Result
from tests.bench.report.test_words import read_back

DRAWS, SEED = 200_000, 5


def ends(interval: str) -> tuple[float, float]:
    """The two numbers of an interval as it is written."""
    inner, _, power = interval.partition(")")
    low, high = (read_back(text.strip("( ") + power) for text in inner.split("…"))
    return low, high


def test_values_and_intervals_follow_from_parameters_and_covariance(full: Result) -> None:
    """Against draws of the parameters: correlated ones, so that leaving the covariance out would show."""
    assert full.fit is not None
    names = tuple(each.name for each in full.fit.estimates if each.status is Status.VALID)
    values = np.array([each.value for each in full.fit.estimates if each.status is Status.VALID])
    correlation = 0.8 * np.ones((len(names), len(names))) + 0.2 * np.eye(len(names))
    std = 0.004 * values
    covariance = correlation * np.outer(std, std)
    network = replace(
        full.fit.network, covariance_names=names, covariance=tuple(tuple(map(float, row)) for row in covariance)
    )
    facts = derived_facts(replace(full.fit, network=network))
    assert facts is not None
    drawn = dict(zip(names, np.random.default_rng(SEED).multivariate_normal(values, covariance, DRAWS).T, strict=True))
    expected = {
        "breakaway command": drawn["coulomb_torque"] / drawn["torque_gain"],
        "free speed per command": drawn["torque_gain"] / drawn["viscous_damping"],
        "mechanical time constant": drawn["inertia"] / drawn["viscous_damping"],
        "presliding displacement": drawn["coulomb_torque"] / drawn["presliding_stiffness"],
    }
    assert [row[0] for row in facts.rows] == list(expected)
    for name, value, interval, _unit, _use in facts.rows:
        low, high = np.quantile(expected[name], (0.025, 0.975))
        # A quantile of so many draws strays by half a per cent of the width; the ends are written to two digits.
        assert ends(interval) == pytest.approx((low, high), abs=0.06 * (high - low))
        assert low < read_back(value) < high


def test_a_figure_whose_parameter_is_not_known_is_left_out(full: Result) -> None:
    assert full.fit is not None
    lost = tuple(
        replace(each, status=Status.AT_BOUND) if each.name == "viscous_damping" else each for each in full.fit.estimates
    )
    facts = derived_facts(replace(full.fit, estimates=lost))
    assert facts is not None
    assert [row[0] for row in facts.rows] == ["breakaway command", "presliding displacement"]
    nothing = tuple(replace(each, status=Status.DOUBTFUL) for each in full.fit.estimates)
    assert derived_facts(replace(full.fit, estimates=nothing)) is None


def test_without_a_covariance_there_is_no_interval(full: Result) -> None:
    assert full.fit is not None
    facts = derived_facts(full.fit)
    assert facts is not None
    assert {row[2] for row in facts.rows} == {"–"}
