"""What the last simulation makes of a later fit's estimates."""

from dataclasses import replace

import pytest

from norton_bench.identification.live import _Correction
from norton_bench.models.parameters import Estimate, Status

DAMPING = Estimate("presliding_damping", 0.02, 0.008, "N*m*s/rad", Status.VALID)


def test_bias_is_taken_off_and_widens():
    corrected = _Correction(wider=1.0, bias=0.1, bias_std=0.3).of_estimate(replace(DAMPING, std=0.008))
    assert corrected.value == pytest.approx(0.9 * DAMPING.value)
    assert corrected.std == pytest.approx((0.4**2 + 0.3**2) ** 0.5 * DAMPING.value)


@pytest.mark.parametrize(("wider", "status"), [(1.2, Status.VALID), (1.3, Status.UNEXCITED)])
def test_a_value_that_is_known_to_no_better_than_half_is_not_told(wider, status):
    assert _Correction(wider=wider).of_estimate(DAMPING).status is status


def test_what_was_not_valid_stays_so():
    at_bound = replace(DAMPING, status=Status.AT_BOUND)
    assert _Correction(wider=9.0).of_estimate(at_bound).status is Status.AT_BOUND
