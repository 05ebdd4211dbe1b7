"""The rule that selects a model."""

import numpy as np
import pytest

from norton_bench.identification.statistics import held_out_rms, simplest_as_good

FOLDS = np.array([1.0, 4.0, 2.0, 8.0, 3.0])
UNEVEN = np.array([1.0, -1.0, 1.0, -1.0, 0.5])


def test_error_over_folds_and_its_standard_error():
    """Against 4,000 repetitions of 8 folds of 50 errors of deviation 3."""
    random = np.random.default_rng(0)
    squares = np.mean((3.0 * random.standard_normal((4_000, 8, 50))) ** 2, axis=2)
    rms, std = np.array([held_out_rms(each) for each in squares]).T
    assert np.mean(rms) == pytest.approx(3.0, rel=0.01)
    assert np.sqrt(np.mean(std**2)) == pytest.approx(np.std(rms), rel=0.05)


def test_no_error_has_no_doubt():
    assert held_out_rms([0.0, 0.0]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("richer", "chosen"),
    [
        (0.9 * FOLDS, 1),  # sure and large
        (0.985 * FOLDS, 0),  # sure, and less than a hundredth of the error
        (FOLDS + 3.0 * UNEVEN - 0.2, 0),  # no better in some folds
        (1.5 * FOLDS, 0),
    ],
)
def test_a_richer_model_must_be_better_surely_and_by_enough(richer, chosen):
    assert simplest_as_good([FOLDS, richer], [2, 3]) == chosen
    assert simplest_as_good([richer, FOLDS], [3, 2]) == 1 - chosen


def test_folds_that_differ_do_not_hide_a_sure_gain():
    """Folds scatter by several times the difference; what differs between models is the same in each."""
    assert simplest_as_good([FOLDS, FOLDS - 0.3], [2, 3]) == 1


def test_a_model_that_a_simpler_one_beats_is_not_chosen_instead_of_it() -> None:
    """Its error scatters so much that it might be as good as the best; the simpler one is surely worse than that."""
    best, simple, erratic = FOLDS, 1.3 * FOLDS, FOLDS * np.array([0.2, 0.2, 5.0, 0.2, 5.0])
    assert np.mean(erratic) > np.mean(simple)
    assert simplest_as_good([best, simple, erratic], [9, 2, 4]) == 0
    assert simplest_as_good([best, simple, erratic], [9, 5, 4]) == 2
