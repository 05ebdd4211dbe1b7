"""Moves to a place of the actuator's shaft, for plants that have places: a muscle, a pendulum."""

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.waves import hold, imposed, pushed, ramp, sweep
from norton_bench.records import Measured
from norton_bench.segments import Segment, Use


def place_rad(measured: Measured) -> float:
    """Where the actuator's shaft stands at the end."""
    return float(measured.motion["position_rad"][-1])


def swept(procedure: str, name: str, command: float, distance_rad: float, speed_rad_s: float, tick_s: float) -> Segment:
    """A sweep as imposed motion, under one command."""
    motion = sweep(distance_rad, speed_rad_s, tick_s)
    return imposed(procedure, name, Use.PREPARE, np.full(len(motion.velocity_rad_s), command), motion)


def let_go(
    procedure: str, name: str, command: float, before: Measured, easing_s: float, rest_s: float, tick_s: float
) -> Segment:
    """The load's torque goes from what it was slowly to none; the shaft follows as far as friction lets it."""
    held_nm = float(np.mean(before.ticks["load_torque_nm"][-round(0.1 / tick_s) :]))
    torque_nm: FloatArray = np.concatenate([ramp(held_nm, 0.0, easing_s, tick_s), hold(0.0, rest_s, tick_s)])
    return pushed(procedure, name, Use.PREPARE, torque_nm, np.full(len(torque_nm), command))
