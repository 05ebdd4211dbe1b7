"""A drive's own position loop, from the encoder's counts."""

from collections import deque

from norton_drivers.codecs.ranges import Goal
from norton_sim.plant import Machine, Plant


class PositionLoop:
    """Works out a torque once a period; the velocity is that of two positions ``window_s`` apart."""

    def __init__(self, plant: Plant, machine: Machine, period_s: float, window_s: float) -> None:
        self._plant, self._machine = plant, machine
        apart = max(1, round(window_s / period_s))
        self._places = deque([plant.encoder_position_rad(machine)] * (apart + 1), maxlen=apart + 1)
        self._window_s = apart * period_s

    def torque_nm(self, goal: Goal, zero_rad: float) -> float:
        """Of one cycle, with what was commanded and where zero was set."""
        position_rad = self._plant.encoder_position_rad(self._machine)
        self._places.append(position_rad)
        velocity_rad_s = (position_rad - self._places[0]) / self._window_s
        return (
            goal.stiffness_nm_rad * (goal.position_rad - (position_rad - zero_rad))
            + goal.damping_nms_rad * (goal.velocity_rad_s - velocity_rad_s)
            + goal.torque_nm
        )
