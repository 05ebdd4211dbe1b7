"""What the data cannot tell, in words."""

import numpy as np
import pytest

from norton_bench.identification.results import loose_directions, verdict, words
from norton_bench.models.parameters import Estimate, Status

NAMES = ("torque_gain", "inertia", "viscous_damping")


def covariance(*directions: tuple[float, tuple[float, float, float]]) -> np.ndarray:
    """Tight everywhere, but for deviations along directions."""
    total = 1e-6 * np.eye(3)
    for deviation, vector in directions:
        unit = np.array(vector) / np.linalg.norm(vector)
        total += deviation**2 * np.outer(unit, unit)
    return total


def test_nothing_loose_nothing_said():
    assert loose_directions(NAMES, covariance((0.3, (1, 2, 3)))) == ()


def test_a_common_factor_is_recognised():
    (direction,) = loose_directions(NAMES, covariance((1e3, (1, 1, 1))))
    assert direction.common_factor
    assert direction.deviation == pytest.approx(1e3)
    assert words(direction) == (
        "Known only up to a common factor are torque gain, inertia and viscous damping: "
        "impose motion and measure torque to fix it."
    )


def test_two_that_make_up_for_each_other():
    (direction,) = loose_directions(NAMES, covariance((2.0, (0, 1, -0.8))))
    assert direction.names == ("inertia", "viscous_damping")
    assert not direction.common_factor
    assert "one can make up for another; impose faster motion" in words(direction)


def test_one_alone_is_hardly_excited_and_the_loosest_comes_first():
    found = loose_directions(NAMES, covariance((0.8, (0, 0, 1)), (5.0, (0, 1, 0))))
    assert [direction.names for direction in found] == [("inertia",), ("viscous_damping",)]
    assert words(found[0]).startswith("The data hardly excite inertia")


def test_all_sentences_in_order():
    bound = Estimate("amplifier_bandwidth", 6000.0, 1.0, "rad/s", Status.AT_BOUND)
    ratio = Estimate("inertia", 5.5e-5, 1e-7, "kg*m^2", Status.VALID)
    said = verdict([bound], (), ratios=[ratio], converged=False, has_current=False)
    assert said[0].startswith("The fit did not converge")
    assert "inertia / torque gain = 5.5e-05 ± 2e-07" in said[1]
    assert said[2] == "At the edge of what was searched: amplifier bandwidth; it is no estimate."
    assert said[3].startswith("Torque constant and amplifier gain are known only as a product")
    assert verdict([], (), ratios=[], converged=True, has_current=True) == ()
