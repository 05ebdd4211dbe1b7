"""The search for what is not linear."""

import numpy as np
import pytest

from norton_bench.identification.fit import solution_of
from norton_bench.identification.search_box import (
    BANDWIDTH_RAD_S,
    LEAST_LAG,
    LONGEST_STEP,
    inside,
    limits,
    stepped,
)
from norton_bench.identification.separable import _At
from norton_bench.identification.shape import BANDWIDTH, COMMAND_DELAY, GAIN, MOTION_DELAY
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Bench, Truth, experiment

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


@pytest.mark.long
def test_a_bandwidth_that_is_hardly_told_is_followed_to_the_side_of_the_box_with_its_delay() -> None:
    """In the noise of this record a lag of nothing is likelier than the true one: the search must end there, at its
    side, with the delay that then stands for all of it."""
    truth = Truth(amplifier_bandwidth=1500.0, viscous_damping=2e-3, coulomb_torque=0.05, presliding_stiffness=8.0)
    measured = experiment(seed=3, truth=truth, bench=Bench(noise_nm=2.8e-3, cogging_nm=0.0, stiffness=900.0))
    solution = solution_of(signals(measured, TICK_S, Use.IDENTIFY))
    assert solution.converged
    assert solution.shape.bandwidth_rad_s == pytest.approx(BANDWIDTH_RAD_S[1])
    assert solution.linear[GAIN] == pytest.approx(truth.torque_gain, rel=0.01)


def test_a_step_goes_straight_on_in_what_low_frequencies_tell_of_a_lag() -> None:
    place, step = np.array([np.log(800.0), 4.0, 1e-3, -2e-4]), np.array([0.3, 0.1, 2e-4, -1e-4])

    low, high = limits(TICK_S)

    def told(share: float) -> np.ndarray:
        at = stepped(place, share * step, low, high)
        lag_s = np.exp(-at[BANDWIDTH])
        return np.array([lag_s**2, at[COMMAND_DELAY] + lag_s, *at[[1, 3]]])

    assert told(1.0) - told(0.5) == pytest.approx(told(0.5) - told(0.0), rel=1e-9)
    assert (stepped(place, 1e-6 * step, low, high) - place) / 1e-6 == pytest.approx(step, rel=1e-4)
    quicker = stepped(place, np.array([5.0, 0.0, 0.0, 0.0]), low, high)  # as far as one step goes, in both
    assert quicker[BANDWIDTH] == pytest.approx(np.log(800.0 / LEAST_LAG))
    assert quicker[COMMAND_DELAY] == pytest.approx(1e-3 + 0.5 * (1.0 - LEAST_LAG) ** 2 / 800.0)
    slow = stepped(np.array([np.log(30.0), 4.0, 1e-3, 0.0]), np.array([-0.7, 0.0, 0.0, 0.0]), low, high)
    assert slow[COMMAND_DELAY] == pytest.approx(1e-3 + LONGEST_STEP[COMMAND_DELAY])


def test_a_step_is_shortened_until_it_stays_in_the_box() -> None:
    low, high = np.zeros(3), np.ones(3)
    place = np.array([0.9, 0.5, 0.5])
    assert inside(np.array([0.4, -0.2, 0.0]), place, low, high) == pytest.approx([0.1, -0.05, 0.0])
    assert inside(np.array([0.05, -0.2, 0.1]), place, low, high) == pytest.approx([0.05, -0.2, 0.1])
    assert inside(np.array([0.4, 0.2, 0.1]), np.array([1.0, 0.5, 0.5]), low, high) == pytest.approx([0.0, 0.0, 0.0])
