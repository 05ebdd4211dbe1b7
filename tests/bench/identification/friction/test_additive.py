"""Cogging, drift and temperature: found where they are, beside the friction."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification import friction_operators as operators
from norton_bench.identification.friction_laws import model
from norton_bench.identification.ladder import fit_friction
from tests.bench.identification.friction.paths import equation_of, path_of, wandering

NOISE = 1e-3
COULOMB = model("coulomb-viscous")


def coulomb_equation(path=None):
    return equation_of(COULOMB, [1e-3, 0.02], [], path or wandering(), NOISE)


def fit_with(equation, columns):
    """The fit with further columns; they replace the offset where they hold one."""
    kept = [
        k for k, name in enumerate(equation.names) if name != "offset" or not any("offset" in new for new in columns)
    ]
    names = (*(equation.names[k] for k in kept), *columns)
    others = np.concatenate([equation.others[kept], np.stack(list(columns.values()))])
    return fit_friction(replace(equation, names=names, others=others), COULOMB)


@pytest.mark.parametrize("period", [0.5, 2 * np.pi / 7])
def test_cogging_is_found_beside_the_friction(period):
    equation = coulomb_equation()
    phase = 2 * np.pi * equation.path.position / period
    equation.target[:] -= 4e-3 * np.cos(phase) + 1e-3 * np.sin(phase)
    fit = fit_with(equation, operators.cogging(equation.path.position, period))
    assert fit.value("cogging_cosine") == pytest.approx(4e-3, abs=2e-4)
    assert fit.value("cogging_sine") == pytest.approx(1e-3, abs=2e-4)
    assert fit.rms == pytest.approx(NOISE, rel=0.03)


def test_drift_is_followed():
    equation = coulomb_equation()
    equation.target[:] += 0.01 * np.sin(2 * np.pi * equation.time_s / 12.0)
    knots = round(float(np.ptp(equation.time_s))) + 1
    hats = {f"offset_{knot}": -hat for knot, hat in enumerate(operators.linear_basis(equation.time_s, knots))}
    fit = fit_with(equation, hats)
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    assert fit.value("coulomb_torque") == pytest.approx(0.02, rel=0.01)


def test_hats_draw_any_broken_line_with_these_knots():
    time_s = np.random.default_rng(1).uniform(5.0, 25.0, 300)
    time_s[:2] = 5.0, 25.0
    heights = np.array([1.0, -2.0, 0.5, 4.0, 0.0])
    expected = np.interp(time_s, [5.0, 10.0, 15.0, 20.0, 25.0], heights)
    np.testing.assert_allclose(heights @ operators.linear_basis(time_s, 5), expected, atol=1e-12)


def test_temperature_thins_the_oil():
    path = wandering()
    warm = 20.0 + 30.0 * np.linspace(0, 1, path.position.size)
    equation = coulomb_equation(path_of(path.position))
    about = warm - np.mean(warm)
    equation.target[:] += 1e-5 * about * path.velocity - 2e-5 * about * np.sign(path.velocity)
    fit = fit_with(equation, operators.temperature(path.velocity, warm))
    assert fit.value("viscous_damping_per_degree") == pytest.approx(-1e-5, rel=0.05)
    assert fit.value("coulomb_torque_per_degree") == pytest.approx(2e-5, rel=0.1)
    assert fit.value("viscous_damping") == pytest.approx(1e-3, rel=0.02)
