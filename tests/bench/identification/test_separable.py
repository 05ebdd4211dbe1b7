"""The search for what is not linear."""

import numpy as np
import pytest

from norton_bench.identification.separable import LONGEST_STEP, _At, limits
from norton_bench.identification.shape import MOTION_DELAY
from tests.bench.identification.synthetic import TICK_S

OFF_S = 2e-4


def test_a_step_leads_down_also_where_more_is_taken_off_for_errors_than_there_is(
    result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of coarse counts: what they add to a slope's square is estimated, and may come out as more than all of it."""
    solution = result.simulated.bench.solution
    shape = solution.shape.as_array()
    shape[MOTION_DELAY] += OFF_S
    at = _At.of(solution.regression, solution.shape.at(shape))
    place = len(at.linear) + solution.free.index(MOTION_DELAY)
    too_much = at.contamination.copy()
    too_much[place] = 1.5 * np.sum(at.slopes[solution.free.index(MOTION_DELAY)] ** 2)
    monkeypatch.setattr(_At, "contamination", property(lambda _: too_much))
    step, squared_deviations = at.step()
    assert squared_deviations > 0.0
    assert step[MOTION_DELAY] < 0.0
    better = at.bettered(step, *limits(TICK_S), LONGEST_STEP, None)
    assert better is not None
    assert better.cost < at.cost
