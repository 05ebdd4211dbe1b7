"""Servos whose truth is known, on a pendulum, in their own loop."""

import numpy as np

from norton_bench.logs.servo import ServoLog, simulate_motion
from norton_bench.logs.steps import Inputs, Load, Loop

TRUTH = {
    "torque_constant": 0.4,
    "winding_resistance": 3.5,
    "source_resistance": 1.5,
    "inertia": 0.002,
    "viscous_damping": 0.004,
    "coulomb_torque": 0.012,
    "offset": 0.006,
    "load_coefficient": 0.25,
}
TICK_RAD = 2 * np.pi / 4096
PERIOD_S = 0.005


def pendulum(proportional: float, *, seconds: float = 3.0, phase: float = 0.0, drop_s: float = np.inf) -> ServoLog:
    """What acts on it; its position is still to be simulated. The drive goes off after ``drop_s``."""
    t = np.arange(0.0, seconds, PERIOD_S)
    goal = np.sin(1.7 * t**1.5 + phase) - np.sin(phase) + 0.5 * np.sin(3.1 * t)
    return ServoLog(
        inputs=Inputs(t, goal, np.zeros(t.size), np.full(t.size, 7.0), t < drop_s, np.zeros(t.size)),
        load=Load(inertia=0.005, gravity=0.5, gravity_zero=0.0),
        loop=Loop(closed=True, proportional=proportional, derivative=0.0, limit=1.0, switched=True),
        position=np.zeros(t.size),
        start_velocity=0.0,
    )


def measured(log: ServoLog, truth: dict[str, float]) -> ServoLog:
    """The position that comes of it, in steps much finer than the fit's, to the encoder's tick."""
    position = simulate_motion(log, truth, longest_s=5e-5)
    return ServoLog(log.inputs, log.load, log.loop, TICK_RAD * np.round(position / TICK_RAD), 0.0)
