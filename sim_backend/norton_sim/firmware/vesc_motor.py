"""A VESC's motor in FOC mode with an encoder, whichever line it is spoken to on.

Source: vedderb/bldc: motor/mcpwm_foc.c (the sign of the current; voltage to duty cycle; the tachometer).

Only the commands of the rig's mode are emulated, and a current of zero. In duty mode the voltage is over the winding:
the resistance follows from the plant's amplifier gain [A for a duty cycle of 1], the back-EMF from its torque constant
and the velocity, eight times a millisecond, and the amplifier's bandwidth stands for the winding's inductance.
"""

from math import copysign, degrees, floor, pi, sqrt, tau
from typing import cast

from norton_drivers.codecs import vesc as protocol
from norton_drivers.vesc.motor import VescMotorOptions
from norton_sim.firmware.context import DeviceContext, DriveFault
from norton_sim.firmware.releasing import ReleasingAmplifier
from norton_sim.plant import Machine

DUTY_PERIOD_NS = 125_000

SUPPLY_V = 24.0
WINDING_OHM = 0.1  # where no voltage is commanded, it shows in the duty cycle alone
MOST_DUTY = 0.95
DUTY_PER_SHARE = sqrt(3.0)  # duty cycle 1 is the greatest circle's voltage, supply / √3
AMPLITUDE_PER_TORQUE_CURRENT = 2.0 / 3.0  # flux linkage times pole pairs, for each newton metre per ampere

VERSION = (6, 5, "60")
FAULTS = {DriveFault.FAULT: 3, DriveFault.UNDERVOLTAGE: 2, DriveFault.OVER_TEMPERATURE: 5}


class VescMotor:
    """One motor, with its ``amplifier``."""

    def __init__(self, context: DeviceContext, options: VescMotorOptions) -> None:
        self._options = options
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        truth = context.truth.driven(self._machine)
        self._amplifier_gain = truth.amplifier_gain
        self._volt_s_rad = AMPLITUDE_PER_TORQUE_CURRENT * truth.torque_constant_nm_a
        self._duty: float | None = None  # where the voltage is what is commanded
        self._frozen: tuple[float, float] | None = None
        in_duty = options.mode == "duty"
        self.amplifier = ReleasingAmplifier(
            context,
            self._machine,
            FAULTS,
            minimum_current_a=options.minimum_current_a,
            timeout_s=options.watchdog_s,
            per_ampere=1 / self._amplifier_gain if in_duty else options.per_ampere,
        )
        self.amplifier.on_release = self._end_duty
        if in_duty:
            context.cyclic(DUTY_PERIOD_NS, self._press)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    # ---- what can be measured ----

    def angle_deg(self) -> float:
        """Within a turn."""
        return degrees(self._motion()[0]) % 360.0

    def erpm(self) -> float:
        return self._motion()[1] * self._options.pole_pairs * 60 / tau

    def tachometer(self) -> int:
        sixths_per_rad = protocol.TACHOMETER_PER_ELECTRICAL_TURN * self._options.pole_pairs / (2 * pi)
        return floor(self._motion()[0] * sixths_per_rad)

    def duty(self) -> float:
        return min(max(DUTY_PER_SHARE * self._voltage_v() / SUPPLY_V, -1.0), 1.0)

    def current_a(self) -> float:
        """One measurement, with the sign of its torque."""
        return self._plant.current_a(self._machine) if self.amplifier.running else 0.0

    def drawn_a(self) -> float:
        """Positive where the motor draws power, negative where it generates."""
        return copysign(1.0, self._voltage_v()) * self.current_a() if self.amplifier.running else 0.0

    def supply_a(self) -> float:
        return self._winding_ohm * self._plant.true_current_a(self._machine) ** 2 / SUPPLY_V

    def _motion(self) -> tuple[float, float]:
        """Position [rad] and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine), plant.encoder_velocity_rad_s(machine)

    @property
    def _winding_ohm(self) -> float:
        if self._options.mode == "duty":
            return SUPPLY_V / (DUTY_PER_SHARE * self._amplifier_gain)
        return WINDING_OHM

    def _voltage_v(self) -> float:
        """Along the q axis; a motor that is let go of shows its back-EMF."""
        back_emf_v = self._volt_s_rad * self._plant.encoder_velocity_rad_s(self._machine)
        return back_emf_v + self._winding_ohm * self._plant.true_current_a(self._machine)

    # ---- what it does when told ----

    def set_current(self, current_a: float) -> None:
        if self.amplifier.set_current(current_a):
            self._end_duty()

    def set_duty(self, duty: float) -> None:
        """Where the rig's commands are duty cycles."""
        if self.amplifier.heed() and self._options.mode == "duty":
            self.amplifier.running, self._duty = True, min(max(duty, -MOST_DUTY), MOST_DUTY)
            self._press(self._world.now_ns)

    def _end_duty(self) -> None:
        self._duty = None

    # ---- what it does by itself ----

    def _press(self, _stamp_ns: int) -> None:
        """Voltage over the winding: what the back-EMF leaves of it drives the current."""
        if self._duty is not None:
            back_emf_v = self._volt_s_rad * self._plant.encoder_velocity_rad_s(self._machine)
            self._plant.command(self._machine, self._duty - DUTY_PER_SHARE * back_emf_v / SUPPLY_V)
