"""The compiled operators against scipy's stiff integrator, closed forms, and what friction may never do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from norton_bench.identification import friction_operators as operators

STEPS = st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=40)
DEFLECTION = 0.7


def begins(count, share=0.0):
    begin = np.full(count, np.nan)
    begin[0] = share
    return begin


def radau(rate, instants):
    answer = solve_ivp(rate, (instants[0], instants[-1]), [0.0], "Radau", t_eval=instants, rtol=1e-9, atol=1e-11)
    return answer.y[0]


def reversing(count=4001):
    t = np.linspace(0.0, 4.0, count)
    return t, 2.0 * np.sin(2.1 * t) + 0.4 * np.sin(9.0 * t), 4.2 * np.cos(2.1 * t) + 3.6 * np.cos(9.0 * t)


def velocity_at(t):
    return 4.2 * np.cos(2.1 * t) + 3.6 * np.cos(9.0 * t)


def test_dahl_is_what_radau_integrates():
    t, x, _ = reversing()
    share = operators.bristle(x, begins(x.size), np.ones(x.size), DEFLECTION)
    exact = radau(lambda t, h: (velocity_at(t) - abs(velocity_at(t)) * h) / DEFLECTION, t)
    # Between samples the path is taken as straight: only the sample at which it turns is off.
    assert np.abs(share - exact).max() < 1e-5


@pytest.mark.long
def test_lugre_is_what_radau_integrates():
    t, x, v = reversing()

    def strength(v):
        return 1.0 + 0.8 * np.exp(-((v / 1.5) ** 2))

    between = 0.5 * (v + np.concatenate([v[:1], v[:-1]]))
    share = operators.bristle(x, begins(x.size), strength(between), DEFLECTION)
    exact = radau(lambda t, h: (velocity_at(t) - abs(velocity_at(t)) * h / strength(velocity_at(t))) / DEFLECTION, t)
    assert np.abs(share - exact).max() < 1e-4
    assert share.max() > 1.05  # Stribeck's excess is at work


@pytest.mark.parametrize("breakaway", [0.1, 0.5, 0.9])
def test_elasto_plastic_is_what_radau_integrates(breakaway):
    t, x, _ = reversing()

    def rate(t, h):
        v = velocity_at(t)
        side = np.sign(v)
        share = side * h[0]
        # Dupont 2002, written out again.
        if share <= breakaway:
            plastic = 0.0
        elif share >= 1.0:
            plastic = 1.0
        else:
            plastic = 0.5 * np.sin(np.pi * (share - (1 + breakaway) / 2) / (1 - breakaway)) + 0.5
        return [v * (1.0 - plastic * share) / DEFLECTION]

    share, _ = operators.elasto_plastic(x, begins(x.size), DEFLECTION, breakaway)
    assert np.abs(share - radau(rate, t)).max() < 3e-4


def test_stops_follow_their_definition():
    _, x, _ = reversing(401)
    deflections = np.array([0.01, 0.3, 10.0])
    share = operators.stops(x, begins(x.size), deflections)
    for row, deflection in zip(share, deflections, strict=True):
        force = 0.0
        for k in range(1, x.size):
            force = np.clip(force + (x[k] - x[k - 1]) / deflection, -1.0, 1.0)
            assert row[k] == pytest.approx(force)
    assert share[2] == pytest.approx((x - x[0]) / 10.0)  # never slips: a spring


def test_a_new_stretch_forgets():
    x = np.array([0.0, 1.0, 2.0, 2.0, 2.1])
    begin = begins(5)
    begin[3] = -1.0
    assert operators.bristle(x, begin, np.ones(5), 0.5)[3] == -1.0
    assert operators.stops(x, begin, np.array([0.5]))[0, 3:] == pytest.approx([-1.0, -0.8])
    assert operators.elasto_plastic(x, begin, 0.5, 0.5)[0, 3:] == pytest.approx([-1.0, -0.8])


def every_operator(x, share=0.0):
    begin, ones = begins(x.size, share), np.ones(x.size)
    yield operators.bristle(x, begin, ones, DEFLECTION)
    yield operators.stops(x, begin, np.array([DEFLECTION]))[0]
    yield operators.elasto_plastic(x, begin, DEFLECTION, 0.4)[0]


@settings(max_examples=60, deadline=None)
@given(STEPS, st.floats(-1.0, 1.0))
def test_share_stays_within_strength(steps, share):
    x = np.concatenate([[0.0], np.cumsum(steps)])
    for h in every_operator(x, share):
        assert np.all(np.abs(h) <= 1.0 + 1e-12)


@settings(max_examples=60, deadline=None)
@given(STEPS, st.floats(-1.0, 1.0))
def test_sample_rate_does_not_matter(steps, share):
    x = np.concatenate([[0.0], np.cumsum(steps)])
    fine = np.interp(np.arange(4 * (x.size - 1) + 1) / 4, np.arange(x.size), x)
    for coarse, dense in zip(every_operator(x, share), every_operator(fine, share), strict=True):
        # The elasto-plastic flow is tabulated, the others are exact.
        assert dense[::4] == pytest.approx(coarse, abs=2e-4)


@settings(max_examples=60, deadline=None)
@given(STEPS, st.floats(-1.0, 1.0))
def test_no_friction_gives_more_than_it_stored(steps, share):
    """Work done on the contact is never less than the gain of its elastic energy, deflection·h²/2."""
    x = np.concatenate([[0.0], np.cumsum(steps)])
    fine = np.interp(np.arange(200 * (x.size - 1) + 1) / 200, np.arange(x.size), x)
    for h in every_operator(fine, share):
        work = np.concatenate([[0.0], np.cumsum(0.5 * (h[1:] + h[:-1]) * np.diff(fine))])
        stored = 0.5 * DEFLECTION * (h**2 - h[0] ** 2)
        assert np.all(work - stored > -1e-3)
