"""A drive's loop around the shaft: run at its own period, with the velocity from two positions."""

from collections import deque
from collections.abc import Callable

from norton_drivers.servo import Servo
from norton_sim.firmware.context import DeviceContext
from norton_sim.plant import Machine, Plant

Cycle = Callable[[float, float], None]


class ShaftLoop:
    """Calls ``cycle(position_rad, velocity_rad_s)`` every ``period_s``, from the encoder's counts as they are; the
    velocity is that of positions as far apart as the servo's window."""

    def __init__(self, context: DeviceContext, machine: Machine, servo: Servo, period_s: float, cycle: Cycle) -> None:
        places = max(1, round(servo.window_s / period_s))
        self._plant: Plant = context.world.plant
        self._machine = machine
        self._places = deque([self._plant.encoder_position_rad(machine)] * (places + 1), maxlen=places + 1)
        self._window_s = places * period_s
        self._cycle = cycle
        context.cyclic(round(period_s * 1e9), self._run)

    def _run(self, _stamp_ns: int) -> None:
        position_rad, places = self._plant.encoder_position_rad(self._machine), self._places
        places.append(position_rad)
        self._cycle(position_rad, (position_rad - places[0]) / self._window_s)
