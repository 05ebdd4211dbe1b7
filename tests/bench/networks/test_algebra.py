"""Linear networks joined, geared and seen through what lies between: identities, and cases from textbooks."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from norton_bench.errors import UsageError
from norton_bench.networks.algebra import (
    Carried,
    Gear,
    Yielding,
    element,
    exertion_shares,
    geared,
    in_parallel,
    in_series,
    inward,
    motion_shares,
    outward,
)
from norton_bench.networks.family import coupled
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Load, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.operator import Operator
from tests.bench.networks.some import MOTOR, linear_networks, minimum_phase

S = 1j * np.geomspace(0.3, 300.0, 12)
TICK_S = 1e-3
SHAPES = tuple(product(Kind, Form))
RATIOS = st.floats(0.05, 20.0) | st.floats(-20.0, -0.05)


def impedance_at(network):
    connection = network.connection.response(S)[:, 0]
    return connection if network.form is Form.IMPEDANCE else 1.0 / connection


def exertion_source_at(network):
    source = network.source.response(S)
    return source if network.kind is Kind.THEVENIN else source * impedance_at(network)[:, None]


def same(found, expected):
    assert found == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def summed(join, *networks):
    """A network whose source grows is refused, as in every conversion: chance makes some of these."""
    try:
        return join(*networks)
    except NoConversionError:
        reject()


@given(linear_networks(), linear_networks())
@settings(max_examples=25, deadline=None)
def test_common_motion_adds_exertions(one, other):
    both = summed(in_parallel, one, other)
    assert (both.kind, both.form) == (one.kind, one.form)
    assert both.command_units == one.command_units + other.command_units
    same(impedance_at(both), impedance_at(one) + impedance_at(other))
    same(exertion_source_at(both), np.hstack([exertion_source_at(one), exertion_source_at(other)]))


@given(linear_networks(), linear_networks())
@settings(max_examples=25, deadline=None)
def test_common_exertion_adds_motions(one, other):
    both = summed(in_series, one, other)
    same(1.0 / impedance_at(both), 1.0 / impedance_at(one) + 1.0 / impedance_at(other))
    sources = [exertion_source_at(each) / impedance_at(each)[:, None] for each in (one, other)]
    same(exertion_source_at(both) / impedance_at(both)[:, None], np.hstack(sources))


@given(linear_networks(), linear_networks())
@settings(max_examples=20, deadline=None)
def test_series_is_the_dual_of_parallel(one, other):
    """With exertion for motion and admittance for impedance, each is the other."""

    def dual(network):
        kind = Kind.THEVENIN if network.kind is Kind.NORTON else Kind.NORTON
        form = Form.IMPEDANCE if network.form is Form.ADMITTANCE else Form.ADMITTANCE
        return LinearNetwork(kind, form, network.source, network.connection, network.command_units)

    there = dual(summed(in_series, one, other))
    here = summed(in_parallel, dual(one), dual(other))
    same(impedance_at(here), impedance_at(there))
    same(exertion_source_at(here), exertion_source_at(there))


@st.composite
def mechanisms(draw, slowest, fastest, heaviest=0.1):
    """A damped spring, with or without a mass, and beside them a spring behind a damper, with a pole in this range."""
    mass = draw(st.just(0.0) | st.floats(0.01 * heaviest, heaviest))
    whole = Operator.polynomial(draw(st.floats(0.5, 20.0)), draw(st.floats(0.05, 1.0)), mass)
    return whole + Operator.rational([draw(st.floats(0.5, 20.0)), 0.0], [1.0, draw(st.floats(slowest, fastest))])


ACTUATORS, LOADS, SPRINGS = mechanisms(1.0, 8.0), mechanisms(11.0, 22.0), mechanisms(30.0, 60.0, heaviest=0.0)


@given(
    st.sampled_from(SHAPES),
    st.floats(5.0, 60.0),
    ACTUATORS,
    LOADS,
    SPRINGS,
    st.floats(0.2, 5.0) | st.floats(-5.0, -0.2),
)
@settings(max_examples=25, deadline=None)
def test_what_lies_between_is_taken_away_again(shape, bandwidth, actuator, load, spring, ratio):
    """Any mechanism in any type and form, through a load, a gear and a spring: orders of up to 12 on the way."""
    source = Operator.rational([bandwidth], [1.0, bandwidth])
    network = LinearNetwork(Kind.NORTON, Form.IMPEDANCE, source, actuator, ("rad",)).converted(*shape)
    between = (Carried(element(load)), Gear(ratio), Yielding(element(spring)))
    beyond = summed(outward, network, *between)
    at = [part.response(S)[:, 0] for part in (actuator, load, spring)]
    same(impedance_at(beyond), 1.0 / (1.0 / (ratio**2 * (at[0] + at[1])) + 1.0 / at[2]))
    back = summed(inward, beyond, *between)
    assert (back.kind, back.form) == shape
    # Up to 300 rad/s: what cancels but for rounding may leave a mode far beyond.
    assert impedance_at(back) == pytest.approx(impedance_at(network), rel=1e-5)
    assert exertion_source_at(back) == pytest.approx(exertion_source_at(network), rel=1e-5)


@given(linear_networks(), RATIOS)
@settings(max_examples=25, deadline=None)
def test_a_gear_multiplies_exertion_and_divides_motion(network, ratio):
    beyond = geared(network, ratio)
    same(impedance_at(beyond), ratio**2 * impedance_at(network))
    same(exertion_source_at(beyond), ratio * exertion_source_at(network))
    assert geared(beyond, 1.0 / ratio).connection.answers_as(network.connection)


@given(st.lists(minimum_phase(), min_size=2, max_size=4))
@settings(max_examples=25, deadline=None)
def test_the_shares_are_those_of_a_divider_and_one_together(parts):
    operators = [Operator.rational(*part) for part in parts]
    at = np.array([each.response(S)[:, 0] for each in operators])
    for shares in (exertion_shares(*operators), motion_shares(*operators)):
        found = np.array([each.response(S)[:, 0] for each in shares])
        assert found == pytest.approx(at / at.sum(axis=0), abs=1e-6 * np.abs(at / at.sum(axis=0)).max())
        assert found.sum(axis=0) == pytest.approx(np.ones(S.size), abs=1e-6 * np.abs(found).max())


def test_springs_and_masses_are_those_of_textbooks():
    """K₁ + K₂ and K₁K₂/(K₁ + K₂); N²J behind a gear; a mass on a spring is no impedance at √(K/J)."""
    one, other = element(Operator.polynomial(3.0)), element(Operator.polynomial(6.0))
    assert in_parallel(one, other).impedance.answers_as(Operator.polynomial(9.0))
    assert in_series(one, other).impedance.answers_as(Operator.polynomial(2.0))
    rotor = element(Operator.polynomial(0.0, 0.0, 1e-4))
    assert geared(rotor, 50.0).impedance.answers_as(Operator.polynomial(0.0, 0.0, 0.25))
    behind = in_series(rotor, element(Operator.polynomial(4.0)))
    assert behind.impedance.answers_as(Operator.rational([4.0 * 1e-4, 0.0, 0.0], [1e-4, 0.0, 4.0]))


def test_a_series_elastic_actuator_is_its_motor_behind_a_spring():
    """Blocked: f = K Y f_T/(1 + K Y), with Y = 1/(J s² + B s) of the motor; by hand."""
    torque = LinearNetwork(
        Kind.THEVENIN, Form.IMPEDANCE, Operator.rational([300.0], [1.0, 300.0]),
        Operator.polynomial(0.0, 0.02, 1e-3), ("N*m",),
    )  # fmt: skip
    blocked = outward(torque, Yielding(element(Operator.polynomial(40.0)))).source
    by_hand = Operator.rational([300.0 * 40.0], np.polymul([1.0, 300.0], [1e-3, 0.02, 40.0]))
    assert blocked.answers_as(by_hand)
    assert blocked.order == 3


def test_a_load_that_is_carried_moves_as_one_that_is_coupled():
    arm = LinearNetwork(
        Kind.NORTON, Form.IMPEDANCE, Operator.rational([50.0], [1.0, 50.0]), Operator.polynomial(3.0, 0.1), ("rad",)
    )
    command = np.sin(np.arange(400) * 0.02)
    whole = coupled(arm, command, Load(0.03, 0.1, 2.0), TICK_S).position_rad
    carried = outward(arm, Carried(element(Operator.polynomial(2.0, 0.1, 0.02))))
    found = coupled(carried.converted(Kind.NORTON, Form.ADMITTANCE), command, Load(0.01), TICK_S).position_rad
    assert found == pytest.approx(whole, abs=1e-9)


def test_an_element_can_be_saved(tmp_path):
    spring = element(Operator.polynomial(3.0))
    save(spring, tmp_path / "spring.network.json")
    assert load(tmp_path / "spring.network.json") == spring


STILL = LinearNetwork(Kind.NORTON, Form.ADMITTANCE, Operator.gains(1.0), Operator.polynomial(0.0), ("rad",))
SPRING = element(Operator.polynomial(3.0))


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda: in_parallel(SPRING), "nothing to be joined to; give two or more"),
        (lambda: in_parallel(STILL, SPRING), "an ideal motion source has no impedance"),
        (lambda: geared(SPRING, 0.0), "needs a finite ratio that is not zero"),
        (lambda: inward(SPRING, Gear(0.0)), "needs a finite ratio that is not zero"),
        (lambda: outward(SPRING, Carried(MOTOR)), "has no commands of its own; join a network that has some"),
        (
            lambda: exertion_shares(Operator.polynomial(1.0), Operator.polynomial(-1.0)),
            "together the elements are zero",
        ),
        (lambda: element("K*y", K=1.0), 'element: output f_Z: "y" in "K\\*y" is not known; known are K, a, v, x'),
    ],
)
def test_what_cannot_be_joined_is_one_sentence(ask, says):
    with pytest.raises(UsageError, match=says) as caught:
        ask()
    assert "\n" not in str(caught.value)
