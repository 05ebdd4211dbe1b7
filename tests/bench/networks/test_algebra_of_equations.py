"""Networks of equations put together, against scipy's integrators on equations written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.networks.algebra import (
    Carried,
    Gear,
    Yielding,
    element,
    geared,
    in_parallel,
    in_series,
    inward,
    linked,
    outward,
)
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import commands_of, converted, coupled, exertion, motion
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.settled import static_exertion
from tests.bench.networks.some import MOTOR, PENDULUM, PNEUMATIC, SPRING, coarser, series_elastic

TICK_S = 1e-3
CUBIC = element("K*x + K3*x**3 + b*v", K=3.0, K3=900.0, b=0.002)


def integrated(rate, start, ticks, held=None):
    """States at the ticks (ticks, n); ``rate(t, state, *commands)``, the commands held from tick to tick."""
    rows, state = [np.array(start, dtype=float)], np.array(start, dtype=float)
    for k in range(ticks - 1):
        arguments = () if held is None else tuple(np.atleast_1d(held[k]))
        result = solve_ivp(rate, (0, TICK_S), state, "LSODA", rtol=1e-8, atol=1e-11, args=arguments)
        state = result.y[:, -1]
        rows.append(state)
    return np.array(rows)


def motor_rates(state, c, pull):
    """Section IV.D: amplifier, rotor, Dahl contact; ``pull`` is the torque at the motor's port."""
    tau, _, omega, phi = state
    slip = omega - 10.0 / 0.02 * abs(omega) * phi
    acceleration = (tau - 1e-3 * omega - 10.0 * phi - 0.01 * slip - pull) / 5e-5
    return [600.0 * (0.9 * c - tau), omega, acceleration, slip]


def test_a_motor_behind_a_spring_that_stiffens_is_what_scipy_integrates():
    """Motor, spring K x + K₃ x³ with a damper, and a pendulum that is carried and coupled."""
    command = 0.15 * np.sign(np.sin(2 * np.pi * 12 * np.arange(120) * TICK_S + 0.1))
    arm = outward(MOTOR, Yielding(CUBIC), Carried(element("G*sin(x)", G=0.03)))
    assert (arm.kind, arm.form) == (Kind.THEVENIN, Form.IMPEDANCE)
    found = coupled(coarser(arm), command, Load(inertia_kgm2=2e-4), TICK_S)

    def rate(_, state, c):
        x, v = state[4:]
        away, slip = state[1] - x, state[2] - v
        pull = 3.0 * away + 900.0 * away**3 + 0.002 * slip
        return [*motor_rates(state[:4], c, pull), v, (pull - 0.03 * np.sin(x)) / 2e-4]

    expected = integrated(rate, [0.0] * 6, 120, command)[:, 4]
    assert np.ptp(expected) > 0.3
    assert found.position_rad == pytest.approx(expected, abs=1e-5 * np.ptp(expected))


def test_two_motors_on_one_shaft_are_what_scipy_integrates():
    """Thévenin's sources add, and so do the two contacts, each with its own memory; the connection stays linear."""
    other = replace(MOTOR, torque_gain=0.5, inertia_kgm2=1e-4, coulomb_torque_nm=0.02)
    both = in_parallel(MOTOR, other)
    assert commands_of(both) == {"c": "N*m", "c_2": "N*m"}
    assert both.joined_linearly
    wave = np.sin(2 * np.pi * 10 * np.arange(150) * TICK_S)
    commands = np.column_stack([0.1 * wave, 0.06 * np.sign(wave)])
    found = coupled(coarser(both), commands, Load(), TICK_S)

    def rate(_, state, one, two):
        tau, tau_2, _, omega, phi = state
        slip = omega - 500.0 * abs(omega) * phi
        acceleration = (tau + tau_2 - 2e-3 * omega - 20.0 * phi - 0.02 * slip) / 1.5e-4
        return [600.0 * (0.9 * one - tau), 600.0 * (0.5 * two - tau_2), omega, acceleration, slip]

    expected = integrated(rate, [0.0] * 5, 150, commands)[:, 2]
    assert found.position_rad == pytest.approx(expected, abs=1e-5 * np.ptp(expected))


@pytest.mark.parametrize("ratio", [20.0, -0.2])
def test_a_geared_motor_is_what_scipy_integrates(ratio):
    """The motor turns ``ratio`` times as far as the load, which feels ``ratio`` times its torque."""
    command = 0.12 * np.sin(2 * np.pi * 8 * np.arange(150) * TICK_S)
    inertia = 3e-5 * ratio**2
    found = coupled(coarser(geared(MOTOR, ratio)), command, Load(inertia, 0.0, 0.5 * ratio**2), TICK_S)

    def rate(_, state, c):
        whole = motor_rates(state, c, 0.5 * state[1])
        return [whole[0], whole[1], whole[2] * 5e-5 / 8e-5, whole[3]]

    expected = integrated(rate, [0.0] * 4, 150, command)[:, 1] / ratio
    assert found.position_rad == pytest.approx(expected, abs=1e-5 * np.ptp(expected))


@pytest.mark.long
def test_a_motor_behind_an_elliptic_gear_is_what_scipy_integrates():
    """θ = x + e sin x, n = 1 + e cos x: the motor's inertia comes with n², and n' v² of its acceleration."""
    command = 0.1 * np.sin(2 * np.pi * 5 * np.arange(150) * TICK_S)
    gear = linked(MOTOR, "x + e*sin(x)", e=0.4)

    def rate(_, state, c):
        tau, x, v, phi = state
        n, bend = 1 + 0.4 * np.cos(x), -0.4 * np.sin(x)
        slip = n * v - 500.0 * abs(n * v) * phi
        inner = tau - 5e-5 * bend * v**2 - 1e-3 * n * v - 10.0 * phi - 0.01 * slip
        return [600.0 * (0.9 * c - tau), v, n * inner / (3e-5 + 5e-5 * n**2), slip]

    expected = integrated(rate, [0.0] * 4, 150, command)[:, 1]
    assert np.ptp(expected) > 1.0
    for kind in (Kind.THEVENIN, Kind.NORTON):
        found = coupled(coarser(converted(gear, kind, Form.IMPEDANCE)), command, Load(3e-5), TICK_S)
        assert found.position_rad == pytest.approx(expected, abs=1e-5 * np.ptp(expected))


def test_an_admittance_beside_an_impedance_is_what_scipy_integrates():
    """A pendulum (Fig. 1) with a spring and damper on it: exertion in, motion out, without a loop."""
    sprung = outward(PENDULUM, Carried(element("K*x + B*v + K3*x**3", K=0.4, B=0.05, K3=2.0)))
    assert sprung.form is Form.ADMITTANCE
    outside = 0.6 * np.sin(7.0 * np.arange(600) * TICK_S)
    found = motion(sprung, np.full(600, 0.5), outside, TICK_S)

    def rate(t, state):
        x, v = state
        f = np.interp(t, np.arange(600) * TICK_S, outside)
        return [v, (0.5 - f - 0.15 * v - 0.8 * np.sin(x) - 0.4 * x - 2.0 * x**3) / 0.05]

    time_s = np.arange(600) * TICK_S
    expected = solve_ivp(rate, (0, 0.599), [0, 0], "LSODA", rtol=1e-10, atol=1e-12, t_eval=time_s, max_step=TICK_S).y[0]
    assert found == pytest.approx(expected, abs=1e-6)


def test_two_pendulums_on_one_shaft_are_what_scipy_integrates():
    """Both are admittances; their exertions add as impedances, into which they are solved."""
    heavier = outward(PENDULUM, Carried(element("J*a", J=0.03)))
    both = in_parallel(heavier, PENDULUM)
    commands = np.column_stack([np.full(500, 0.5), np.full(500, 0.2)])
    found = coupled(both, commands, Load(0.02), TICK_S).position_rad
    time_s = np.arange(500) * TICK_S

    def rate(_, state):
        return [state[1], (0.7 - 0.2 * state[1] - 1.6 * np.sin(state[0])) / 0.15]

    expected = solve_ivp(rate, (0, 0.499), [0, 0], "LSODA", rtol=1e-10, atol=1e-12, t_eval=time_s).y[0]
    assert found == pytest.approx(expected, abs=1e-7)


def test_a_linear_network_and_one_of_equations_are_what_scipy_integrates():
    """An operator with a state of its own (a Maxwell element) beside the spring of a series-elastic drive."""
    maxwell = Operator.rational([5.0, 0.0], [1.0, 30.0])
    whole = in_parallel(series_elastic("K*dx + 9*dx**3 + B*dv"), element(maxwell + Operator.polynomial(0.0, 0.0, 0.01)))
    command = np.full(500, 0.4)
    found = coupled(whole, command, Load(0.01), TICK_S)

    def rate(_, state):
        x, v, place, z = state
        away, f_maxwell = place - x, 5.0 * (x - 30.0 * z)
        pull = 4.0 * away + 9.0 * away**3 + 0.1 * (20.0 * (0.4 - place) - v)
        return [v, (pull - f_maxwell) / 0.02, 20.0 * (0.4 - place), x - 30.0 * z]

    time_s = np.arange(500) * TICK_S
    expected = solve_ivp(rate, (0, 0.499), [0.0] * 4, "LSODA", rtol=1e-10, atol=1e-12, t_eval=time_s).y[0]
    assert found.position_rad == pytest.approx(expected, abs=1e-6)


def test_linear_networks_are_the_same_as_equations():
    """An arm of operators, put together with an element of expressions, is what operators alone make of it."""
    arm = LinearNetwork(
        Kind.NORTON, Form.ADMITTANCE, Operator.rational([50.0], [1.0, 50.0]),
        Operator.rational([1.0], [0.02, 0.1, 3.0]), ("rad",),
    )  # fmt: skip
    command, load = np.sin(np.arange(300) * 0.03), Load(0.01, 0.0, 1.0)
    exact = coupled(in_series(arm, element(Operator.polynomial(8.0, 0.05))), command, load, TICK_S).position_rad
    found = coupled(in_series(arm, element("K*x + B*v", K=8.0, B=0.05)), command, load, TICK_S).position_rad
    assert found == pytest.approx(exact, abs=1e-6)


def test_muscles_that_work_against_each_other_are_the_papers():
    """Section IV.C.2 twice, face to face: a second command that stiffens; f = (π−θ)² c − Kθ − ((π+θ)² c₂ + Kθ)."""
    muscle = replace(PNEUMATIC, domain={"x": (-3.0, 3.0)})
    pair = in_parallel(muscle, geared(muscle, -1.0))
    place = np.linspace(-0.5, 0.5, 9)
    found = static_exertion(pair, {"c": 0.8, "c_2": 0.5}, place)
    by_hand = (np.pi - place) ** 2 * 0.8 - (np.pi + place) ** 2 * 0.5 - 2 * SPRING * place
    assert found == pytest.approx(by_hand, abs=1e-9)


def test_what_lies_between_is_taken_away_from_equations_too():
    """Impedances through a load and a gear; admittances through a spring in series."""
    drive = series_elastic("K*dx + 9*dx**3 + B*dv")
    between = (Carried(element("G*sin(x) + J*a", G=0.7, J=0.02)), Gear(3.0))
    time_s = np.arange(300) * TICK_S
    command, port = 0.4 * np.sin(5.0 * time_s), Motion.of_position(0.2 * np.sin(11.0 * time_s) ** 3, TICK_S)
    back = inward(outward(drive, *between), *between)
    assert exertion(back, command, port, TICK_S) == pytest.approx(exertion(drive, command, port, TICK_S), abs=1e-12)
    spring = converted(element(Operator.polynomial(9.0)), Kind.THEVENIN, Form.ADMITTANCE)
    there = outward(PENDULUM, Yielding(spring))
    pushed = 0.3 * np.sin(9.0 * time_s)
    moved, expected = (motion(each, command, pushed, TICK_S) for each in (there, PENDULUM))
    assert moved == pytest.approx(expected - pushed / 9.0, abs=1e-9)
    again = motion(inward(there, Yielding(spring)), command, pushed, TICK_S)
    assert again == pytest.approx(expected, abs=1e-9)


def test_what_is_put_together_can_be_saved(tmp_path):
    arm = outward(MOTOR, Yielding(CUBIC), Gear(5.0))
    save(arm, tmp_path / "arm.network.json")
    assert load(tmp_path / "arm.network.json") == arm


def test_names_that_two_networks_have_stay_apart():
    """The same state, parameter and table names with other values in each: the sum is that of the two."""
    one, other = series_elastic("K*dx"), series_elastic("K*dx + B*dv")
    other = replace(other, connection=replace(other.connection, parameters={"K": 7.0, "B": 0.3}))
    both = in_parallel(one, other)
    commands = np.column_stack([np.full(50, 0.3), np.full(50, -0.2)])
    apart = [
        exertion(each, commands[:, place], Motion.still(50, 0.1), TICK_S) for place, each in enumerate((one, other))
    ]
    assert exertion(both, commands, Motion.still(50, 0.1), TICK_S) == pytest.approx(sum(apart), abs=1e-12)


STATIC = NonlinearNetwork(
    Kind.NORTON,
    Form.ADMITTANCE,
    Equations(("c",), {"x_N": "c"}),
    Equations(("x_N", "f"), {"x": "x_N - tanh(f)"}),
    {"c": "V"},
)

HEAVY = LinearNetwork(
    Kind.NORTON, Form.IMPEDANCE, Operator.rational([5.0], [1.0, 5.0]), Operator.polynomial(3.0, 0.1, 0.01), ("rad",)
)


@pytest.mark.parametrize(
    ("angle", "says"),
    [
        ("x +", 'linkage: output x: "x \\+" is not an expression'),
        ("e*x", '"e" in "e\\*x" is not known; known are x'),
        ("max(x, 0)", "has no derivative in these equations"),
        ("2**x", "has x in its exponent; write it with exp"),
    ],
)
def test_a_linkage_without_a_ratio_is_one_sentence(angle, says):
    with pytest.raises(UsageError, match=says):
        linked(MOTOR, angle)


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda: in_series(PNEUMATIC, PNEUMATIC), "two networks in impedance form take motion in"),
        (lambda: in_series(PNEUMATIC, series_elastic("K*dx")), r"an algebraic loop\); convert both to admittance form"),
        (lambda: geared(element("+".join(["x"] * 300)), 2.0), "nested more than 200 deep"),
        (lambda: in_parallel(STATIC, STATIC), "two networks in admittance form take exertion in"),
        (lambda: in_parallel(STATIC, element("K*x", K=1.0)), r"an algebraic loop\); convert both to impedance form"),
        (lambda: in_parallel(STATIC, element("B*v", B=1.0)), 'one of the networks must know "v"'),
        (lambda: inward(PENDULUM, Yielding(element("K*x", K=1.0))), "an element must be in admittance form; convert"),
        (lambda: in_parallel(PNEUMATIC, replace(PNEUMATIC, domain={"x": (4, 5)})), "hold for no x in common"),
        (
            lambda: in_parallel(PNEUMATIC, element(Operator.polynomial(0.0, 0.0, 0.0, 1.0))),
            "answers to derivative 3 of what goes in",
        ),
        (
            lambda: in_parallel(series_elastic("K*dx"), HEAVY),
            "answers to derivative 2 of the source, where the command enters as a derivative",
        ),
    ],
)
def test_what_would_have_to_be_solved_is_one_sentence(ask, says):
    with pytest.raises(NoConversionError, match=says) as caught:
        ask()
    assert "\n" not in str(caught.value)
