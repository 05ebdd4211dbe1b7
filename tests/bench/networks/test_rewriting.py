"""Expressions taken apart and put together, against their own values and differences of these."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.networks.expressions import LONGEST, read_expression
from norton_bench.networks.rewriting import DEEPEST, linear_in, negative, slope_of, solved, substituted, summands

NAMES = ("x", "y", "z")
POINT = {"x": 0.7, "y": -0.4, "z": 1.3}


def at(text, **changed):
    return float(read_expression(text, NAMES, {}).work({**POINT, **changed}))


LINEAR = ["x", "-x", "3*x", "x*y", "y*(x - z)/2", "z - (x - y)", "(x if y > z else -2*x) + z", "-(y - x*sin(z))"]


@pytest.mark.parametrize("text", LINEAR)
def test_what_is_linear_is_slope_times_name_and_rest(text):
    slope, rest = linear_in(text, "x")
    assert at(slope) * POINT["x"] + at(rest) == pytest.approx(at(text))
    assert at(slope, x=99.0) == at(slope)
    given_value = 2.5
    assert at(text, x=at(solved(str(given_value), slope, rest))) == pytest.approx(given_value)


@pytest.mark.parametrize("text", ["x*x", "sin(x)", "y/x", "x**2", "x if x > y else y", "max(x, y)"])
def test_what_is_not_linear_is_told(text):
    assert linear_in(text, "x") is None


SMOOTH = ["x", "y", "x*y - z", "x**3", "x/(2 + y)", "y/x", "sin(x*z)", "cos(x)", "tan(x)", "asin(x/2)", "acos(x/2)",
          "atan(x)", "sinh(x)", "cosh(x)", "tanh(2*x)", "exp(-x)", "log(x)", "sqrt(1 + x)", "abs(x - 2)*x",
          "x*x if x > y else -x"]  # fmt: skip


@pytest.mark.parametrize("text", SMOOTH)
def test_slopes_are_differences(text):
    difference = (at(text, x=POINT["x"] + 1e-6) - at(text, x=POINT["x"] - 1e-6)) / 2e-6
    assert at(slope_of(text, "x")) == pytest.approx(difference, abs=1e-7)


@given(st.sampled_from(LINEAR), st.sampled_from(SMOOTH))
@settings(max_examples=40)
def test_an_expression_is_put_in_whole(outer, inner):
    assert at(substituted(outer, {"x": inner})) == pytest.approx(at(outer, x=at(inner)))
    assert at(negative(outer)) == pytest.approx(-at(outer))
    assert sum(map(at, summands(outer))) == pytest.approx(at(outer))


def test_names_are_exchanged_all_at_once():
    assert at(substituted("x - y", {"x": "y", "y": "x"})) == pytest.approx(POINT["y"] - POINT["x"])


def test_what_becomes_too_long_or_is_too_deep_is_one_sentence():
    with pytest.raises(ValueError, match=f"have more than {LONGEST} characters; simplify them"):
        substituted("+".join(["x"] * 100), {"x": "sin(x) + " * 10 + "y"})
    with pytest.raises(ValueError, match=f"nested more than {DEEPEST} deep; simplify them"):
        substituted("+".join(["x"] * 300), {"x": "y"})
