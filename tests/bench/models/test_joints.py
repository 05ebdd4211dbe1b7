"""A motor behind a joint: its compiled steps against scipy's Radau on the plain equations, its source, its files."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from norton_bench.models.joint_steps import joint_torque
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import NetworkTerm, joint_values, row_of

MOTOR = NortonNetwork(0.9, 600.0, 4e-5, 1e-3, 0.02, 10.0, 0.01, "N*m")
SPRING = replace(MOTOR, terms=(NetworkTerm("compliance", (10.0, 4e-3, 1e-5)),))
PLAY = replace(MOTOR, terms=(NetworkTerm("backlash", (40.0, 0.02, 1e-5, 4e-3)),))
BOTH = {"compliance": SPRING, "backlash": PLAY}
TICK_S, FINE_S = 1e-3, 1e-4


def held(name, deflection, rate):
    """τ_j [N m], as docs/networks.md writes it."""
    if name == "compliance":
        return 10.0 * deflection + 4e-3 * rate
    beyond = deflection - np.sign(deflection) * 2e-3
    return 40.0 * beyond + 0.02 * rate if abs(deflection) > 2e-3 else 0.0


def motor_rates(drive, omega, phi, joint_nm):
    """Of the motor's velocity and its contact."""
    slip = omega - 500.0 * abs(omega) * phi
    return (drive - 1e-3 * omega - 10.0 * phi - 0.01 * slip - joint_nm) / 4e-5, slip


@pytest.mark.parametrize("name", BOTH)
def test_free_motion_is_that_of_two_bodies(name):
    port = 2e-3
    command = 0.07 * np.sin(2 * np.pi * 9 * np.arange(120) * TICK_S)
    position, velocity, acceleration = BOTH[name].free_motion(command, TICK_S, port_torque_nm=port)
    # The joint holds the port's torque from the beginning on.
    ahead = port / 10.0 if name == "compliance" else port / 40.0 + 2e-3
    state, states = np.array([0.0, 0.0, ahead, 0.0, 0.0, 0.0]), []

    for asked in command:
        states.append(state)

        def rate(_, y, asked=asked):
            x, v, q, w, phi, drive = y
            joint_nm = held(name, q - x, w - v)
            turned, slip = motor_rates(drive, w, phi, joint_nm)
            return [v, (joint_nm - port) / 1e-5, w, turned, slip, 600.0 * (0.9 * asked - drive)]

        state = solve_ivp(rate, (0, TICK_S), state, method="Radau", rtol=1e-7, atol=1e-10).y[:, -1]
    expected = np.array(states)
    # A blow is met by steps of RATE_STEP: its instant is known to a part of them.
    share = 1e-4 if name == "compliance" else 5e-3
    assert np.max(np.abs(position - expected[:, 0])) < share * np.ptp(expected[:, 0])
    assert np.max(np.abs(velocity - expected[:, 1])) < share * np.ptp(expected[:, 1])
    stiff = BOTH[name].rigid.free_motion(command, TICK_S, port_torque_nm=port)[1]
    assert np.max(np.abs(velocity - stiff)) > 0.01 * np.ptp(stiff)
    assert acceleration.shape == (120,)


@pytest.mark.parametrize("name", BOTH)
def test_the_torque_is_that_of_a_motor_on_a_moving_end(name):
    time_s = np.arange(3000) * FINE_S

    def port(t):
        return 0.05 * (1 - np.cos(2 * np.pi * 6 * t)) + 0.002 * (1 - np.cos(2 * np.pi * 43 * t))

    def speed(t):
        return 0.05 * 2 * np.pi * 6 * np.sin(2 * np.pi * 6 * t) + 0.002 * 2 * np.pi * 43 * np.sin(2 * np.pi * 43 * t)

    command = np.where(time_s < 0.15, 0.05, -0.05)
    torque = BOTH[name].torque(command, port(time_s), FINE_S)

    def rate(t, y):
        q, w, phi, drive = y
        turned, slip = motor_rates(drive, w, phi, held(name, q - port(t), w - speed(t)))
        return [w, turned, slip, 600.0 * (0.9 * (0.05 if t < 0.15 else -0.05) - drive)]

    told = {"method": "Radau", "rtol": 1e-7, "atol": 1e-10, "max_step": 5e-4}
    before = solve_ivp(rate, (0, 0.15), np.zeros(4), t_eval=time_s[:1500], **told)
    after = solve_ivp(rate, (0.15, 0.3), before.y[:, -1], t_eval=time_s[1500:], **told)
    states = np.concatenate([before.y, after.y], axis=1)
    expected = [held(name, q - port(t), w - speed(t)) for t, q, w in zip(time_s, *states[:2], strict=True)]
    expected -= 1e-5 * np.gradient(speed(time_s), FINE_S)
    off = np.sqrt(np.mean((torque - expected)[5:-5] ** 2)) / np.std(expected)
    assert off < (2e-3 if name == "compliance" else 2e-2)


@pytest.mark.parametrize("name", BOTH)
def test_the_source_is_the_zero_of_the_impedance(name):
    """Section III: Z(x_N, x_N) = 0; with play, but for blows, whose instants both sample otherwise."""
    command = 0.06 * np.sin(2 * np.pi * 3 * np.arange(6000) * FINE_S)
    position = BOTH[name].free_motion(command, FINE_S)[0]
    torque = BOTH[name].torque(command, position, FINE_S)
    against = MOTOR.torque(np.zeros(6000), position, FINE_S)
    assert np.median(np.abs(torque)) < 0.01 * np.median(np.abs(against))


@pytest.mark.parametrize("name", BOTH)
def test_steady_sliding_and_thresholds_are_those_of_the_motor(name):
    network = BOTH[name]
    assert network.thresholds == MOTOR.thresholds
    for level in (-0.08, 0.05):
        velocity = network.free_motion(np.full(3000, level), TICK_S)[1]
        assert velocity[-1] == pytest.approx(float(MOTOR.source_velocity(level)), rel=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.floats(1.0, 500.0), st.floats(0.0, 0.05), st.floats(1e-7, 1e-3), st.floats(0.0, 0.05))
def test_no_joint_makes_the_steps_run_away(stiffness, damping, output, width):
    """Let go from a command, everything comes to rest: joint, contact and damping only take energy."""
    values = (stiffness, damping, output)
    term = NetworkTerm("backlash", (*values, width)) if width else NetworkTerm("compliance", values)
    command = np.concatenate([np.full(20, 0.1), np.zeros(380)])
    _, velocity, _ = replace(MOTOR, terms=(term,)).free_motion(command, TICK_S)
    assert np.max(np.abs(velocity)) < 0.1 * 0.9 / 1e-3
    assert np.max(np.abs(velocity[-5:])) < np.max(np.abs(velocity)) + 1e-9


def test_play_holds_nothing_and_then_as_a_spring_does():
    joint = joint_values(row_of(PLAY.relative_terms), 4e-5)
    assert joint == pytest.approx((40.0, 0.02, 1e-5, 2e-3))
    assert joint_torque(joint, 1.9e-3, 5.0) == 0.0
    assert joint_torque(joint, -3e-3, 0.0) == pytest.approx(-0.04)


def test_without_its_joint_the_output_turns_with_the_motor():
    assert SPRING.rigid == replace(MOTOR, inertia_kgm2=5e-5)
    assert MOTOR.rigid is MOTOR


@pytest.mark.parametrize("network", BOTH.values(), ids=BOTH)
def test_a_file_keeps_the_joint(network, tmp_path):
    network.save(tmp_path / "network.json")
    assert NortonNetwork.load(tmp_path / "network.json") == network
