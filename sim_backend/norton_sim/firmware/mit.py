"""An actuator in MIT mode, as it behaves on CAN.

Source: bgkatz/motorcontrol: stm32f4xx_it.c (every frame is answered before it is obeyed; special frames do not feed the
timeout), fsm.c (a timeout zeroes the command and leaves the motor enabled; the motor is enabled with the command that
was stored last, and zeroed only while it is not), can.c (codes that wrap), foc.c (``torque_control``: the position
loop), position_sensor.c (velocity from two positions); CubeMars, AK Series Actuator Driver Manual V1.0.8 (temperature
and error at the end of a reply). What its position does beyond its range is the rig's to say. The gains of a command
are emulated where the rig's commands are positions or velocities: at the period and with the window that its options
name, from the encoder's counts, up to the amplifier's greatest current.
"""

from typing import cast

import can

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.mit import Reply, Special
from norton_drivers.codecs.ranges import RELEASED, Goal
from norton_drivers.mit import MitOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating
from norton_sim.firmware.shaft_loop import ShaftLoop
from norton_sim.plant import Machine

LOOK_PERIOD_NS = 1_000_000
TOO_HOT = 1
ERRORS = {DriveFault.FAULT: 2, DriveFault.UNDERVOLTAGE: 4, DriveFault.OVER_TEMPERATURE: TOO_HOT}


class MitMotor:
    """One motor: the rig's actuator or its load. ``error`` is the error byte of its replies."""

    def __init__(self, context: DeviceContext) -> None:
        self.error = protocol.NO_ERROR
        self.heating = Heating()
        self._options = options = parse_options(MitOptions, context.settings)
        self._ranges = options.ranges
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        self.timeout_s = options.watchdog_s
        servo = options.servo
        # The plant's amplifier is told of in amperes per unit of the rig's command: there, one of error.
        self._nm_per_unit = 1.0 if servo is None else servo.gain
        self._amperes_per_nm = context.truth.driven(self._machine).amplifier_gain / self._nm_per_unit
        self._armed = False
        self._zero_rad = 0.0
        self._loops = servo is not None  # whether it works out a loop
        self._goal = RELEASED
        self._commanded_ns = context.world.now_ns
        self._frozen: tuple[float, float] | None = None
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        context.cyclic(LOOK_PERIOD_NS, self._look)
        if servo is not None:
            ShaftLoop(context, self._machine, servo, options.loop_period_s, self._hold)

    @property
    def armed(self) -> bool:
        return self._armed

    def break_down(self, fault: DriveFault) -> None:
        self._stop_with(ERRORS[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    # ---- what it says ----

    def _answer(self) -> None:
        position_rad, velocity_rad_s = self._motion()
        if self._options.beyond_range == "saturates":
            furthest_rad = self._ranges.position_rad
            position_rad = min(max(position_rad, -furthest_rad), furthest_rad)
        torque_nm = self._plant.current_a(self._machine) / self._amperes_per_nm
        reply = Reply.of(self._options.node, position_rad, velocity_rad_s, torque_nm, self._ranges)
        warmth = round(self.heating.temperature_c - self._options.temperature_offset_c)
        self._connector.send(self._options.master, reply._replace(temperature=warmth, error=self.error).encode())

    def _motion(self) -> tuple[float, float]:
        """Position [rad] from where zero was set, and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine) - self._zero_rad, plant.encoder_velocity_rad_s(machine)

    # ---- what it does when told ----

    def _receive(self, message: can.Message) -> None:
        if message.arbitration_id != self._options.node or message.is_extended_id or message.is_remote_frame:
            return
        self._answer()
        special = protocol.special_of(message.data)
        try:
            if special is None:
                self._obey(protocol.goal_of(message.data, self._ranges))
            else:
                self._do(special)
        except CodecError:
            return  # cut short

    def _obey(self, goal: Goal) -> None:
        self._goal = goal
        self._commanded_ns = self._world.now_ns
        if self._armed and not self._loops:
            self._push(goal.torque_nm)

    def _push(self, torque_nm: float) -> None:
        self._plant.command(self._machine, torque_nm / self._nm_per_unit)

    def _do(self, special: Special) -> None:
        match special:
            case Special.ENABLE if not self._armed:
                self.error, self._armed = protocol.NO_ERROR, True
                if not self._loops:
                    self._push(self._goal.torque_nm)
            case Special.DISABLE:
                self._disarm()
            case Special.ZERO if not self._armed:
                self._zero_rad = self._plant.encoder_position_rad(self._machine)

    # ---- what it does by itself ----

    def _hold(self, position_rad: float, velocity_rad_s: float) -> None:
        """One cycle of torque_control, with the velocity of ps_sample."""
        if self._armed:
            self._push(self._goal.held_nm(position_rad - self._zero_rad, velocity_rad_s))

    def _look(self, stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), LOOK_PERIOD_NS * 1e-9)
        if self.heating.too_hot:
            self._stop_with(TOO_HOT)
        if self._armed and self.timeout_s and stamp_ns - self._commanded_ns > self.timeout_s * 1e9:
            self._goal = RELEASED
            self._push(0.0)

    def _stop_with(self, error: int) -> None:
        self.error = error
        self._disarm()

    def _disarm(self) -> None:
        self._armed, self._goal = False, RELEASED
        self._plant.release(self._machine)
