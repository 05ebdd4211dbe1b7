"""The separable fit: true values from nothing, honest deviations, flags where there is no answer."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.friction_fit import WORTH_A_STEP
from norton_bench.identification.friction_laws import CONTAINS, FAMILY, family_for, model
from norton_bench.identification.friction_model import Path
from norton_bench.identification.friction_operators import bounded_solution
from norton_bench.identification.ladder import fit_friction
from tests.bench.identification.friction.paths import equation_of, path_of, wandering

NOISE = 2e-3
# Coefficients, then shape. The path runs at 30 rad/s rms and its slow turns are a few mrad wide.
TRUTHS = {
    "coulomb-viscous": ([1e-3, 0.02], []),
    "coulomb-viscous-asymmetric": ([0.02, 1e-3, 1.5e-3], []),
    "stribeck": ([1e-3, 0.02, 0.015], [3.0]),
    "stribeck-asymmetric": ([0.02, 1e-3, 0.01, 1.5e-3, 0.015], [3.0]),
    "film": ([1e-3, 0.02, 0.015], [3.0]),
    "film-asymmetric": ([0.02, 1e-3, 0.01, 1.5e-3, 0.015], [3.0]),
    "dahl": ([1e-3, 0.02, 1e-3], [0.05]),
    "elasto-plastic": ([1e-3, 0.02, 1e-3], [0.05, 0.4]),
    "lugre": ([1e-3, 0.02, 1e-3], [0.05, 4.0, 0.8]),
}


@pytest.mark.parametrize("name", TRUTHS)
@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_true_values_from_nothing(name, factor):
    coefficients, shape = (np.array(part, dtype=float) for part in TRUTHS[name])
    if shape.size:
        shape[0] *= factor
    member = model(name)
    fit = fit_friction(equation_of(member, coefficients, shape, wandering(), NOISE), member)
    truth = np.array([2e-3, 0.01, *coefficients, *shape])
    known = fit.deviations > 0
    assert fit.converged
    assert fit.rms == pytest.approx(NOISE, rel=0.02)
    # 4.5 deviations: once in ten runs of all of this by chance at 3.
    assert np.all(np.abs(fit.values - truth)[known] < 4.5 * fit.deviations[known])
    assert fit.value("inertia") == pytest.approx(2e-3, rel=0.02)


# What each model that others contain is made of, so that a search may end elsewhere: little noise makes hollows deep.
CONTAINED = {
    "coulomb-viscous": ([1e-3, 0.02], []),
    "coulomb-viscous-asymmetric": ([0.02, 1e-3, 1.5e-3], []),
    "stribeck": ([1e-3, 0.02, 0.015], [3.0]),
    "film": ([1e-3, 0.02, 0.015], [3.0]),
    "dahl": ([1e-3, 0.02, 1e-3], [0.3]),
    "elasto-plastic": ([1e-3, 0.02, 1e-3], [0.05, 0.4]),
    "maxwell-slip": ([1e-3, 0.02, 0.0, *[2e-3] * 12], [0.05, 3.0]),
}
PAIRS = [(outer, inner) for outer, inners in CONTAINS.items() for inner in inners]


@pytest.mark.parametrize(("outer", "inner"), PAIRS)
def test_no_model_fits_worse_than_one_that_it_contains(outer, inner):
    path = wandering(0, seconds=6.0)
    path = path_of(path.position, load=1.0 + 0.5 * np.sin(np.arange(path.position.size) / 300))
    equation = equation_of(model(inner), *CONTAINED[inner], path, 0.1 * NOISE)
    # The search is content with the last of this share of the cost.
    assert fit_friction(equation, model(outer)).rms <= fit_friction(equation, model(inner)).rms * (1 + WORTH_A_STEP)


def test_maxwell_slip_follows_two_contacts_side_by_side():
    member = model("maxwell-slip")
    path = wandering()
    two = sum(
        strength * model("elasto-plastic").columns(path, np.array([deflection, 0.98]))[1]
        for strength, deflection in ((0.02, 0.02), (0.01, 0.3))
    )
    equation = equation_of(model("coulomb-viscous"), [1e-3, 0.0], [], path, NOISE)
    equation.target[:] -= two
    fit = fit_friction(equation, member)
    one = fit_friction(equation, model("elasto-plastic"))
    assert fit.rms < 1.03 * NOISE < one.rms


@pytest.mark.long
def test_deviations_cover_the_scatter():
    """Over 40 draws of noise: the mean square of error over deviation is 1 ± √(2/40) for each, three times over."""
    member = model("dahl")
    coefficients, shape = TRUTHS["dahl"]
    path = wandering(3, seconds=6.0)
    fits = [fit_friction(equation_of(member, coefficients, shape, path, NOISE, seed), member) for seed in range(40)]
    truth = np.array([2e-3, 0.01, *coefficients, *shape])
    ratio = np.array([(fit.values - truth) / fit.deviations for fit in fits])
    # The deviations are the widest of several, so they may be cautious.
    assert np.all(np.mean(ratio**2, axis=0) < 1 + 3 * np.sqrt(2 / 40))
    assert np.all(np.mean(ratio**2, axis=0) > 0.2)


def test_what_is_not_there_is_flagged():
    fit = fit_friction(equation_of(model("coulomb-viscous"), [0.0, 0.02], [], wandering(), NOISE), model("dahl"))
    assert "presliding_displacement" in fit.at_bound or fit.value("presliding_displacement") < 1e-2
    assert all(value >= 0 for name, value in zip(fit.names, fit.values, strict=True) if name != "offset")


def test_rows_left_out_do_not_matter():
    member = model("dahl")
    equation = equation_of(member, *TRUTHS["dahl"], wandering(), NOISE)
    rows = np.arange(equation.target.size) < 8000
    whole = fit_friction(equation, member, rows)
    equation.target[~rows] = 1e3
    assert fit_friction(equation, member, rows).values == pytest.approx(whole.values)


def test_rows_without_weight_are_as_good_as_left_out():
    law, path = model("stribeck"), wandering()
    equation = equation_of(law, [0.01, 0.3, 0.1], [2.0], path, noise=0.01)
    spoilt = np.arange(path.position.size) % 3 == 0
    variance = np.where(spoilt, 1e12, 1.0)
    wrong = replace(equation, target=equation.target + 0.5 * spoilt, variance=variance)
    weighted, left_out = fit_friction(wrong, law), fit_friction(equation, law, ~spoilt)
    np.testing.assert_allclose(weighted.values, left_out.values, rtol=1e-6)
    assert weighted.rms == pytest.approx(left_out.rms, rel=1e-6)
    assert np.std(weighted.residual[spoilt]) == pytest.approx(0.01, rel=0.1)
    assert np.mean(weighted.residual[spoilt]) == pytest.approx(0.5, abs=0.01)


def test_restarts_are_not_motion():
    """Two stretches far apart in position: the jump between them is nobody's path."""
    a, b = wandering(1, 6.0), wandering(2, 6.0)
    size = a.position.size
    path = Path(
        a.dt_s,
        np.concatenate([a.position, b.position + 500.0]),
        np.concatenate([a.velocity, b.velocity]),
        np.array([0, size]),
    )
    member = model("dahl")
    together, alone = (member.columns(each, np.array([0.05])) for each in (path, b))
    assert together[:, size:] == pytest.approx(alone)
    assert path.displacement_scale < 50.0


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6))
def test_bounded_solution_is_scipys(seed, held):
    rng = np.random.default_rng(seed)
    columns, target = rng.standard_normal((7, 40)), rng.standard_normal(40)
    nonnegative = np.arange(7) < held
    ours = bounded_solution(columns @ columns.T, columns @ target, nonnegative)
    low = np.where(nonnegative, 0.0, -np.inf)
    theirs = lsq_linear(columns.T, target, (low, np.inf), tol=1e-12).x
    assert ours == pytest.approx(theirs, abs=1e-6)


def test_columns_that_free_ones_explain_but_for_rounding():
    """What is left of their squares is then a little less than nothing."""
    rng = np.random.default_rng(3)
    free = rng.standard_normal((4, 500))
    held = rng.standard_normal((6, 4)) @ free
    columns = np.concatenate([free, held])
    nonnegative = np.repeat([False, True], [4, 6])
    gram = columns @ columns.T
    gram[4:, 4:] *= 1.0 - 1e-8  # as if summed in single precision
    target = np.array([1.0, -2.0, 3.0, 0.5]) @ free
    solution = bounded_solution(gram, columns @ target, nonnegative)
    assert np.all(solution[4:] >= 0.0)
    assert solution @ columns == pytest.approx(target, abs=1e-3)


def test_a_silent_column_gets_nothing():
    columns = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    solution = bounded_solution(
        columns @ columns.T, columns @ np.array([1.0, 2.0, 3.0]), np.array([False, False, True])
    )
    assert solution == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert solution[1] == 0.0


def test_unknown_model_names_the_nearest():
    with pytest.raises(UsageError, match='did you mean "stribeck"'):
        model("stribek")


def test_load_dependent_only_where_the_load_is_known():
    path = wandering()
    assert "load-dependent" not in {member.name for member in family_for(path)}
    with pytest.raises(UsageError, match="load"):
        model("load-dependent").columns(path, np.empty(0))
    loaded = path_of(path.position, load=1.0 + 0.5 * np.sin(np.arange(path.position.size) / 300))
    assert len(family_for(loaded)) == len(FAMILY)
    member = model("load-dependent")
    fit = fit_friction(equation_of(member, [1e-3, 0.01, 0.02], [], loaded, NOISE), member)
    assert fit.value("load_coefficient") == pytest.approx(
        0.02, abs=4.5 * fit.deviations[fit.names.index("load_coefficient")]
    )


def test_a_shaft_at_rest_is_refused():
    still = path_of(np.ones(1000))
    equation = equation_of(model("coulomb-viscous"), [1e-3, 0.02], [], still, NOISE)
    with pytest.raises(ExperimentError, match="motion"):
        fit_friction(equation, model("dahl"))


def test_missing_numbers_are_refused():
    with pytest.raises(ExperimentError, match="missing"):
        equation_of(model("coulomb-viscous"), [np.nan, 0.02], [], wandering())


def test_too_few_rows_are_refused():
    equation = equation_of(model("dahl"), *TRUTHS["dahl"], wandering())
    with pytest.raises(ExperimentError, match="too few"):
        fit_friction(equation, model("dahl"), np.arange(equation.target.size) < 5)
