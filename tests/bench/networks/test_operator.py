"""Operators against ratios of polynomials, worked out apart, and against scipy.signal."""

import numpy as np
import pytest
from hypothesis import given
from scipy import signal

from norton_bench.networks.operator import Operator, stable
from tests.bench.networks.some import minimum_phase

S = 1j * np.geomspace(0.1, 500.0, 15)


def ratio(fraction, s=S):
    return np.polyval(fraction[0], s) / np.polyval(fraction[1], s)


def answer(operator):
    return operator.response(S)[:, 0]


@given(minimum_phase())
def test_an_inverse_is_exact_and_undone_by_another(fraction):
    operator = Operator.rational(*fraction)
    inverse = operator.inverse()
    assert answer(operator) == pytest.approx(ratio(fraction), rel=1e-6)
    assert answer(inverse) * ratio(fraction) == pytest.approx(np.ones(S.size), rel=1e-6)
    assert answer(inverse.inverse()) == pytest.approx(ratio(fraction), rel=1e-6)
    assert inverse.inverse().order == operator.order
    assert operator.after(inverse).minimal().order == 0


@given(minimum_phase(), minimum_phase())
def test_series_sum_derivative_and_integral_are_those_of_the_transfer_functions(one, other):
    first, second = Operator.rational(*one), Operator.rational(*other)
    assert answer(first.after(second)) == pytest.approx(ratio(one) * ratio(other), rel=1e-6)
    sum_of = ratio(one) + ratio(other)
    assert np.abs(answer(first + second) - sum_of) == pytest.approx(0.0, abs=1e-6 * np.abs(sum_of).max())
    assert answer(first.differentiated()) == pytest.approx(S * ratio(one), rel=1e-6)
    assert answer(first.integrated()) == pytest.approx(ratio(one) / S, rel=1e-6)


def test_the_response_is_scipys():
    rng = np.random.default_rng(1)
    a, b, c = rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(1, 4))
    d = rng.normal(size=(1, 2))
    operator = Operator.of(a, b, c[0], d)
    for place in range(2):
        system = signal.StateSpace(a, b[:, [place]], c, d[:, [place]])
        assert operator.response(S)[:, place] == pytest.approx(signal.freqresp(system, S.imag)[1], rel=1e-9)
    system = signal.StateSpace(a, b[:, [0]], c, d[:, [0]])
    zeros = Operator.of(a, b[:, [0]], c[0], d[:, [0]]).zeros()
    assert np.sort_complex(zeros) == pytest.approx(np.sort_complex(signal.ss2zpk(a, b[:, [0]], c, d[:, [0]])[0]))


def test_zeros_of_a_strictly_proper_operator_are_its_numerators():
    operator = Operator.rational([1.0, 3.0, -10.0], np.poly([-1.0, -2.0, -3.0, -4.0]))
    assert np.sort(operator.zeros().real) == pytest.approx([-5.0, 2.0])
    assert not stable(operator.zeros())
    assert stable(Operator.rational([1.0], [1.0, 0.0, 0.0]).poles())


def test_states_that_nothing_reaches_or_shows_go():
    hidden = Operator.of(np.diag([-1.0, 5.0, -3.0]), [[1.0], [0.0], [2.0]], [1.0, 1.0, 0.0], [[0.5]])
    small = hidden.minimal()
    assert small.order == 1
    assert small.answers_as(hidden)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Operator.of([[1.0]], [[1.0], [2.0]], [1.0], [[0.0]]), "A must be 1 by 1 and B 1 by 1"),
        (lambda: Operator.of([[np.nan]], [[1.0]], [1.0], [[0.0]]), "finite"),
        (lambda: Operator.rational([1.0], [0.0]), "the denominator is zero"),
    ],
)
def test_what_is_no_operator_is_one_sentence(make, says):
    with pytest.raises(ValueError, match=says):
        make()


def test_zero_has_no_inverse():
    zero = Operator.of(np.diag([-1.0, -2.0]), [[1.0], [0.0]], [0.0, 1.0], [[0.0]])
    assert zero.vanishes
    with pytest.raises(ZeroDivisionError):
        zero.inverse()


@pytest.mark.parametrize(
    ("poles", "holds"),
    [
        ([-1000.0, -1.0], True),
        ([-1000.0, 5e-5], True),  # an integrator, as rounding leaves it
        ([-1000.0, 2e-4], False),  # grows within hours, but is no rounding
        ([-1000.0, 0.5], False),
        ([1000j, -1000j], True),
        ([1e-3 + 1000j, 1e-3 - 1000j], True),  # an oscillation without damping, as rounding leaves it
        ([1e-2 + 1000j, 1e-2 - 1000j], False),
        ([], True),
    ],
)
def test_what_grows_is_told_from_rounding(poles, holds):
    assert stable(poles) is holds
