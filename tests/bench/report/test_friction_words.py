"""Why a friction model with more numbers may fit worse: what the report says is true of the models."""

from dataclasses import dataclass

import numpy as np
import pytest

from norton_bench.identification.friction_fit import fit_friction
from norton_bench.identification.friction_laws import CONTAINS, FAMILY, FILMS, model
from norton_bench.identification.friction_model import Equation, Path, blocked_folds
from norton_bench.report.sections_checks import ASSUMES, worse_though_richer

DT_S, DEFLECTION_RAD, COULOMB_NM = 1e-3, 2e-3, 0.02
# Of a fit by Gauss-Newton to data that the model makes exactly.
EXACT = 1e-3


@dataclass(frozen=True)
class Line:
    """A model of the comparison."""

    name: str
    unknowns: int
    train_relative: float


def moved() -> Path:
    """Small loops and sliding, both ways."""
    t = np.arange(4000) * DT_S
    velocity = 0.02 * np.sin(2 * np.pi * 3 * t) + 2.0 * np.sin(2 * np.pi * 0.5 * t) * (t > 2)
    return Path(DT_S, np.cumsum(velocity) * DT_S, velocity, np.array([0]))


def made_by_dahl(path: Path) -> Equation:
    """Torque of a Dahl contact with viscous friction, without noise."""
    share = model("dahl").columns(path, np.array([DEFLECTION_RAD]))
    target = -np.array([1e-3, COULOMB_NM, 0.01 * DEFLECTION_RAD]) @ share
    count = path.position.size
    return Equation(
        target=target,
        others=np.ones((1, count)),
        names=("offset",),
        path=path,
        fold=blocked_folds(count),
        time_s=np.arange(count) * DT_S,
        process=lambda rows: rows,
    )


@pytest.mark.parametrize("name", ["elasto-plastic", "maxwell-slip", "stribeck-asymmetric"])
def test_models_said_to_be_other_laws_cannot_become_dahl(name: str) -> None:
    """Each is fitted with all its freedom to data of Dahl's law: what is left is the law, not noise or the search."""
    equation = made_by_dahl(moved())
    scale = float(np.sqrt(np.mean(equation.target**2)))
    dahl = fit_friction(equation, model("dahl"))
    other = fit_friction(equation, model(name))
    assert dahl.rms < EXACT * scale
    assert other.rms > 10 * EXACT * scale
    assert "dahl" not in CONTAINS.get(name, ())


def test_lugre_can_become_dahl() -> None:
    equation = made_by_dahl(moved())
    assert fit_friction(equation, model("lugre")).rms < EXACT * float(np.sqrt(np.mean(equation.target**2)))
    assert CONTAINS["lugre"] == ("dahl",)


@pytest.mark.parametrize(("name", "inner"), [("stribeck", "coulomb-viscous"), ("maxwell-slip", "stribeck")])
def test_models_said_to_contain_another_fit_its_data(name: str, inner: str) -> None:
    path = moved()
    columns = model(inner).columns(path, np.array([0.5] * len(model(inner).unknowns)))
    equation = made_by_dahl(path)
    exact = Equation(
        -np.full(len(columns), 0.01) @ columns,
        equation.others,
        equation.names,
        path,
        equation.fold,
        equation.time_s,
        equation.process,
    )
    scale = float(np.sqrt(np.mean(exact.target**2)))
    assert fit_friction(exact, model(name)).rms < 0.02 * scale
    assert inner in CONTAINS[name]


def test_every_model_of_the_family_is_known_here() -> None:
    names = {member.name for member in (*FAMILY, *FILMS)}
    assert set(CONTAINS) <= names
    assert {inner for inners in CONTAINS.values() for inner in inners} <= names
    assert set(ASSUMES) <= names


def test_richer_models_that_fit_worse_are_explained() -> None:
    best = Line("dahl", 4, 0.009)
    models = [best, Line("coulomb-viscous", 2, 0.14), Line("lugre", 6, 0.009), Line("maxwell-slip", 17, 0.034)]
    (another,), laws = worse_though_richer(best, models)
    assert "maxwell-slip is another friction law, not an extension of dahl" in another
    assert laws == ("maxwell-slip is a sum of elements that each yield all at once, without damping before sliding.",)


def test_every_richer_model_that_shows_a_greater_error_is_named() -> None:
    best = Line("dahl", 4, 0.00871)
    models = [best, Line("lugre", 6, 0.00880), Line("maxwell-slip", 17, 0.034)]
    (others, extensions), laws = worse_though_richer(best, models)
    assert "maxwell-slip" in others
    assert "lugre" not in others
    assert extensions.startswith("lugre extends dahl, but comes near to it only at the edge of what is searched")
    assert len(laws) == 1


def test_nothing_is_explained_where_nothing_is_worse() -> None:
    best = Line("dahl", 4, 0.009)
    assert worse_though_richer(best, [best, Line("lugre", 6, 0.009), Line("stribeck", 4, 0.1)]) == ([], ())
