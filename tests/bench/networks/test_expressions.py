"""Equations as text: what they come to against Python's own arithmetic, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.networks.expressions import Equations, Table, read_expression

LEAVES = st.sampled_from(["a", "b", "pi"]) | st.floats(0.1, 9.0).map(repr)
TEXTS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda part: f"({part[0]} {part[1]} {part[2]})"),
        inner.map(lambda part: f"(-{part})"),
        st.tuples(st.sampled_from(["sin", "tanh", "abs", "sqrt"]), inner).map(
            lambda part: f"{part[0]}(abs({part[1]}))"
        ),
        st.tuples(inner, inner, inner).map(lambda part: f"({part[0]} if {part[1]} < 1.0 else {part[2]})"),
        st.tuples(inner, inner).map(lambda part: f"max({part[0]}, {part[1]})"),
    ),
    max_leaves=8,
)


@given(TEXTS, st.floats(-3.0, 3.0), st.floats(0.5, 3.0))
def test_an_expression_comes_to_what_python_says(text, a, b):
    known = {"sin": math.sin, "tanh": math.tanh, "sqrt": math.sqrt, "abs": abs, "max": max, "pi": math.pi}
    try:
        expected = eval(text, {"__builtins__": {}}, {**known, "a": a, "b": b})
    except ZeroDivisionError:
        return
    expression = read_expression(text, ["a", "b"], {})
    assert float(expression.work({"a": a, "b": b})) == pytest.approx(expected, rel=1e-9, nan_ok=True)
    with np.errstate(all="ignore"):
        arrays = expression.work({"a": np.array([a, a]), "b": np.array([b, b])})
    assert np.broadcast_to(arrays, 2) == pytest.approx([expected, expected], rel=1e-9, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("K*(x", "is not an expression; write it like"),
        ("", "is not an expression"),
        ("y + 1", '"y" in "y.*" is not known; known are K, x'),
        ("__import__(x)", '"__import__" of 1 .* is not a function known'),
        ("x.real", "cannot be worked out"),
        ("[x for x in (1,)]", "cannot be worked out"),
        ("sin(x, x)", '"sin" of 2'),
        ("x if K else 1", "cannot be worked out"),
        ("True", "cannot be worked out"),
        ("1e999", "too great"),
        ("9" * 400, "too great"),
        ("x" * 5000, "longer than"),
        ("(" * 500 + ")" * 500, "is not an expression"),
    ],
)
def test_what_is_no_expression_is_one_sentence(text, says):
    with pytest.raises(ValueError, match=says):
        read_expression(text, ["K", "x"], {})


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"inputs": ("x", "x"), "outputs": {"f": "x"}}, '"x" stands for two things'),
        ({"inputs": ("sin",), "outputs": {"f": "1"}}, '"sin" stands for two things'),
        ({"inputs": ("2x",), "outputs": {"f": "1"}}, '"2x" is not a name'),
        ({"inputs": ("x",), "outputs": {"f": "z"}}, 'output f: "z" in "z" is not known'),
        ({"inputs": (), "outputs": {}, "parameters": {"K": math.nan}}, '"K" is nan; give it a finite value'),
        ({"inputs": ("x",), "outputs": {}, "initial": {"z": 1.0}}, 'initial value of "z": there is no state'),
    ],
)
def test_equations_that_do_not_hold_together_are_one_sentence(parts, says):
    with pytest.raises(ValueError, match=says):
        Equations(**parts)


@given(st.floats(-3.0, 4.0), st.floats(-3.0, 4.0))
def test_a_table_of_a_bilinear_map_is_that_map_inside_and_held_outside(p, q):
    grid = (-1.0, 0.5, 2.0)
    table = Table((grid, grid), tuple(tuple(2.0 * a + a * b - b for b in grid) for a in grid))
    a, b = np.clip([p, q], -1.0, 2.0)
    assert float(table(p, q)) == pytest.approx(2.0 * a + a * b - b, abs=1e-12)
    line = Table((grid,), tuple(3.0 * a for a in grid))
    assert read_expression("2*line(p)", ["p"], {"line": line}).work({"p": p}) == pytest.approx(6.0 * a)


@pytest.mark.parametrize(
    ("nodes", "values", "says"),
    [
        (((0.0,),), (1.0,), "at least two nodes"),
        (((0.0, 0.0),), (1.0, 2.0), "must rise"),
        (((0.0, 1.0),), (1.0, 2.0, 3.0), "finite numbers, 2 of them"),
        (((0.0, 1.0), (0.0, 1.0)), ((1.0,), (2.0, 3.0)), "2 by 2 of them"),
    ],
)
def test_a_table_that_is_none_is_one_sentence(nodes, values, says):
    with pytest.raises(ValueError, match=says):
        Table(nodes, values)
