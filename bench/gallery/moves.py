"""Moves to a place of the actuator's shaft, for plants that have places: a muscle, a pendulum."""

import numpy as np

from bench.procedures.makers import imposed, pushed
from bench.procedures.waves import Motion, from_velocity, hold, ramp
from bench.records import Measured
from bench.segments import FloatArray, Segment, Use

EDGE_S = 0.2  # in which a sweep takes up and gives up its speed


def place_rad(measured: Measured) -> float:
    """Where the actuator's shaft stands at the end."""
    return float(measured.motion["position_rad"][-1])


def sweep(distance_rad: float, speed_rad_s: float, tick_s: float) -> Motion:
    """Over so much at a constant speed, with a little before and after to take it up and give it up."""
    speed = float(np.copysign(speed_rad_s, distance_rad))
    steady = hold(speed, max(abs(distance_rad) / speed_rad_s - EDGE_S, EDGE_S), tick_s)
    edges = ramp(0.0, speed, EDGE_S, tick_s), ramp(speed, 0.0, EDGE_S, tick_s)
    return from_velocity(np.concatenate([edges[0], steady, edges[1]]), tick_s)


def swept(procedure: str, name: str, command: float, distance_rad: float, speed_rad_s: float, tick_s: float) -> Segment:
    """The same as imposed motion under one command."""
    motion = sweep(distance_rad, speed_rad_s, tick_s)
    return imposed(procedure, name, Use.PREPARE, np.full(len(motion.velocity_rad_s), command), motion)


def let_go(
    procedure: str, name: str, command: float, before: Measured, easing_s: float, rest_s: float, tick_s: float
) -> Segment:
    """The load's torque goes from what it was slowly to none; the shaft follows as far as friction lets it."""
    held_nm = float(np.mean(before.ticks["load_torque_nm"][-round(0.1 / tick_s) :]))
    torque_nm: FloatArray = np.concatenate([ramp(held_nm, 0.0, easing_s, tick_s), hold(0.0, rest_s, tick_s)])
    return pushed(procedure, name, Use.PREPARE, torque_nm, np.full(len(torque_nm), command))
