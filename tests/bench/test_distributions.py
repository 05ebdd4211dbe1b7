"""Quantiles and tails: the same numbers as scipy.stats gives, to the last bit, for it is what they replace."""

import numpy as np
import pytest
from scipy import stats

from norton_bench.distributions import chi2_quantile, chi2_tail, f_tail, normal_hazard, normal_quantile, t_quantile

CHANCES = (1e-9, 0.025, 0.5, 0.975, 1 - 1e-9)
FREEDOMS = (1, 2, 7, 40, 3000)
VALUES = (0.0, 1e-3, 1.0, 17.0, 1e4)


@pytest.mark.parametrize("p", CHANCES)
def test_quantiles(p):
    assert normal_quantile(p) == stats.norm.ppf(p)
    for freedom in FREEDOMS:
        assert t_quantile(p, freedom) == stats.t.ppf(p, freedom)
        assert chi2_quantile(p, freedom) == stats.chi2.ppf(p, freedom)


@pytest.mark.parametrize("value", VALUES)
def test_tails(value):
    for freedom in FREEDOMS:
        assert chi2_tail(value, freedom) == stats.chi2.sf(value, freedom)
        assert f_tail(value, freedom, 12) == stats.f.sf(value, freedom, 12)
        assert f_tail(value, 3, freedom) == stats.f.sf(value, 3, freedom)


def test_below_zero_f_is_never_and_arrays_keep_their_shape():
    values = np.array([[-2.0, 0.0, np.inf]])
    np.testing.assert_array_equal(f_tail(values, 3, 4), [[1.0, 1.0, 0.0]])


@pytest.mark.parametrize("value", [-30.0, -1.0, 0.0, 2.0, 40.0, 1e3])
def test_the_hazard_of_a_normal_variable(value):
    assert normal_hazard(value) == np.exp(stats.norm.logpdf(value) - stats.norm.logsf(value))
