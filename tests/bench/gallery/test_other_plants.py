"""The claims about a muscle, two ports under gravity, a variable spring, and in situ; and what they are not."""

from dataclasses import replace

import pytest

from norton_bench.gallery import spring
from norton_bench.gallery.paper import CATALOGUE
from norton_bench.gallery.spring import MovingSource, VariableSpring, unknown_source
from tests.bench.gallery.experiments import SPRING, measured

pytestmark = pytest.mark.long

SEED = 5
# What the claims depend on, and the number of their rows.
PLANTS = {
    "muscle": (("spring", "output_inertia"), 10),
    "arms": (("gravity", "load_gravity"), 10),
    "spring": (("spring_stiffness", "spring_stiffening"), 8),
    "in situ": (("torque_gain",), 2),
}
# Claims that depend on a parameter, where a plant has several.
CLAIMS = {
    ("muscle", "spring"): {"nonlinear connection", "dynamic source"},
    ("muscle", "output_inertia"): {"dynamic source"},
    ("arms", "gravity"): {"two ports", "port impedances"},
    ("arms", "load_gravity"): {"two ports", "port impedances"},
}


@pytest.fixture(scope="module", params=sorted(PLANTS))
def plant(request):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spring, "EXPERIMENT", SPRING)
        yield request.param, measured(request.param, SEED)


def rows_of(name, experiment):
    return [row for claim in CATALOGUE[name].claims(experiment) for row in claim.rows]


def test_every_claim_comes_true(plant):
    name, experiment = plant
    rows = rows_of(name, experiment)
    assert len(rows) == PLANTS[name][1]
    assert [f"{row.what}: {row.found} for {row.expected}" for row in rows if not row.passed] == []


def test_another_spring_is_not_taken_for_this_one_while_the_source_moves():
    experiment = measured("spring", SEED, (MovingSource(rounds=5),))
    assert all(row.passed for row in unknown_source(VariableSpring(experiment)).rows)
    for parameter, factor in (("spring_stiffness", 1.03), ("output_inertia", 10.0)):
        other = replace(experiment, true={**experiment.true, parameter: factor * experiment.true[parameter]})
        assert not all(row.passed for row in unknown_source(VariableSpring(other)).rows)


def test_another_plant_is_not_taken_for_this_one(plant):
    name, experiment = plant
    for parameter in PLANTS[name][0]:
        other = replace(experiment, true={**experiment.true, parameter: 1.1 * experiment.true[parameter]})
        wrong = {row.claim for row in rows_of(name, other) if not row.passed}
        assert wrong >= CLAIMS.get((name, parameter), set())
        assert wrong
