"""Live values beside final ones: what moved is said and made wide enough, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.judged_fit import changes, with_what_moved
from norton_bench.models.parameters import Status

pytestmark = pytest.mark.long

NAME = "viscous_damping"


def at_the_end(result, deviations):
    """The same estimates, but one that ends so many deviations of the difference away."""
    return tuple(
        replace(each, value=each.value + deviations * np.sqrt(2) * each.std) if each.name == NAME else each
        for each in result.estimates
    )


def test_what_ends_where_it_was_is_left_alone(result):
    live = at_the_end(result, 3.1)
    assert with_what_moved(result, result, live) is result
    assert max(abs(change.deviations) for change in changes(live, result)) == pytest.approx(3.1)


def test_what_moved_is_said_and_its_interval_holds_either_end(result):
    live = at_the_end(result, -30.0)
    told = with_what_moved(result, result, live)
    assert told.verdict[0].startswith("Viscous damping moved during the session: ")
    before, after = result.estimate(NAME), told.estimate(NAME)
    ends = next(each.value for each in live if each.name == NAME)
    assert after.value == before.value
    assert abs(after.value - ends) < 1.96 * after.std
    others = [each for each in told.estimates if each.name != NAME]
    assert others == [each for each in result.estimates if each.name != NAME]
    at = told.network.covariance_names.index(NAME)
    assert np.sqrt(told.network.covariance[at][at]) == pytest.approx(after.std)


def test_what_live_values_cannot_tell_is_not_compared(result):
    untold = tuple(replace(each, status=Status.LEARNING) for each in at_the_end(result, 30.0))
    assert changes(untold, result) == ()
    assert with_what_moved(result, result, untold) is result
    assert with_what_moved(result, result, ()) is result
