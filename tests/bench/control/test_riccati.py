import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from norton_bench.control.regulator import solve_riccati
from norton_bench.errors import ExperimentError


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 3))
def test_it_gives_what_scipy_gives(seed: int, states: int, inputs: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(states, states)), rng.normal(size=(states, inputs))
    a *= 1.2 / np.max(np.abs(np.linalg.eigvals(a)))
    weight = rng.normal(size=(states, states))
    cost = weight @ weight.T
    expected = solve_discrete_are(a, b, cost, np.eye(inputs))
    assert solve_riccati(a, b, cost) == pytest.approx(expected, rel=1e-6, abs=1e-8 * np.max(np.abs(expected)))


@given(st.integers(0, 10_000), st.integers(0, 12))
def test_a_line_of_past_states_is_no_obstacle(seed: int, past: int) -> None:
    """The solution solves the equation, and no closed loop grows."""
    rng = np.random.default_rng(seed)
    a = np.eye(past + 2, k=-1)
    a[:2, :2] = [[1.0, 1e-3], [0.0, 1.0]]  # a double integrator, then its past positions
    b = np.zeros((past + 2, 1))
    b[1] = 10.0 ** rng.uniform(-4, 2)
    cost = np.zeros_like(a)
    cost[0, 0] = 10.0 ** rng.uniform(-3, 6)
    cost[-1, -1] += 1.0
    x = solve_riccati(a, b, cost)
    gain = np.linalg.solve(np.eye(1) + b.T @ x @ b, b.T @ x @ a)
    assert x == pytest.approx(a.T @ x @ (a - b @ gain) + cost, rel=1e-6, abs=1e-8 * np.max(np.abs(x)))
    assert np.max(np.abs(np.linalg.eigvals(a - b @ gain))) < 1.0


def test_a_mode_that_nothing_moves_is_said_to_have_no_controller() -> None:
    with pytest.raises(ExperimentError, match="no controller can be designed"):
        solve_riccati(np.diag([2.0, 0.5]), np.array([[0.0], [1.0]]), np.eye(2))
