"""The simulated servo against scipy's integrators and against statics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from norton_bench.arrays import FloatArray
from norton_bench.logs.servo import ServoLog, simulate_motion
from norton_bench.logs.steps import Inputs, Load, Loop, Motor, electric
from tests.bench.logs.servos import TICK_RAD, TRUTH, pendulum

SMOOTH = {name: TRUTH[name] for name in ("torque_constant", "winding_resistance", "inertia", "viscous_damping")}


def lifted(command: float, seconds: float = 1.0) -> ServoLog:
    """A pendulum that a constant share of the supply lifts or holds, from rest at 0.4 rad."""
    t = np.arange(0.0, seconds, 0.005)
    none = np.zeros(t.size)
    return ServoLog(
        inputs=Inputs(t, none, np.full(t.size, command), np.full(t.size, 7.0), np.ones(t.size, dtype=bool), none),
        load=Load(0.005, 0.5, 0.0),
        loop=Loop(closed=False, proportional=0.0, derivative=0.0, limit=np.inf, switched=True),
        position=np.full(t.size, 0.4),
        start_velocity=0.0,
    )


def reference(log: ServoLog, values: dict[str, float]) -> FloatArray:
    """LSODA on the equations as the module writes them, with the acceleration solved for by bisection."""
    constant, inertia = values["torque_constant"], values["inertia"]
    get = values.get

    def acceleration(q: float, v: float, k: int) -> float:
        loop = log.loop
        command = log.inputs.command[k]
        if loop.closed:
            command = np.clip(loop.proportional * (log.inputs.goal[k] - q), -loop.limit, loop.limit)
        resistance = values["winding_resistance"] + get("source_resistance", 0.0) * abs(command)
        motor = constant / resistance * (command * log.inputs.supply[k] - constant * v) * log.inputs.enabled[k]
        pull = log.load.gravity * np.sin(q - log.load.gravity_zero)
        left = np.exp(-((v / get("stribeck_velocity", 1.0)) ** 2))

        def excess(a: float) -> float:
            load = log.load.inertia * a + pull
            slope = get("load_coefficient", 0.0) + get("load_stiction_coefficient", 0.0) * left
            friction = get("coulomb_torque", 0.0) + get("stribeck_torque", 0.0) * left + abs(load) * slope
            braking = get("viscous_damping", 0.0) * v + np.sign(v) * friction
            return float(motor - braking - get("offset", 0.0) - load - inertia * a)

        return float(brentq(excess, -1e5, 1e5, xtol=1e-12))

    path = [float(log.position[0])]
    state = np.array([path[0], log.start_velocity])
    times = log.inputs.time_s
    for k in range(times.size - 1):
        made = solve_ivp(
            lambda _, x, k=k: [x[1], acceleration(x[0], x[1], k)],
            (times[k], times[k + 1]),
            state,
            method="LSODA",
            rtol=1e-8,
            atol=1e-10,
        )
        state = made.y[:, -1]
        path.append(float(state[0]))
    return np.array(path)


def test_swings_in_its_loop_and_falls_as_lsoda_says_where_friction_is_smooth() -> None:
    log = pendulum(0.5, seconds=2.0, drop_s=1.2)
    values = {**SMOOTH, "source_resistance": 1.5}
    simulated = simulate_motion(log, values)
    expected = reference(log, values)
    assert np.ptp(expected) > 0.5
    np.testing.assert_allclose(simulated, expected, atol=2 * TICK_RAD)


def test_error_falls_with_the_step() -> None:
    log = pendulum(0.5, seconds=1.0)
    expected = reference(log, SMOOTH)
    coarse, fine = (np.max(np.abs(simulate_motion(log, SMOOTH, step) - expected)) for step in (1e-3, 2.5e-4))
    assert fine < 0.35 * coarse


@pytest.mark.parametrize("gravity_zero", [0.0, 1.5])
def test_slides_one_way_as_lsoda_says_with_every_friction(gravity_zero: float) -> None:
    """The load hangs back, or (from 1.5 rad) drives at first."""
    log = lifted(0.75, seconds=0.4)
    log = replace(log, load=Load(0.005, 0.2, gravity_zero), start_velocity=0.5)
    values = {**TRUTH, "stribeck_torque": 0.01, "load_stiction_coefficient": 0.1, "stribeck_velocity": 0.8}
    expected = reference(log, values)
    assert np.all(np.diff(expected) > 0)
    np.testing.assert_allclose(simulate_motion(log, values), expected, atol=2 * TICK_RAD)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_holds_up_to_the_limit_of_friction_and_no_further(side: float) -> None:
    """At rest: |motor − offset − gravity| against Fc + Fs + |gravity| (μ + μs)."""
    values = {**TRUTH, "stribeck_torque": 0.005, "load_stiction_coefficient": 0.1}
    pull = 0.5 * np.sin(0.4)
    limit = 0.012 + 0.005 + pull * (0.25 + 0.1)
    wanted = 0.006 + pull + side * limit

    def share(exertion: float) -> float:
        """exertion = Km U x / (R + Rs |x|), solved for x."""
        return exertion * 3.5 / (0.4 * 7.0 - 1.5 * abs(exertion))

    held = simulate_motion(lifted(share(wanted - side * 1e-4)), values)
    np.testing.assert_array_equal(held, 0.4)
    moved = simulate_motion(lifted(share(wanted + side * 1e-3)), values)
    assert side * (moved[-1] - 0.4) > TICK_RAD


def test_the_source_weakens_the_motor_while_it_is_connected() -> None:
    motor = Motor(0.4, 3.5, 1.5)
    loop = Loop(True, 1.0, 0.0, 1.0, switched=True)
    assert electric(motor, loop, -0.5, 7.0) == pytest.approx((-0.4 * 3.5 / 4.25, 0.4**2 / 4.25))
    assert electric(motor, loop._replace(switched=False), -3.5, 1.0) == pytest.approx((-0.4, 0.4**2 / 3.5))


def test_a_motor_on_a_current_has_no_back_emf() -> None:
    motor = Motor(0.4)
    assert electric(motor, Loop(False, 0.0, 0.0, 1.0), 2.0, 1.0) == pytest.approx((0.8, 0.0))


def test_friction_brings_a_switched_off_pendulum_to_rest_beside_the_bottom() -> None:
    log = pendulum(0.5, seconds=8.0, drop_s=1.0)
    simulated = simulate_motion(log, TRUTH)
    np.testing.assert_array_equal(simulated[-100:], simulated[-1])
    # It rests where gravity and offset are within friction's reach.
    pull = 0.5 * np.sin(simulated[-1])
    assert abs(pull + 0.006) <= 0.012 + 0.25 * abs(pull) + 1e-9
