"""The ladder on the bench's own recordings, made by a bench that shares nothing with the models."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.friction_fit import WORTH_A_STEP
from norton_bench.identification.friction_laws import CONTAINS, model
from norton_bench.identification.ladder import bench_equation, bench_ladder, fit_friction, ladder, selected
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Truth

NAMES = ("coulomb-viscous", "stribeck", "dahl", "elasto-plastic", "lugre", "maxwell-slip")


@pytest.fixture(scope="module")
def equation(experiment, result):
    return bench_equation(signals(experiment, TICK_S, Use.IDENTIFY), result)


@pytest.fixture(scope="module")
def rungs(experiment, result):
    return bench_ladder(signals(experiment, TICK_S, Use.IDENTIFY), result)


@pytest.mark.long
def test_dahl_is_recognised(rungs):
    best = selected(rungs)
    assert best.name == "dahl"
    static = next(rung for rung in rungs if rung.name == "coulomb-viscous")
    assert best.held_out_rms < 0.2 * static.held_out_rms
    # The sensor's noise, 1 mN·m, passes the low band by its share of the width; cogging and counts add to it.
    assert best.held_out_rms < 1e-3


def test_no_model_fits_worse_than_one_that_it_contains(rungs):
    """On all rows; the search is content with the last of WORTH_A_STEP of the cost."""
    left = {rung.name: rung.train_rms for rung in rungs}
    pairs = [(outer, inner) for outer in left for inner in CONTAINS.get(outer, ()) if inner in left]
    assert ("lugre", "dahl") in pairs
    for outer, inner in pairs:
        assert left[outer] <= left[inner] * (1 + WORTH_A_STEP), (outer, inner)


def test_values_beside_the_friction_are_true(equation):
    fit = fit_friction(equation, model("dahl"))
    truth = Truth()
    assert fit.converged
    assert fit.value("torque_gain") == pytest.approx(truth.torque_gain, rel=0.005)
    assert fit.value("inertia") == pytest.approx(truth.inertia, rel=0.01)
    assert fit.value("coulomb_torque") == pytest.approx(truth.coulomb_torque, rel=0.01)
    deflection = truth.coulomb_torque / truth.presliding_stiffness
    assert fit.value("presliding_displacement") == pytest.approx(deflection, rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "coefficients", "shape"), [("coulomb-viscous", [1e-3, 0.02], []), ("stribeck", [1e-3, 0.02, 0.01], [2.0])]
)
def test_friction_without_memory_is_not_taken_for_dahls(equation, name, coefficients, shape):
    """The bench's own motion, under a friction that forgets."""
    path, rng = equation.path, np.random.default_rng(3)
    friction = np.array(coefficients) @ model(name).columns(path, np.array(shape))
    noise = 1e-3 * rng.standard_normal(path.position.size)
    target = equation.process((noise - friction)[None, :])[0] + np.array([0.9, 5e-5]) @ equation.others[:2]
    rungs = ladder(replace(equation, target=target), list(map(model, NAMES)))
    assert selected(rungs).name == name


def test_nothing_without_torque(without_torque, result):
    assert bench_ladder(signals(without_torque, TICK_S, Use.IDENTIFY), result) == ()
