"""What of an ODrive axis has nothing to do with CAN: its motor in torque control, and what is measured of it."""

from math import inf, tau
from typing import cast

from norton_drivers.codecs.odrive import ControlMode, InputMode
from norton_sim.firmware.site import Heating, Site
from norton_sim.plant import Machine

SUPPLY_V = 24.0
WINDING_OHM = 0.1

TORQUE_CONTROL = (ControlMode.TORQUE, InputMode.PASSTHROUGH)


class Motor:
    """``input_nm`` is the torque wanted, NaN where none was given yet; ``mode`` control mode and input mode."""

    def __init__(self, site: Site, input_nm: float) -> None:
        self.armed = False
        self.input_nm = input_nm
        self.mode: tuple[int, int] = (ControlMode.POSITION, InputMode.PASSTHROUGH)
        self.heating = Heating()
        self._limit_nm = inf
        self._frozen: tuple[float, float] | None = None
        self._plant = site.world.plant
        self._machine = cast(Machine, site.settings.role)
        self._amperes_per_nm = _amperes_per_nm(site)

    @property
    def in_torque_control(self) -> bool:
        return self.mode == TORQUE_CONTROL

    def arm(self) -> None:
        self.armed = True
        self.drive()

    def disarm(self) -> None:
        self.armed = False
        self._plant.release(self._machine)

    def drive(self) -> None:
        """Follow the input as it is now, where the motor is armed."""
        if self.armed:
            self._plant.command(self._machine, self.target_nm())

    def limit(self, current_a: float) -> None:
        """From now on give no more than ``current_a``."""
        self._limit_nm = abs(current_a) / self._amperes_per_nm
        self.drive()

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self.estimates()

    def warm_up(self, duration_s: float) -> None:
        """Let the present current flow for a while."""
        self.heating.carry(self._plant.true_current_a(self._machine), duration_s)

    # ---- what can be measured ----

    def estimates(self) -> tuple[float, float]:
        """Position [turns] and velocity [turns/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine) / tau, plant.encoder_velocity_rad_s(machine) / tau

    def current_a(self) -> float:
        """One measurement of the torque-producing current."""
        return self._plant.current_a(self._machine)

    def target_nm(self) -> float:
        """The torque that it tries to give."""
        if not self.armed:
            return 0.0
        input_nm, limit_nm = self.input_nm, self._limit_nm
        if -limit_nm <= input_nm <= limit_nm:
            return input_nm
        return min(max(input_nm, -limit_nm), limit_nm)

    def target_a(self) -> float:
        """The current that it tries to give."""
        return self.target_nm() * self._amperes_per_nm

    def torque_nm(self) -> float:
        """Its own estimate of its torque, from one measurement of the current."""
        return self.current_a() / self._amperes_per_nm

    def supply_current_a(self) -> float:
        """What the supply sees of the winding's losses."""
        return WINDING_OHM * self._plant.true_current_a(self._machine) ** 2 / SUPPLY_V


def _amperes_per_nm(site: Site) -> float:
    """The drive's own idea of its motor: the current that it sets for each newton metre of input."""
    return site.truth.driven(site.settings.role).amplifier_gain
