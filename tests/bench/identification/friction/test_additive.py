"""Cogging, drift and temperature: found where they are, and only there."""

import numpy as np
import pytest

from bench.errors import UsageError
from bench.identification.friction.additive import cogging_period, with_cogging, with_drift, with_temperature
from bench.identification.friction.family import model
from bench.identification.ladder import fit_friction
from tests.bench.identification.friction.paths import equation_of, path_of, wandering

NOISE = 1e-3
COULOMB = model("coulomb-viscous")


def coulomb_equation(path=None):
    return equation_of(COULOMB, [1e-3, 0.02], [], path or wandering(), NOISE)


@pytest.mark.parametrize("period", [0.5, 2 * np.pi / 7])
def test_cogging_is_found_without_knowing_its_period(period):
    equation = coulomb_equation()
    position = equation.path.position - equation.path.position[0]
    equation.target[:] += 4e-3 * np.cos(2 * np.pi * position / period) + 1e-3 * np.sin(4 * np.pi * position / period)
    found = cogging_period(equation, fit_friction(equation, COULOMB))
    reach = np.ptp(position)
    assert found == pytest.approx(period, rel=period / reach / 4)  # a quarter of a line
    fit = fit_friction(with_cogging(equation, period), COULOMB)
    assert fit.value("cogging_cosine_1") == pytest.approx(4e-3, abs=2e-4)
    assert fit.value("cogging_sine_2") == pytest.approx(1e-3, abs=2e-4)
    assert fit.rms == pytest.approx(NOISE, rel=0.03)


def test_no_cogging_is_found_where_there_is_none():
    for seed in range(5):
        equation = coulomb_equation(wandering(seed))
        assert cogging_period(equation, fit_friction(equation, COULOMB)) is None


def test_drift_is_followed():
    equation = coulomb_equation()
    slow = 0.01 * np.sin(2 * np.pi * equation.time_s / 12.0)
    equation.target[:] += slow
    fit = fit_friction(with_drift(equation, 1.0), COULOMB)
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    assert fit.value("coulomb_torque") == pytest.approx(0.02, rel=0.01)


def test_temperature_thins_the_oil():
    path = wandering()
    warming = path_of(path.position, temperature_c=20.0 + 30.0 * np.linspace(0, 1, path.position.size))
    equation = coulomb_equation(warming)
    about = warming.temperature_c - np.mean(warming.temperature_c)
    equation.target[:] += 1e-5 * about * warming.velocity
    fit = fit_friction(with_temperature(equation), COULOMB)
    assert fit.value("viscous_damping_per_degree") == pytest.approx(-1e-5, rel=0.05)
    assert fit.value("viscous_damping") == pytest.approx(1e-3, rel=0.02)


def test_temperature_must_be_known():
    with pytest.raises(UsageError, match="temperature"):
        with_temperature(coulomb_equation())
