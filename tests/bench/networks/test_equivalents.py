"""The other types and forms of nonlinear networks, against scipy's integrators and closed forms; and what has none."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from norton_bench.errors import UsageError
from norton_bench.networks.algebra import Carried, element, in_parallel, outward
from norton_bench.networks.equivalents import with_port_source
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import converted, coupled, exertion, motion
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.motor import as_equations
from norton_bench.networks.motor_read import motor_of
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.settled import static_exertion, static_source
from tests.bench.networks.some import (
    ALL_TERMS,
    JOINTS,
    MOTOR,
    MOTORS,
    PENDULUM,
    PNEUMATIC,
    SPRING,
    VARIABLE,
    series_elastic,
)

TICK_S = 1e-3
SHAPES = tuple(product(Kind, Form))
EVERY_MOTOR = {"plain": MOTOR, **MOTORS, "all": ALL_TERMS, **JOINTS}


def shapes_of(motor):
    for shape in SHAPES:
        try:
            yield as_equations(motor, *shape)
        except NoConversionError:
            assert motor.joint is not None


@pytest.mark.parametrize("name", EVERY_MOTOR)
def test_a_motor_that_was_written_as_equations_is_read_back(name, tmp_path):
    motor = EVERY_MOTOR[name]
    for network in shapes_of(motor):
        save(network, tmp_path / "motor.json")
        found = converted(load(tmp_path / "motor.json"), Kind.NORTON, Form.IMPEDANCE)
        if (network.kind, network.form) == (Kind.NORTON, Form.IMPEDANCE):
            found = motor_of(network)
        assert found.terms == motor.terms
        assert found.values() == pytest.approx(motor.values(), rel=1e-12)


def test_what_only_looks_like_a_motor_is_none():
    """One sign, one exponent or a domain more, and it is another network, which converts by its equations."""
    written = as_equations(MOTOR, Kind.THEVENIN, Form.ADMITTANCE)
    text = written.connection.rates["phi_r"]
    other = replace(written.connection, rates={**written.connection.rates, "phi_r": text.replace("- s*", "- 2*s*")})
    assert motor_of(replace(written, connection=other)) is None
    assert motor_of(replace(written, domain={"x": (-1.0, 1.0)})) is None
    assert motor_of(PENDULUM) is None
    assert motor_of(written) == MOTOR


@pytest.mark.parametrize("shape", SHAPES, ids=lambda each: each.value if hasattr(each, "value") else "")
def test_the_pendulum_moves_a_load_alike_in_every_shape(shape):
    """Fig. 1, an exertion source in admittance form: its three equivalents are exact. Radau's, with a load."""
    command = np.where(np.arange(800) < 400, 0.5, -0.3)
    network = converted(PENDULUM, *shape)
    assert (network.kind, network.form) == shape
    found = coupled(network, command, Load(0.02, 0.05, 0.4), TICK_S).position_rad

    def rate(t, state):
        c = 0.5 if t < 0.4 else -0.3
        return [state[1], (c - 0.15 * state[1] - 0.8 * np.sin(state[0]) - 0.4 * state[0]) / 0.07]

    time_s = np.arange(800) * TICK_S
    expected = solve_ivp(rate, (0, 0.8), [0, 0], "Radau", rtol=1e-10, atol=1e-12, t_eval=time_s, max_step=2e-3).y[0]
    assert found == pytest.approx(expected, abs=1e-6)


ARM = outward(
    replace(series_elastic("K*dx + B*dv"), domain={"x": (-2.0, 2.0), "c": (-0.5, 0.5)}),
    Carried(element("J*a + G*sin(x) + D*v*abs(v) + s*(x - 0.1)", J=0.02, G=0.9, D=0.03, s=0.5)),
)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda each: each.value if hasattr(each, "value") else "")
def test_an_arm_moves_a_load_alike_in_every_shape(shape):
    """Z_A with K and B, Z_G with inertia, gravity and drag (section IV.C): scipy's, from each type and form."""
    command = wave_of_commands()
    found = coupled(converted(ARM, *shape), command, Load(0.03), TICK_S).position_rad
    assert found == pytest.approx(arm_by_scipy(), abs=1e-6)


def wave_of_commands():
    return 0.4 * np.sign(np.sin(2 * np.pi * 1.7 * np.arange(700) * TICK_S + 0.1))


@cache
def arm_by_scipy():
    """Where it is at every tick, from equations written by hand."""

    def rate(_, state, c):
        x, v, place = state
        pull = 4.0 * (place - x) + 0.1 * (20.0 * (c - place) - v)
        return [v, (pull - 0.9 * np.sin(x) - 0.03 * v * abs(v) - 0.5 * (x - 0.1)) / 0.05, 20.0 * (c - place)]

    rows, state = [], np.zeros(3)
    for c in wave_of_commands():
        rows.append(state[0])
        state = solve_ivp(rate, (0, TICK_S), state, "LSODA", rtol=1e-10, atol=1e-13, args=(c,)).y[:, -1]
    return np.array(rows)


def test_the_port_source_is_the_motion_of_the_free_port():
    """Z_P(θ_N, θ) is zero at its own source, and exerts what the arm exerts under any other motion."""
    whole = with_port_source(ARM)
    assert isinstance(whole, NonlinearNetwork)
    assert (whole.kind, whole.form) == (Kind.NORTON, Form.IMPEDANCE)
    command = np.where(np.arange(600) < 300, 0.4, -0.2)
    time_s = np.arange(600) * TICK_S
    port = Motion(0.3 * np.sin(5 * time_s), 1.5 * np.cos(5 * time_s), -7.5 * np.sin(5 * time_s))
    inner, outer = (exertion(each, command, port, TICK_S) for each in (ARM, whole))
    assert outer == pytest.approx(inner, abs=2e-6 * np.ptp(inner))
    free = coupled(whole, command, Load(), TICK_S)
    assert np.abs(free.exertion_nm).max() < 1e-9
    assert free.position_rad == pytest.approx(coupled(ARM, command, Load(), TICK_S).position_rad, abs=1e-6)


POSITIONED = replace(
    series_elastic("K*dx + 9*dx**3"),
    source=Equations(("c",), {"x_N": "c", "v_N": "0"}),
    domain={"x": (-1.5, 1.5), "x_N": (-0.6, 0.6), "c": (-0.5, 0.5)},
)
STATIC_ARM = with_port_source(outward(POSITIONED, Carried(element("G*sin(x) + S*x", G=0.5, S=1.0))))


@given(st.floats(-0.45, 0.45), st.floats(-0.9, 0.9))
@settings(max_examples=15)
def test_a_static_arm_is_the_papers(c, x):
    """Section IV.C: θ̂_N = θ_N + Z_A⁻¹(Z_G(θ_N)), and τ = Z_A(θ̂_N − θ) − Z_G(θ); the inverse by scipy's brentq."""

    def z_a(away):
        return 4.0 * away + 9.0 * away**3

    def z_g(place):
        return 0.5 * np.sin(place) + place

    rests = brentq(lambda place: z_a(c - place) - z_g(place), -1.5, 1.5, xtol=1e-12)
    assert c == pytest.approx(rests + brentq(lambda away: z_a(away) - z_g(rests), -2.0, 2.0, xtol=1e-12), abs=1e-9)
    assert static_source(STATIC_ARM, [c]).value[0] == pytest.approx(rests, abs=1e-5)
    assert static_exertion(STATIC_ARM, {"c": c}, [x])[0] == pytest.approx(z_a(c - x) - z_g(x), abs=1e-4)


@given(st.floats(0.1, 2.0), st.floats(0.05, 2.95))
@settings(max_examples=15)
def test_the_muscle_has_a_source_of_exertion_that_is_blocked_at_zero(c, x):
    """(π − θ)² c − K θ: at θ = 0 this is π² c, from which the connection knows c again."""
    found = muscle(Kind.THEVENIN, Form.IMPEDANCE)
    assert static_source(found, [c]).value[0] == pytest.approx(np.pi**2 * c)
    assert static_exertion(found, {"c": c}, [x])[0] == pytest.approx((np.pi - x) ** 2 * c - SPRING * x, abs=2e-4)


def muscle(*shape):
    return converted(PNEUMATIC, *shape)


@pytest.mark.long
def test_tables_are_as_near_as_they_say():
    """Motion of the muscle for an exertion, by table and in closed form; the error is that of the provenance."""
    for kind in Kind:
        network = muscle(kind, Form.ADMITTANCE)
        low, high = network.domain["f"]
        said = max(float(text.split()[4]) for name, text in network.provenance.items() if name.startswith("table "))
        worst = 0.0
        for c in np.linspace(0.1, 2.0, 9):
            pushes = np.linspace(low, high, 83)
            found = [motion(network, [c], [push], TICK_S)[0] for push in pushes]
            # c θ² − (2πc + K) θ + π² c − f = 0
            half = 2 * np.pi * c + SPRING
            roots = (half - np.sqrt(half**2 - 4 * c * (np.pi**2 * c - pushes))) / (2 * c)
            worst = max(worst, float(np.abs(found - roots).max()))
        assert worst < 2.0 * said < 1e-4


def test_impedance_and_admittance_of_a_spring_that_stiffens_undo_each_other():
    spring = series_elastic("K*dx + 9*dx**3")
    there = converted(spring, Kind.NORTON, Form.ADMITTANCE)
    assert there.joined_linearly
    command, pushed = np.full(200, 0.3), np.linspace(-60.0, 60.0, 200)
    moved = motion(there, command, pushed, TICK_S)
    placed = Motion(moved, np.zeros(200), np.zeros(200))
    assert exertion(spring, command, placed, TICK_S) == pytest.approx(pushed, abs=1e-3)
    back = converted(there, Kind.NORTON, Form.IMPEDANCE)
    assert exertion(back, command, placed, TICK_S) == pytest.approx(pushed, abs=2e-3)


def test_a_converted_network_takes_the_steps_that_it_needs():
    """A spring of 4 N m/rad on a damper of 1e-4 N m s/rad: as an admittance it follows within 25 µs."""
    soft = series_elastic("K*dx + B*dv")
    connection = replace(soft.connection, parameters={"K": 4.0, "B": 1e-4})
    network = converted(replace(soft, connection=connection), Kind.NORTON, Form.ADMITTANCE)
    assert network.step_s == pytest.approx(0.5 * 1e-4 / 4.0)
    assert motion(network, np.zeros(20), np.full(20, 0.4), TICK_S)[5:] == pytest.approx(-0.1, abs=1e-6)


@pytest.mark.long
def test_two_motors_have_a_free_motion():
    """A Thévenin sum of two motors, which is no motor, as Norton's: its source is what the shaft does alone."""
    both = in_parallel(MOTOR, replace(MOTOR, inertia_kgm2=1e-4))
    norton = converted(both, Kind.NORTON, Form.IMPEDANCE)
    commands = np.column_stack([np.full(40, 0.06), np.full(40, 0.02)])
    found = coupled(norton, commands, Load(), TICK_S)
    assert np.abs(found.exertion_nm).max() < 1e-9
    assert found.position_rad == pytest.approx(coupled(both, commands, Load(), TICK_S).position_rad, abs=1e-7)
    loaded = [coupled(each, commands, Load(2e-4, 1e-3), TICK_S).position_rad for each in (both, norton)]
    assert loaded[1] == pytest.approx(loaded[0], abs=1e-6)


def network_of(text, **more):
    return series_elastic(text, **more)


TURNING = network_of("K*sin(3*dx)")
DEADBAND = network_of("K*(dx - min(max(dx, -play), play))")


@pytest.mark.parametrize(
    ("network", "shape", "says"),
    [
        (
            TURNING,
            (Kind.NORTON, Form.ADMITTANCE),
            r"the exertion turns at dx = -1\.57, so it has no inverse there; nar",
        ),
        (
            TURNING,
            (Kind.THEVENIN, Form.IMPEDANCE),
            r"blocked port turns at x_N = -0\.523\d, so it has no inverse there",
        ),
        (DEADBAND, (Kind.NORTON, Form.ADMITTANCE), r"the exertion stays at dx = -0\.0\d+, so it has no inverse there"),
        (replace(TURNING, domain={}), (Kind.NORTON, Form.ADMITTANCE), 'declare the domain of "x": what has no closed'),
        (VARIABLE, (Kind.THEVENIN, Form.IMPEDANCE), 'obeys no superposition.* depends on "q" too'),
        (network_of("K*dx + B*dv**3"), (Kind.NORTON, Form.ADMITTANCE), "are not linear in velocity"),
        (network_of("K*dx + 0*B*dv"), (Kind.NORTON, Form.ADMITTANCE), "is zero, so they have no solution for it"),
        (network_of("K"), (Kind.NORTON, Form.ADMITTANCE), "does not depend on its motion"),
        (
            replace(PENDULUM, connection=replace(PENDULUM.connection, outputs={"x": "theta + omega"})),
            (Kind.THEVENIN, Form.IMPEDANCE),
            "does not follow from the exertion by one rate or two",
        ),
        (
            replace(network_of("K*log(dx - 1)"), domain={"x": (-1.0, 1.0)}),
            (Kind.NORTON, Form.ADMITTANCE),
            "the exertion is not finite at dx = -2",
        ),
        (
            replace(PNEUMATIC, domain={**PNEUMATIC.domain, "x": (0.0, 0.05)}),
            (Kind.NORTON, Form.ADMITTANCE),
            "no value of the exertion is reached within the domain of x at every source",
        ),
    ],
)
def test_what_has_no_equivalent_is_one_sentence_that_says_where(network, shape, says):
    with pytest.raises(NoConversionError, match=says) as caught:
        converted(network, *shape)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, UsageError)
