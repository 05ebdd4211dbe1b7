"""The simulated motion, against scipy's Radau and against closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench.logs.motion_steps import Inputs, Law, Machine, simulate
from tests.bench.logs import machines
from tests.bench.logs.machines import FREE, fit_of

DT_S, COUNT = 1e-3, 3000
SPEED = 10.0 * np.geomspace(1e-7, 1.0, 400)
NOTHING = np.zeros(COUNT)
OPEN = Law(closed=False, proportional=0.0, derivative=0.0, limit=np.inf)
STILL = Inputs(NOTHING, NOTHING, NOTHING + 1.0, NOTHING, NOTHING)


def machine(damping: float = 0.0, coulomb: float = 0.0, gravity: float = 0.0) -> Machine:
    braking = damping * SPEED + coulomb
    return Machine(
        inertia=0.05,
        gain=2.0,
        speed=SPEED,
        braking=np.stack([braking, braking]),
        weight=0.0,
        gravity=np.array([gravity, 0.0]),
        cogging=np.zeros(2),
        cogging_wave_number=0.0,
    )


@pytest.mark.parametrize("closed", [False, True])
def test_smooth_motion_is_that_of_radau(closed: bool) -> None:
    time_s = DT_S * np.arange(COUNT)
    law = Law(closed=closed, proportional=3.0, derivative=0.2, limit=1.0)
    inputs = STILL._replace(command=np.sin(7 * time_s), goal=1.0 + np.sin(2 * time_s))

    def slope(t: float, state: np.ndarray) -> list[float]:
        q, v = state
        wished = 3.0 * (1.0 + np.sin(2 * t) - q) - 0.2 * v
        command = np.clip(wished, -1.0, 1.0) if closed else np.sin(7 * t)
        return [v, (2.0 * command - 0.3 * v - 0.4 * np.sin(q)) / 0.05]

    reference = solve_ivp(slope, (0, time_s[-1]), [0.1, 0.0], "Radau", time_s, rtol=1e-8, atol=1e-10).y[0]
    found = simulate(machine(damping=0.3, gravity=0.4), law, inputs, 0.1, 0.0, DT_S)
    # The command is held for a sample, half of one late on average: 0.5 ms of a velocity of some rad/s.
    assert np.max(np.abs(found - reference)) < 5e-3


def test_coulomb_friction_stops_where_the_energy_is_spent() -> None:
    found = simulate(machine(coulomb=0.4), OPEN, STILL, 0.0, 2.0, DT_S)
    assert found[-1] == pytest.approx(0.05 * 2.0**2 / (2 * 0.4), rel=2e-3)
    assert np.ptp(found[1000:]) == 0.0


@pytest.mark.parametrize(("push", "moves"), [(0.19, False), (0.21, True)])
def test_it_sticks_up_to_the_coulomb_friction(push: float, moves: bool) -> None:
    inputs = STILL._replace(command=NOTHING + push)
    assert bool(simulate(machine(coulomb=0.4), OPEN, inputs, 0.0, 0.0, DT_S)[-1] > 0.0) is moves


def test_a_drive_that_is_off_is_not_driven() -> None:
    inputs = STILL._replace(command=NOTHING + 1.0, supply=NOTHING)
    assert simulate(machine(damping=0.1), OPEN, inputs, 0.5, 0.0, DT_S)[-1] == 0.5


def in_loop() -> dict[str, np.ndarray]:
    """What the compiled loop does under a moving goal, logged."""
    time_s = 1e-3 * np.arange(15000)
    goal = np.sin(2.1 * time_s) + 0.5 * np.sin(5.3 * time_s)
    law = Law(closed=True, proportional=30.0, derivative=1.0, limit=6.0)
    ones, zeros = np.ones(time_s.size), np.zeros(time_s.size)
    inputs = Inputs(zeros, goal, ones, zeros, zeros)
    position = simulate(machine(damping=0.3, coulomb=0.4), law, inputs, 0.0, 0.0, 1e-3)
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
