"""Nonlinear networks against closed forms, scipy's own integration, and the motor's existing network."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.networks.checks import check
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import converted, coupled, exertion, motion
from norton_bench.networks.findings import of_modes
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.settled import linearised, static_exertion, static_source
from tests.bench.networks.some import MOTOR, PENDULUM, PNEUMATIC, SPRING, VARIABLE, series_elastic

TICK_S = 1e-3


@given(st.floats(0.1, 2.0), st.floats(0.0, 3.0))
def test_the_pneumatic_muscle_is_the_papers(c, x):
    """f = (π − θ)² c − K θ, whichever way it is written; zero at the source."""
    (torque,) = static_exertion(PNEUMATIC, {"c": c}, [x])
    assert torque == pytest.approx((np.pi - x) ** 2 * c - SPRING * x, abs=1e-9)
    source = static_source(PNEUMATIC, [c])
    assert (source.quantity, source.unit) == ("x_N", "rad")
    assert SPRING * source.value[0] == pytest.approx((np.pi - source.value[0]) ** 2 * c)


def test_the_pneumatic_muscle_is_not_a_function_of_deviation():
    one, other = (static_exertion(PNEUMATIC, {"c": c}, static_source(PNEUMATIC, [c]).value - 0.1) for c in (0.2, 1.5))
    assert other[0] > 1.5 * one[0]


def test_the_pneumatic_muscle_with_a_load_is_scipys():
    load = Load(inertia_kgm2=0.05, damping_nms_rad=0.3)
    found = coupled(PNEUMATIC, np.full(800, 0.7), load, TICK_S)
    start = static_source(PNEUMATIC, [0.7]).value[0]
    assert found.position_rad == pytest.approx(np.full(800, start))
    pushed = coupled(PNEUMATIC, np.concatenate([[0.7], np.full(799, 1.4)]), load, TICK_S)

    def rate(_, state):
        return [state[1], ((np.pi - state[0]) ** 2 * 1.4 - SPRING * state[0] - 0.3 * state[1]) / 0.05]

    expected = solve_ivp(rate, (0, 0.798), [start, 0.0], rtol=1e-10, atol=1e-12, t_eval=np.arange(799) * TICK_S).y[0]
    assert pushed.position_rad[1:] == pytest.approx(expected, abs=1e-8)


@pytest.mark.long
@given(st.floats(-0.5, 0.5), st.floats(0.0, 4.0), st.floats(-1.0, 1.0))
@settings(max_examples=20, deadline=None)
def test_a_second_command_sets_the_impedance_and_leaves_the_source(c, p, x):
    away = c - x
    (torque,) = static_exertion(VARIABLE, {"c": c, "p": p}, [x])
    assert torque == pytest.approx((1.0 + 0.95 * p) * away + 3.0 * away**3, abs=1e-9)
    assert static_source(replace(VARIABLE, domain={"p": (p, p + 1.0)}), [c]).value == pytest.approx([c], abs=1e-9)
    assert linearised(VARIABLE, {"c": c, "p": p}).response(0.0)[0, 0].real == pytest.approx(1.0 + 0.95 * p, rel=1e-6)


def test_a_second_command_that_changes_on_the_way_is_scipys():
    time_s = np.arange(600) * TICK_S
    commands = np.column_stack([np.full(600, 0.3), np.where(time_s < 0.2, 0.0, 4.0)])
    found = coupled(VARIABLE, commands, Load(inertia_kgm2=0.02, stiffness_nm_rad=2.0), TICK_S)

    def rate(t, state):
        x, v, place, q = state
        away, p = place - x, 0.0 if t < 0.2 else 4.0
        f = (1.0 + 0.95 * q) * away + 3.0 * away**3 - 0.05 * v
        return [v, (f - 2.0 * x) / 0.02, 60.0 * (0.3 - place), 40.0 * (p - q)]

    first = solve_ivp(rate, (0, 0.2), [0.0] * 4, rtol=1e-10, atol=1e-12, t_eval=time_s[:201]).y
    later = solve_ivp(rate, (0.2, 0.6), first[:, -1], rtol=1e-10, atol=1e-12, t_eval=time_s[200:]).y
    assert found.position_rad == pytest.approx(np.concatenate([first[0, :200], later[0]]), abs=1e-6)


@pytest.mark.long
def test_the_conditions_hold_under_every_modulation():
    assert all(found.holds for found in check(VARIABLE))
    slack = replace(VARIABLE, connection=replace(VARIABLE.connection, outputs={"f": "q*(x_N - x) - b*v"}))
    (unique,) = [each for each in check(slack) if each.condition == "unique zero"]
    assert unique.holds is False  # with p = 0 the spring is none


def test_the_pendulum_in_admittance_form_is_scipys():
    """Fig. 1: exertion in, motion out, with a held command and an exertion linear between the ticks."""
    time_s = np.arange(1000) * TICK_S
    outside = 0.3 * time_s
    found = motion(PENDULUM, np.full(1000, 0.5), outside, TICK_S)

    def rate(t, state):
        return [state[1], (0.5 - 0.3 * t - 0.1 * state[1] - 0.8 * np.sin(state[0])) / 0.05]

    assert found == pytest.approx(solve_ivp(rate, (0, 1), [0, 0], rtol=1e-10, atol=1e-12, t_eval=time_s).y[0], abs=1e-8)


def test_the_pendulum_with_a_load_is_scipys():
    found = coupled(PENDULUM, np.full(1000, 0.5), Load(0.02, 0.05, 0.4), TICK_S)

    def rate(_, state):
        return [state[1], (0.5 - 0.15 * state[1] - 0.8 * np.sin(state[0]) - 0.4 * state[0]) / 0.07]

    expected = solve_ivp(rate, (0, 1), [0, 0], rtol=1e-10, atol=1e-12, t_eval=np.arange(1000) * TICK_S).y
    assert found.position_rad == pytest.approx(expected[0], abs=1e-8)
    acceleration = np.gradient(expected[1], TICK_S)
    load = 0.02 * acceleration + 0.05 * expected[1] + 0.4 * expected[0]
    assert found.exertion_nm[5:-5] == pytest.approx(load[5:-5], abs=1e-4)


@pytest.mark.parametrize(
    "shape", list(product(Kind, Form)), ids=lambda each: each.value if hasattr(each, "value") else ""
)
def test_the_motor_in_every_shape_moves_a_load_alike(shape):
    """Against the existing free motion, with the load's inertia and damping put into the rotor's."""
    command = 0.06 * np.sign(np.sin(2 * np.pi * 40 * np.arange(20) * TICK_S + 0.1))
    load = Load(inertia_kgm2=4e-5, damping_nms_rad=5e-4)
    heavier = replace(MOTOR, inertia_kgm2=9e-5, viscous_damping_nms_rad=1.5e-3)
    expected = heavier.free_motion(command, TICK_S, longest_step_s=5e-6)[0]
    found = coupled(converted(MOTOR, *shape), command, load, TICK_S)
    assert found.position_rad == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_the_motors_equations_bear_any_speed():
    """Three times as fast as the contact is followed: over 300 rad/s, and a reversal from there."""
    command = 0.8 * np.sign(np.sin(2 * np.pi * 15 * np.arange(40) * TICK_S + 0.1))
    expected = MOTOR.free_motion(command, TICK_S, longest_step_s=5e-6)
    found = coupled(converted(MOTOR, Kind.THEVENIN, Form.ADMITTANCE), command, Load(), TICK_S)
    assert np.abs(expected[1]).max() > 300.0
    assert found.position_rad == pytest.approx(expected[0], abs=1e-4 * np.abs(expected[0]).max())


def test_the_motors_equations_exert_what_its_network_does():
    time_s = np.arange(60) * TICK_S
    command = 0.05 * np.sin(80.0 * time_s)
    port = Motion.of_position(20.0 * time_s + 0.1 * np.sin(90.0 * time_s), TICK_S)
    expected = exertion(MOTOR, command, port, TICK_S)
    for kind in Kind:
        found = exertion(converted(MOTOR, kind, Form.IMPEDANCE), command, port, TICK_S)
        # Where it sets out, the contact yields faster than once a tick tells.
        assert found[8:-2] == pytest.approx(expected[8:-2], abs=1e-4 * np.std(expected))
    assert exertion(MOTOR, command, port, TICK_S) == pytest.approx(MOTOR.torque(command, port.position_rad, TICK_S))


def test_the_motors_source_is_the_zero_of_its_connection():
    """f = Z(x_N, x): under its own source's motion the written-out network exerts nothing."""
    command = 0.06 * np.sin(2 * np.pi * 30 * np.arange(40) * TICK_S)
    free = coupled(MOTOR, command, Load(), TICK_S)
    assert free.position_rad == pytest.approx(MOTOR.free_motion(command, TICK_S)[0], abs=1e-5)
    assert np.abs(free.exertion_nm).max() < 1e-15


@given(st.floats(-0.2, 0.2))
@settings(max_examples=10)
def test_the_blocked_port_is_ambiguous_by_twice_coulomb_and_the_free_one_is_not(command):
    """Section IV.D: Thévenin's source depends on how the port came to rest, Norton's on the command alone."""
    time_s = np.arange(400) * TICK_S
    way = np.where(time_s < 0.2, 0.25 * (1.0 - np.cos(np.pi * time_s / 0.2)), 0.5)
    held = np.full(400, command)
    blocked = [exertion(MOTOR, held, Motion.of_position(side * way, TICK_S), TICK_S)[-1] for side in (1.0, -1.0)]
    assert blocked[1] - blocked[0] == pytest.approx(2.0 * MOTOR.coulomb_torque_nm, rel=1e-6)
    assert np.mean(blocked) == pytest.approx(MOTOR.torque_gain * command, abs=1e-9)
    free = [MOTOR.free_motion(np.full(1200, command), TICK_S, velocity_rad_s=start)[1][-1] for start in (60.0, -60.0)]
    assert free == pytest.approx([float(MOTOR.source_velocity(command))] * 2, abs=5e-3)


def test_a_modulated_network_has_no_other_type():
    """Its stiffness is no part of the source, nor of the port: neither tells what the other gave."""
    assert converted(VARIABLE, Kind.NORTON, Form.IMPEDANCE) is VARIABLE
    for form in Form:
        with pytest.raises(NoConversionError, match="obeys no superposition"):
            converted(VARIABLE, Kind.THEVENIN, form)


def test_the_linearised_spring_is_the_spring():
    network = series_elastic("K*dx + 2*dx**3 + B*dv")
    found = linearised(network, {"c": 0.3})
    assert (found.order, found.direct[:, 0]) == (0, pytest.approx([4.0, 0.1]))
    pneumatic = linearised(PNEUMATIC, {"c": 0.5})
    place = static_source(PNEUMATIC, [0.5]).value[0]
    assert pneumatic.direct[0, 0] == pytest.approx(2 * 0.5 * (np.pi - place) + SPRING, rel=1e-6)
    hanging = linearised(PENDULUM, {"c": 0.0})
    s = 1j * np.array([0.5, 4.0, 30.0])
    assert hanging.response(s)[:, 0] == pytest.approx(1.0 / (0.05 * s * s + 0.1 * s + 0.8), rel=1e-5)


def findings(network):
    return {each.condition: each for each in check(network)}


def test_the_three_conditions():
    sound = findings(PNEUMATIC)
    assert all(each.holds for each in sound.values())
    assert list(sound) == ["impedance form", "source is a zero", "unique zero", "stable zero dynamics"]
    assert findings(PENDULUM)["impedance form"].holds is False
    assert findings(MOTOR)["exertion source"].holds is False


def test_backlash_is_an_interval_of_zeros_with_its_width():
    found = findings(series_elastic("K*(dx - min(max(dx, -play), play))"))["unique zero"]
    assert found.holds is False
    assert found.interval_rad == pytest.approx(0.1, abs=0.011)


def test_backlash_between_two_places_of_the_grid_is_not_overlooked():
    """0.4 mrad, a sixth of the distance of two places."""
    narrow = series_elastic("K*(dx - min(max(dx, -play), play))")
    parameters = {**narrow.connection.parameters, "play": 2e-4}
    narrow = replace(narrow, connection=replace(narrow.connection, parameters=parameters))
    found = findings(narrow)["unique zero"]
    assert found.holds is False
    assert found.interval_rad == pytest.approx(4e-4, rel=1e-3)


def with_states(exertion, **rates):
    """A positioned source and a connection of ``exertion`` with states; its spring is K = 4 N m/rad."""
    plain = series_elastic("K*dx")
    parameters = {**plain.connection.parameters, "s": 50.0, "sigma": 20.0}
    connection = Equations(plain.connection.inputs, {"f": exertion}, rates=rates, parameters=parameters)
    return replace(plain, connection=connection)


@pytest.mark.long
def test_a_maxwell_element_holds_no_place():
    """A spring behind a damper: at rest nothing is left of it."""
    found = findings(with_states("K*(dx - q)", q="20*(dx - q)"))["unique zero"]
    assert found.holds is False
    assert "the place is free" in found.why
    beside_a_spring = findings(with_states("K*dx + K*(dx - q)", q="20*(dx - q)"))["unique zero"]
    assert beside_a_spring.holds


def test_a_friction_contact_beside_a_spring_leaves_a_range_of_places():
    """Coulomb torque sigma/s = 0.4 N m against 4 N m/rad: the zeros lie 2·0.1 rad apart."""
    found = findings(with_states("K*dx + sigma*q", q="dv - s*abs(dv)*q"))["unique zero"]
    assert found.holds is False
    assert "how the port came there" in found.why
    assert found.interval_rad == pytest.approx(0.2, rel=0.01)


def test_a_second_zero_and_a_source_that_is_none_are_told():
    twice = findings(series_elastic("K*dx*(dx - 0.3)"))
    assert twice["source is a zero"].holds
    assert twice["unique zero"].holds is False
    assert "2 times" in twice["unique zero"].why
    assert findings(series_elastic("K*dx + 0.2"))["source is a zero"].holds is False


def test_unstable_zero_dynamics_are_told():
    """A port that runs away when it is left alone: more push the further it has gone."""
    found = findings(series_elastic("B*dv - K*dx"))["stable zero dynamics"]
    assert found.holds is False
    assert "40" in found.why
    assert findings(series_elastic("B*dv + K*dx"))["stable zero dynamics"].holds


def test_modes_at_zero_and_oscillations_that_last_are_called_by_their_name():
    assert of_modes(np.array([-3.0 + 4j, -3.0 - 4j])) == (True, "the slowest lies at -3 rad/s")
    assert of_modes(np.array([5j, -5j])) == (False, "an oscillation at 5 rad/s does not decay")
    assert of_modes(np.array([0.0, -2.0])) == (None, "one is zero, the slowest lies at -2 rad/s beside")
    free_mass = LinearNetwork(
        Kind.NORTON, Form.IMPEDANCE, Operator.polynomial(1.0), Operator.polynomial(0.0, 0.0, 0.1), ("rad",)
    )
    drifts = {each.condition: each for each in check(free_mass)}["stable zero dynamics"]
    assert (drifts.holds, drifts.why) == (False, "zeros of the impedance: 2 are zero; the free port drifts away")


def test_without_a_domain_nothing_is_claimed():
    found = findings(replace(PNEUMATIC, domain={}))
    assert found["unique zero"].holds is None
    assert 'declare the domain of "x"' in found["unique zero"].why


NOTHING = Equations((), {"x_N": "0", "f_T": "0"})


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"connection": Equations(("y",), {"f": "y"})}, 'the connection takes in "y"; here it can take in'),
        ({"connection": Equations(("x",), {"g": "x"})}, 'the connection must put out "f"'),
        ({"source": Equations(("u",), {"x_N": "u"})}, 'the source takes in "u", which is no command'),
        ({"step_s": 0.0}, "step_s = 0.0 is not a step"),
        ({"domain": {"x": (1.0, 0.0)}}, "domain of x: 1.0 is not below 0.0"),
        ({"command_units": {"my c": "V"}}, '"my c" is not a name'),
        ({"command_units": {"x": "V"}}, '"x" stands for a signal at the port or the source'),
        (
            {"joined_linearly": True, "connection": Equations(("dv",), {"f": "dv"})},
            'takes in "dv", so the source must put out "v_N"',
        ),
        (
            {
                "source": Equations((), {"x_N": "z"}, {"z": "-z"}),
                "connection": Equations(("x",), {"f": "z"}, {"z": "-z"}),
            },
            '"z" is a state of both parts',
        ),
    ],
)
def test_parts_that_do_not_fit_are_one_sentence(parts, says):
    whole = {
        "kind": Kind.NORTON,
        "form": Form.IMPEDANCE,
        "source": NOTHING,
        "connection": Equations(("x",), {"f": "-x"}),
        "command_units": {"c": "V"},
    }
    with pytest.raises(ValueError, match=says):
        NonlinearNetwork(**(whole | parts))


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda: coupled(PNEUMATIC, np.ones(3), Load(), TICK_S), "have no inertia together"),
        (lambda: motion(PNEUMATIC, np.ones(3), np.zeros(3), TICK_S), "convert it, or call exertion"),
        (lambda: exertion(PENDULUM, np.ones(3), Motion.still(3), TICK_S), "convert it, or call motion"),
        (lambda: exertion(PNEUMATIC, -np.ones(3), Motion.still(3), TICK_S), "do not stay finite"),
        (lambda: static_source(PNEUMATIC, [1.0], name="pi"), 'has no command "pi"; it has c'),
    ],
)
def test_what_cannot_be_worked_out_is_one_sentence(ask, says):
    with pytest.raises(UsageError, match=says):
        ask()
