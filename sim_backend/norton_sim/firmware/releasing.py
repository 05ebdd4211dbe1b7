"""An amplifier of VESC's kind: it obeys every current, and lets go of the motor where none comes or something is wrong.

Source: vedderb/bldc, timeout.c (looks every 10 ms; a brake current of zero releases the motor), motor/mc_interface.c (a
fault stops the motor; commands are then ignored for half a second, after which it has cleared itself),
motor/mcpwm_foc.c (released below the minimum current).
"""

from collections.abc import Callable

from norton_sim.firmware.context import DeviceContext, DriveFault, Heating
from norton_sim.plant import Machine

LOOK_PERIOD_NS = 10_000_000
FAULT_STOP_NS = 500_000_000
MOST_CURRENT_A = 60.0


class ReleasingAmplifier:
    """One motor's. ``fault`` is its code, 0 for none; ``faults`` has the codes. ``timeout_s`` is 0 for none;
    ``timed_out``: it has acted since the last command."""

    def __init__(
        self,
        context: DeviceContext,
        machine: Machine,
        faults: dict[DriveFault, int],
        *,
        minimum_current_a: float,
        timeout_s: float,
        per_ampere: float,
    ) -> None:
        self.fault = 0
        self.timed_out = False
        self.running = False
        self.heating = Heating()
        self.on_release: Callable[[], None] = lambda: None
        self._codes = faults
        self._minimum_current_a = minimum_current_a
        self.timeout_s = timeout_s
        self._per_ampere = per_ampere
        self._world = context.world
        self._plant = context.world.plant
        self._machine = machine
        self._commanded_ns = context.world.now_ns
        self._ignores_until_ns = 0
        context.cyclic(LOOK_PERIOD_NS, self._look)

    def heed(self) -> bool:
        """A command has come; whether it is obeyed."""
        self._commanded_ns, self.timed_out = self._world.now_ns, False
        return not self.fault

    def set_current(self, current_a: float) -> bool:
        """Whether the motor is driven from now on."""
        if not self.heed():
            return False
        if abs(current_a) < self._minimum_current_a:
            self.release()
            return False
        self.running = True
        limited_a = min(max(current_a, -MOST_CURRENT_A), MOST_CURRENT_A)
        self._plant.command(self._machine, limited_a * self._per_ampere)
        return True

    def break_down(self, fault: DriveFault) -> None:
        self.fault = self.fault or self._codes[fault]
        self._ignores_until_ns = self._world.now_ns + FAULT_STOP_NS
        self.release()

    def release(self) -> None:
        self.running = False
        self.on_release()
        self._plant.release(self._machine)

    def _look(self, stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), LOOK_PERIOD_NS * 1e-9)
        if self.heating.too_hot:
            self.break_down(DriveFault.OVER_TEMPERATURE)
        elif self.fault and stamp_ns >= self._ignores_until_ns:
            self.fault = 0
        if self.timeout_s and stamp_ns - self._commanded_ns > self.timeout_s * 1e9:
            self.timed_out = True
            self.release()
