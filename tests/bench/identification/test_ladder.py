"""The ladder: what it selects, and that it judges on what it has not seen."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.errors import ExperimentError
from norton_bench.identification.friction_fit import WORTH_A_STEP
from norton_bench.identification.friction_laws import CONTAINS, family_for, model
from norton_bench.identification.ladder import Rung, blocked_folds, chosen_of, ladder, selected
from tests.bench.identification.friction.paths import equation_of, wandering

NOISE = 2e-3
QUICK = ("coulomb-viscous", "coulomb-viscous-asymmetric", "stribeck", "dahl", "elasto-plastic", "lugre", "maxwell-slip")


def rungs_of(name, coefficients, shape=(), seed=1):
    path = wandering(seed, seconds=6.0)
    return ladder(equation_of(model(name), coefficients, shape, path, NOISE, seed), list(map(model, QUICK)))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("truth", "coefficients", "shape", "wanted"),
    [
        ("coulomb-viscous", [1e-3, 0.02], [], {"coulomb-viscous"}),
        ("coulomb-viscous-asymmetric", [0.025, 1e-3, 2e-3], [], {"coulomb-viscous-asymmetric"}),
        ("stribeck", [1e-3, 0.02, 0.02], [3.0], {"stribeck"}),
        ("dahl", [1e-3, 0.02, 0.0], [0.1], {"dahl"}),
        ("elasto-plastic", [1e-3, 0.02, 0.0], [0.1, 0.6], {"elasto-plastic"}),
        ("lugre", [1e-3, 0.02, 0.0], [0.1, 4.0, 1.0], {"lugre"}),
    ],
)
def test_the_truth_is_selected(truth, coefficients, shape, wanted, seed):
    rungs = rungs_of(truth, coefficients, shape, seed)
    best = selected(rungs)
    assert best.name in wanted
    # What is left on data not seen is the noise, to within its scatter (0.9 %) and the few numbers learnt.
    assert best.held_out_rms == pytest.approx(NOISE, rel=0.03)
    assert sum(rung.selected for rung in rungs) == 1
    left = {rung.name: rung.train_rms for rung in rungs}
    nested = [(outer, inner) for outer in left for inner in CONTAINS.get(outer, ()) if inner in left]
    assert len(nested) == 5
    # The search is content with the last of this share of the cost.
    assert all(left[outer] <= left[inner] * (1 + WORTH_A_STEP) for outer, inner in nested)


def test_held_out_rows_are_not_learnt_from():
    """Errors of the held-out fold are those of a fit that never had it."""
    equation = equation_of(model("dahl"), [1e-3, 0.02, 0.0], [0.1], wandering(), NOISE)
    first = equation.fold == 0
    spoilt = replace(equation, target=np.where(first, equation.target + 1.0, equation.target))
    clean, (rung,) = ladder(equation, [model("dahl")])[0], ladder(spoilt, [model("dahl")])
    # Fold 0 is off by what was added and nothing else: the others taught the right thing.
    assert rung.fold_mean_squares[0] == pytest.approx(1.0 + clean.fold_mean_squares[0], rel=0.01)


def test_overfitting_shows_on_held_out_rows_alone():
    """Twelve columns of noise lower the training error, and not the other."""
    equation = equation_of(model("coulomb-viscous"), [1e-3, 0.02], [], wandering(0, seconds=0.3), NOISE)
    columns = np.random.default_rng(5).standard_normal((40, equation.target.size))
    more = replace(
        equation,
        others=np.concatenate([equation.others, columns]),
        names=(*equation.names, *(f"noise_{k}" for k in range(40))),
    )
    (plain,), (fooled,) = (ladder(each, [model("coulomb-viscous")]) for each in (equation, more))
    assert fooled.train_rms < plain.train_rms
    assert fooled.held_out_rms > plain.held_out_rms


def test_folds_do_not_fall_in_step_with_a_repeated_motion():
    """Whatever the motion's period, every fold meets most of its phases."""
    fold = blocked_folds(6000)
    counts = np.bincount(fold)
    assert counts.max() - counts.min() <= 6
    for repeats in range(2, 13):
        phase = np.arange(6000) * repeats % 6000 * 5 // 6000
        assert all(len(set(phase[fold == k])) >= 3 for k in range(5)), repeats


def test_rows_outside_are_left_out():
    equation = equation_of(model("coulomb-viscous"), [1e-3, 0.02], [], wandering(), NOISE)
    rows = np.arange(equation.target.size) < 6000
    (before,) = ladder(equation, [model("coulomb-viscous")], rows)
    equation.target[~rows] = 50.0
    (after,) = ladder(equation, [model("coulomb-viscous")], rows)
    assert after.held_out_rms == before.held_out_rms
    assert after.train_rms == before.train_rms


def test_one_fold_is_not_enough():
    equation = equation_of(model("coulomb-viscous"), [1e-3, 0.02], [], wandering(), NOISE)
    with pytest.raises(ExperimentError, match="two parts"):
        ladder(replace(equation, fold=np.zeros(equation.target.size, dtype=np.int64)), family_for(equation.path))


def judged(name: str, held_out: float, *, edge: bool) -> Rung:
    """A rung whose folds all err by the same."""
    shape = ("presliding_displacement",) if edge else ()
    fit = replace(FITTED, model=model(name), at_bound=shape)
    return Rung(model(name), fit, held_out, held_out, 0.0, 1.0, (held_out**2,) * 4)


FITTED = ladder(equation_of(model("dahl"), [1e-3, 0.02, 0.0], [0.1], wandering(), NOISE), [model("dahl")])[0].fit


@pytest.mark.parametrize(("inside", "wanted"), [(1.3, "coulomb-viscous"), (1.5, "dahl")])
def test_a_law_at_its_edge_is_chosen_where_no_other_is_nearly_as_good(inside, wanted):
    rungs = [judged("coulomb-viscous", inside, edge=False), judged("dahl", 1.0, edge=True)]
    assert chosen_of(rungs).name == wanted
