"""The simulated motion, against scipy's Radau and against closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.logs.steps import Axis, Inputs, Load, Loop, Motor, Table, simulate
from tests.bench.logs import machines
from tests.bench.logs.machines import FREE, fit_of

DT_S, COUNT = 1e-3, 3000
STEP_S = DT_S / 4
SPEED = 10.0 * np.geomspace(1e-7, 1.0, 400)
NOTHING = np.zeros(COUNT)
ON = np.ones(COUNT, dtype=bool)
OPEN = Loop(closed=False, proportional=0.0, derivative=0.0, limit=np.inf)
STILL = Inputs(DT_S * np.arange(COUNT), NOTHING, NOTHING, NOTHING + 1.0, ON, NOTHING)
FREE_PORT = Load(0.0)


def machine(damping: float = 0.0, coulomb: float = 0.0, backward: float | None = None) -> Axis:
    """With friction as a table; ``backward`` is the Coulomb friction against negative motion, where it differs."""
    sides = (coulomb, coulomb if backward is None else backward)
    braking = np.stack([damping * SPEED + side for side in sides])
    return Axis(inertia=0.05, motor=Motor(2.0), table=Table(SPEED, braking))


@pytest.mark.parametrize("closed", [False, True])
def test_smooth_motion_is_that_of_radau(closed: bool) -> None:
    time_s = DT_S * np.arange(COUNT)
    loop = Loop(closed=closed, proportional=3.0, derivative=0.2, limit=1.0)
    inputs = STILL._replace(command=np.sin(7 * time_s), goal=1.0 + np.sin(2 * time_s))

    def slope(t: float, state: np.ndarray) -> list[float]:
        q, v = state
        wished = 3.0 * (1.0 + np.sin(2 * t) - q) - 0.2 * v
        command = np.clip(wished, -1.0, 1.0) if closed else np.sin(7 * t)
        return [v, (2.0 * command - 0.3 * v - 0.4 * np.sin(q)) / 0.05]

    reference = solve_ivp(slope, (0, time_s[-1]), [0.1, 0.0], "Radau", time_s, rtol=1e-8, atol=1e-10).y[0]
    found = simulate(machine(damping=0.3), Load(0.0, 0.4), loop, inputs, 0.1, 0.0, STEP_S)
    # Goal and command are held for a sample, half of one late on average: 0.5 ms of a velocity of some rad/s.
    assert np.max(np.abs(found - reference)) < 5e-3


def test_a_sampled_law_holds_its_command_from_instant_to_instant() -> None:
    """A free mass every 0.1 s: between two instants its exertion is constant, so that the motion is known exactly."""
    time_s = 0.1 * np.arange(20)
    none = np.zeros(time_s.size)
    loop = Loop(closed=True, proportional=0.5, derivative=0.1, limit=0.3, sampled=True)
    inputs = Inputs(time_s, none + 1.0, none, none + 1.0, none == 0.0, none)
    expected, q, v = [], 0.0, 0.0
    for _ in time_s:
        expected.append(q)
        acceleration = 2.0 * min(max(0.5 * (1.0 - q) - 0.1 * v, -0.3), 0.3) / 0.05
        q, v = q + 0.1 * v + 0.5 * 0.1**2 * acceleration, v + 0.1 * acceleration
    found = simulate(machine(), FREE_PORT, loop, inputs, 0.0, 0.0, STEP_S)
    # Even no friction holds for the rest of a step in which the motion turns round.
    np.testing.assert_allclose(found, expected, atol=1e-4)
    at_once = simulate(machine(), FREE_PORT, loop._replace(sampled=False), inputs, 0.0, 0.0, STEP_S)
    assert np.max(np.abs(at_once - expected)) > 0.05


def test_coulomb_friction_stops_where_the_energy_is_spent() -> None:
    found = simulate(machine(coulomb=0.4), FREE_PORT, OPEN, STILL, 0.0, 2.0, STEP_S)
    assert found[-1] == pytest.approx(0.05 * 2.0**2 / (2 * 0.4), rel=2e-3)
    assert np.ptp(found[1000:]) == 0.0


@pytest.mark.parametrize(("push", "moves"), [(0.19, 0), (0.21, 1), (-0.29, 0), (-0.31, -1)])
def test_it_sticks_up_to_the_coulomb_friction_of_either_side(push: float, moves: int) -> None:
    inputs = STILL._replace(command=NOTHING + push)
    found = simulate(machine(coulomb=0.4, backward=0.6), FREE_PORT, OPEN, inputs, 0.0, 0.0, STEP_S)
    assert np.sign(found[-1]) == moves


def test_a_drive_that_is_off_is_not_driven() -> None:
    inputs = STILL._replace(command=NOTHING + 1.0, enabled=~ON)
    assert simulate(machine(damping=0.1), FREE_PORT, OPEN, inputs, 0.5, 0.0, STEP_S)[-1] == 0.5


@pytest.mark.long
@pytest.mark.parametrize(("weight", "port"), [(0.3, 0.0), (0.0, 0.3), (0.2, 0.1)])
def test_a_slide_falls_and_the_port_takes_what_it_takes(weight: float, port: float) -> None:
    found = simulate(machine(), Load(0.05, weight=weight), OPEN, STILL._replace(port=NOTHING + port), 0, 0, STEP_S)
    assert found[-1] == pytest.approx(-0.5 * 0.3 / (0.05 + 0.05) * STILL.time_s[-1] ** 2, rel=1e-9)


def test_a_tooth_holds_the_shaft_beside_it() -> None:
    """From rest near a stable tooth of 0.5 N·m, 4 a turn, without friction: a linear oscillator."""
    axis = machine()._replace(cogging=(0.5, 0.0), cogging_wave_number=4.0)
    found = simulate(axis, FREE_PORT, OPEN, STILL, 1e-3, 0.0, STEP_S)
    rate = np.sqrt(4 * 0.5 / 0.05)
    np.testing.assert_allclose(found, 1e-3 * np.cos(rate * STILL.time_s), atol=3e-5)


def in_loop() -> dict[str, np.ndarray]:
    """What the compiled loop does under a moving goal, logged."""
    time_s = 1e-3 * np.arange(15000)
    goal = np.sin(2.1 * time_s) + 0.5 * np.sin(5.3 * time_s)
    loop = Loop(closed=True, proportional=30.0, derivative=1.0, limit=6.0)
    ones, zeros = np.ones(time_s.size), np.zeros(time_s.size)
    inputs = Inputs(time_s, goal, zeros, ones, ones > 0.0, zeros)
    position = simulate(machine(damping=0.3, coulomb=0.4), FREE_PORT, loop, inputs, 0.0, 0.0, STEP_S)
    velocity = np.gradient(position, 1e-3)
    command = np.clip(30.0 * (goal - position) - velocity, -6.0, 6.0)
    return {"t": time_s, "q": position, "goal": goal, "u": command}


def test_the_loop_of_the_map_gives_the_logged_motion_again(tmp_path: Path) -> None:
    text = FREE.replace("command =", 'goal = { name = "goal", unit = "rad" }\ncommand =')
    text += '[loop]\nproportional = "30 A/rad"\nderivative = "1 A*s/rad"\nlimit = "6 A"\n'
    fit = fit_of(tmp_path, in_loop(), text, test="10: s")
    for side in (fit.train, fit.test):
        assert side.motion is not None
        assert side.motion.relative < 0.01


def test_without_a_loop_the_logged_command_drives(tmp_path: Path) -> None:
    short = replace(machines.Machine(), noise=1e-4, duration_s=6.0)
    fit = fit_of(tmp_path, short.log())
    assert fit.train.motion is not None
    assert fit.train.motion.relative < 0.1


def test_friction_that_remembers_is_not_simulated(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, machines.Machine(duration_s=8.0).log(), model="dahl")
    assert fit.train.motion is None
