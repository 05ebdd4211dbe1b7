"""The four shapes of a linear network: inverse conversions, one port, and what has no equivalent."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from norton_bench.errors import UsageError
from norton_bench.networks.family import converted, coupled, exertion, motion
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.linear import LinearNetwork, closed_loop
from norton_bench.networks.operator import Operator
from tests.bench.networks.some import linear_networks, minimum_phase

SHAPES = tuple(product(Kind, Form))
S = 1j * np.geomspace(0.3, 300.0, 12)
TICK_S = 1e-3


def arm(stiffness=3.0, damping=0.1, inertia=0.01):
    """A lagging position source behind spring, damper and inertia."""
    source = Operator.rational([50.0], [1.0, 50.0])
    return LinearNetwork(
        Kind.NORTON, Form.IMPEDANCE, source, Operator.polynomial(stiffness, damping, inertia), ("rad",)
    )


@given(linear_networks(), st.sampled_from(SHAPES))
@settings(max_examples=25)
def test_conversions_are_inverses_of_each_other(network, shape):
    there = network.converted(*shape)
    assert (there.kind, there.form) == shape
    back = there.converted(network.kind, network.form)
    assert back.source.answers_as(network.source, 1e-5)
    assert back.connection.answers_as(network.connection, 1e-6)
    assert back.source.order <= network.source.order + 2 * network.connection.order


def test_a_state_that_shows_nothing_but_rounding_is_left_out():
    rounded = Operator(np.array([[-8.4]]), np.array([[9.1]]), np.array([1.1e-16]), np.array([[1.0]]))
    assert rounded.minimal().order == 0
    assert rounded.minimal().answers_as(rounded)


@given(linear_networks(), minimum_phase())
@settings(max_examples=25)
def test_all_shapes_move_every_load_alike(network, load):
    """Against the transfer functions worked out by hand: x = Y_L f, f = f_T Z_L/(Z + Z_L)."""
    source, connection = network.response(S)
    impedance = connection if network.form is Form.IMPEDANCE else 1.0 / connection
    exertion_source = source.T if network.kind is Kind.THEVENIN else source.T * impedance
    beyond = np.polyval(load[0], S) / np.polyval(load[1], S)
    expected = (exertion_source / (impedance + beyond)).T
    for shape in SHAPES:
        found = closed_loop(network.converted(*shape), Operator.rational(*load)).response(S)
        assert np.abs(found - expected) == pytest.approx(0.0, abs=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("shape", SHAPES)
def test_in_time_all_shapes_move_a_load_as_scipy_says(shape):
    """Thévenin and Norton are one at the port: c → x = Z x_N/(Z + Z_L), by scipy's own integration."""
    load = Load(inertia_kgm2=0.02, damping_nms_rad=0.05, stiffness_nm_rad=2.0)
    rng = np.random.default_rng(3)
    command = rng.normal(size=800)
    whole = signal.tf2ss(50.0 * np.array([0.01, 0.1, 3.0]), np.polymul([1.0, 50.0], [0.03, 0.15, 5.0]))
    _, expected, _ = signal.dlsim(signal.cont2discrete(whole, TICK_S, "zoh"), command)
    found = coupled(arm().converted(*shape), command, load, TICK_S)
    assert found.position_rad == pytest.approx(expected[:, 0], abs=1e-9)


def test_impedance_and_admittance_form_undo_each_other_in_time():
    """Motion in, exertion out; the exertion put into the admittance form gives the motion again."""
    time_s = np.arange(1500) * TICK_S
    command = np.sin(5.0 * time_s) * time_s
    angle = 0.2 * (1.0 - np.cos(9.0 * time_s)) ** 2
    steady = LinearNetwork(
        Kind.NORTON, Form.IMPEDANCE, Operator.gains(0.0), Operator.polynomial(3.0, 0.1, 0.01), ("rad",)
    )
    torque = exertion(steady, command, Motion.of_position(angle, TICK_S), TICK_S)
    back = motion(converted(steady, Kind.NORTON, Form.ADMITTANCE), command, torque, TICK_S)
    assert back == pytest.approx(angle, abs=1e-4)


def test_the_exertion_is_scipys():
    """f = Z (x_N − x) with a strictly proper part in Z, by lsim."""
    time_s = np.arange(1000) * TICK_S
    network = LinearNetwork(
        Kind.NORTON,
        Form.IMPEDANCE,
        Operator.rational([50.0], [1.0, 50.0]),
        Operator.rational([1.0, 40.0, 300.0], [1.0, 5.0]),
        ("rad",),
    )
    angle = 0.3 * np.sin(7.0 * time_s) ** 3
    found = exertion(network, np.full(1000, 0.4), Motion.of_position(angle, TICK_S), TICK_S)
    # Z = s + 35 + 125/(s + 5)
    deviation = 0.4 * (1.0 - np.exp(-50.0 * time_s)) - angle
    velocity = 20.0 * np.exp(-50.0 * time_s) - 6.3 * np.sin(7.0 * time_s) ** 2 * np.cos(7.0 * time_s)
    inner = signal.lsim(([125.0], [1.0, 5.0]), deviation, time_s)[1]
    assert found[1:-1] == pytest.approx((inner + 35.0 * deviation + velocity)[1:-1], abs=2e-3)


def test_several_commands_superpose():
    source = Operator.of([[-10.0]], [[10.0, 5.0]], [1.0], [[0.0, 0.0]])
    network = LinearNetwork(Kind.NORTON, Form.IMPEDANCE, source, Operator.polynomial(3.0, 0.2), ("rad", "V"))
    rng = np.random.default_rng(0)
    commands, still = rng.normal(size=(200, 2)), Motion.still(200)
    for shape in (Kind.NORTON, Kind.THEVENIN):
        equal = network.converted(shape, Form.IMPEDANCE)
        both = exertion(equal, commands, still, TICK_S)
        apart = sum(exertion(equal, commands * mask, still, TICK_S) for mask in ([1.0, 0.0], [0.0, 1.0]))
        assert both == pytest.approx(apart)
        assert both == pytest.approx(exertion(network, commands, still, TICK_S))


def test_a_velocity_source_is_an_angle_source_with_an_integrator():
    network = LinearNetwork.of_velocity(
        Kind.NORTON, Form.IMPEDANCE, Operator.gains(2.0), Operator.polynomial(0.1, 0.01), ("V",)
    )
    assert network.source.answers_as(Operator.rational([2.0], [1.0, 0.0]))
    assert network.connection.answers_as(Operator.polynomial(0.0, 0.1, 0.01))
    torque = network.converted(Kind.THEVENIN, Form.ADMITTANCE)
    assert torque.source.answers_as(Operator.polynomial(0.2, 0.02))
    assert torque.connection.answers_as(Operator.rational([1.0], [0.01, 0.1, 0.0]))


@pytest.mark.parametrize(
    ("network", "shape", "says"),
    [
        (
            LinearNetwork(Kind.THEVENIN, Form.IMPEDANCE, Operator.gains(1.0), Operator.polynomial(0.0), ("V",)),
            (Kind.NORTON, Form.IMPEDANCE),
            "the impedance is zero: an ideal exertion source has no admittance",
        ),
        (
            LinearNetwork(Kind.NORTON, Form.ADMITTANCE, Operator.gains(1.0), Operator.polynomial(0.0), ("V",)),
            (Kind.NORTON, Form.IMPEDANCE),
            "the admittance is zero: an ideal motion source has no impedance",
        ),
        (
            LinearNetwork(Kind.THEVENIN, Form.IMPEDANCE, Operator.gains(1.0), Operator.polynomial(-3.0, 1.0), ("V",)),
            (Kind.NORTON, Form.IMPEDANCE),
            r"the port left free runs away \(a mode at s = 3 rad/s\), so it has no motion source",
        ),
        (
            LinearNetwork(
                Kind.NORTON, Form.IMPEDANCE, Operator.gains(1.0), Operator.rational([1.0], [1.0, -2.0]), ("V",)
            ),
            (Kind.THEVENIN, Form.IMPEDANCE),
            r"the port held still builds up exertion \(a mode at s = 2 rad/s\), so it has no exertion source",
        ),
    ],
)
def test_what_has_no_equivalent_says_why(network, shape, says):
    with pytest.raises(NoConversionError, match=says):
        network.converted(*shape)


def test_an_unstable_zero_does_not_hinder_another_form():
    """Only the source would run away; in the connection a load holds the mode."""
    network = LinearNetwork(Kind.THEVENIN, Form.IMPEDANCE, Operator.gains(1.0), Operator.polynomial(-3.0, 1.0), ("V",))
    other = network.converted(Kind.THEVENIN, Form.ADMITTANCE)
    assert not np.any(other.connection.poles().real < 0)
    found = coupled(other, np.ones(3000), Load(stiffness_nm_rad=5.0), TICK_S)
    assert found.position_rad[-1] == pytest.approx(0.5, rel=1e-2)


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda: exertion(arm().converted(Kind.NORTON, Form.ADMITTANCE), [0.0], Motion.still(1), TICK_S), "convert it"),
        (lambda: motion(arm(), [0.0], [0.0], TICK_S), "convert it"),
        (lambda: exertion(arm(), np.zeros(3), Motion.still(4), TICK_S), "3 commands for 4 ticks"),
        (lambda: exertion(arm(), np.zeros((4, 2)), Motion.still(4), TICK_S), "has 1 command inputs"),
        (lambda: exertion(arm(), np.zeros(4), Motion.still(4), TICK_S), "answers to the command's derivative"),
        (lambda: coupled(arm(), np.zeros(4), Load(-0.0, -0.1, -3.0), TICK_S), None),
    ],
)
def test_what_cannot_be_simulated_is_one_sentence(ask, says):
    if says is None:
        ask()
        return
    with pytest.raises(UsageError, match=says):
        ask()


def test_a_load_that_cancels_the_impedance_is_refused():
    with pytest.raises(UsageError, match="no motion is determined"):
        coupled(arm(3.0, 0.1, 0.0), np.zeros(4), Load(0.0, -0.1, -3.0), TICK_S)
