"""A moteus controller, as it behaves on CAN FD.

Sources: mjbots/moteus, fw/moteus_controller.cc (``Write``, ``Read``, ``Poll``: a command is obeyed after the reply; a
written mode begins a command anew), fw/bldc_servo_control.h (``ISR_MaybeChangeMode``, ``ISR_DoControl``: a fault and a
timeout are left by a stop alone; ``ISR_DoPositionTimeout``), fw/bldc_servo_structs.h (defaults of a command and of the
configuration), fw/bldc_servo.cc (``ISR_DoCalibrating``: 256 cycles of 30 kHz), docs/protocol/registers.md. Not
emulated: the trajectory generator, bounds of the position, the integral, and the modes of single phases; in mode
"brake" the motor carries no current.
"""

from collections.abc import Callable
from math import inf, isnan, nan, tau
from typing import cast

from norton_drivers.codecs.moteus import Mode, Register, raw_of
from norton_drivers.codecs.multiplex import Resolution
from norton_drivers.moteus import MoteusOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating, Watchdog
from norton_sim.firmware.multiplex_server import NOT_WRITABLE, UNKNOWN, WRONG_VALUE, RegisterServer
from norton_sim.firmware.shaft_loop import ShaftLoop
from norton_sim.plant import Machine

LOOK_PERIOD_NS = 1_000_000
STARTING_NS = 12_000_000  # the gate driver, and the calibration of the current sensors
DEFAULT_TIMEOUT_S = 0.1  # servo.default_timeout_s
TIMEOUT_TORQUE_NM = 5.0  # servo.timeout_max_torque_Nm
SUPPLY_V = 24.0
FAULTS = {DriveFault.FAULT: 33, DriveFault.UNDERVOLTAGE: 40, DriveFault.OVER_TEMPERATURE: 38}
# Registers that are 32-bit integers and nothing else; the first is any number.
WHOLE: dict[int, int] = {Register.MODEL: 0x0604, Register.FIRMWARE: 0x000107, Register.REGISTER_MAP: 5}
DEFAULTS: dict[int, float] = {
    Register.COMMAND_POSITION: 0.0,
    Register.COMMAND_VELOCITY: 0.0,
    Register.FEEDFORWARD_TORQUE: 0.0,
    Register.KP_SCALE: 1.0,
    Register.KD_SCALE: 1.0,
    Register.MAXIMUM_TORQUE: 100.0,
    Register.STOP_POSITION: nan,
    Register.TIMEOUT: 0.0,
    Register.VELOCITY_LIMIT: nan,
    Register.ACCELERATION_LIMIT: nan,
    Register.ILIMIT_SCALE: 1.0,
    Register.IGNORE_BOUNDS: 0.0,
}
DRIVING = (Mode.POSITION, Mode.TIMEOUT, Mode.ZERO_VELOCITY)
COMMANDABLE = (Mode.STOPPED, Mode.POSITION, Mode.TIMEOUT, Mode.ZERO_VELOCITY, Mode.BRAKE)


class MoteusBoard(RegisterServer):
    """One controller: the rig's actuator or its load. ``mode`` and ``fault`` are what registers 0 and 15 say."""

    def __init__(self, context: DeviceContext) -> None:
        self.mode, self.fault = Mode.STOPPED, 0
        self.heating = Heating()
        self._options = options = parse_options(MoteusOptions, context.settings)
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        servo = options.servo
        # The plant's amplifier is told of in amperes per unit of the rig's command: there, one of error.
        self._nm_per_unit = 1.0 if servo is None else servo.gain
        self._amperes_per_nm = context.truth.driven(self._machine).amplifier_gain / self._nm_per_unit
        self._gains = (0.0, 0.0) if servo is None else (servo.stiffness_nm_rad, servo.damping_nms_rad)
        self._loops = servo is not None
        self._command = {**DEFAULTS}
        self._wanted: Mode | None = None  # written, and not obeyed yet
        self._zero_turns = 0.0
        self._frozen: tuple[float, float] | None = None
        self._watchdog = Watchdog(context.world, self._time_out)
        self._says = self._registers()
        super().__init__(context.can_connector(), options.node, options.prefix)
        context.cyclic(LOOK_PERIOD_NS, self._look)
        if servo is not None:
            ShaftLoop(context, self._machine, servo, options.loop_period_s, self._hold)

    @property
    def armed(self) -> bool:
        return self.mode in DRIVING

    def break_down(self, fault: DriveFault) -> None:
        self.mode, self.fault = Mode.FAULT, FAULTS[fault]
        self._plant.release(self._machine)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    # ---- what it does when told ----

    def write(self, register: int, value: float) -> int:
        match register:
            case Register.MODE:
                if value not in set(Mode):
                    return WRONG_VALUE
                self._wanted, self._command = Mode(int(value)), {**DEFAULTS}
            case Register.SET_OUTPUT_EXACT:
                self._zero_turns = self._plant.encoder_position_rad(self._machine) / tau - value
            case _ if register in DEFAULTS:
                self._command[register] = value
            case _:
                return NOT_WRITABLE if register in self._says or register in WHOLE else UNKNOWN
        return 0

    def complete(self) -> None:
        """The mode that was written is obeyed only now."""
        if self._wanted is not None:
            wanted, self._wanted = self._wanted, None
            self._obey(wanted)

    def _obey(self, wanted: Mode) -> None:
        timeout_s = self._command[Register.TIMEOUT] or DEFAULT_TIMEOUT_S
        self._watchdog.feed()
        period_ns = round((1e9 if isnan(timeout_s) else timeout_s) * 1e9)
        if period_ns != self._watchdog.timeout_ns:
            self._watchdog.configure(enabled=True, timeout_ns=period_ns)
        if wanted is Mode.STOPPED:
            self.mode, self.fault = Mode.STOPPED, 0
            self._plant.release(self._machine)
        elif wanted in COMMANDABLE and self.mode not in (Mode.FAULT, Mode.TIMEOUT, Mode.CALIBRATING):
            stopped, self.mode = self.mode is Mode.STOPPED, Mode.CALIBRATING
            if stopped:
                self._world.at(self._world.now_ns + STARTING_NS, lambda _: self._enter(wanted))
            else:
                self._enter(wanted)

    def _enter(self, mode: Mode) -> None:
        if self.mode is not Mode.CALIBRATING:
            return  # stopped meanwhile
        self.mode = mode
        if mode is Mode.BRAKE or not self._loops:
            self._push(self._feedforward_nm if mode is Mode.POSITION else 0.0)

    @property
    def _feedforward_nm(self) -> float:
        most_nm = self._command[Register.MAXIMUM_TORQUE]
        limit_nm = inf if isnan(most_nm) else most_nm
        return min(max(self._command[Register.FEEDFORWARD_TORQUE], -limit_nm), limit_nm)

    def _push(self, torque_nm: float) -> None:
        self._plant.command(self._machine, 0.0 if isnan(torque_nm) else torque_nm / self._nm_per_unit)

    # ---- what it says ----

    def _motion(self) -> tuple[float, float]:
        """Position [turns] from its zero, and velocity [turns/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        position_turns = plant.encoder_position_rad(machine) / tau - self._zero_turns
        return position_turns, plant.encoder_velocity_rad_s(machine) / tau

    def read(self, register: int, resolution: Resolution) -> float | None:
        if register in WHOLE:
            return WHOLE[register] if resolution is Resolution.INT32 else None
        if register in DEFAULTS:
            return raw_of(register, resolution, self._command[register])
        return raw_of(register, resolution, self._says[register]()) if register in self._says else None

    def _registers(self) -> dict[int, Callable[[], float]]:
        plant, machine = self._plant, self._machine
        return {
            Register.MODE: lambda: self.mode,
            Register.POSITION: lambda: self._motion()[0],
            Register.VELOCITY: lambda: self._motion()[1],
            Register.TORQUE: lambda: plant.current_a(machine) / self._amperes_per_nm,
            Register.Q_CURRENT: lambda: plant.current_a(machine),
            Register.D_CURRENT: lambda: 0.0,
            Register.MOTOR_TEMPERATURE: lambda: 0.0,  # without a sensor
            Register.TRAJECTORY_COMPLETE: lambda: 1.0,
            Register.HOME_STATE: lambda: 1.0,
            Register.VOLTAGE: lambda: SUPPLY_V,
            Register.TEMPERATURE: lambda: self.heating.temperature_c,
            Register.FAULT: lambda: self.fault,
        }

    # ---- what it does by itself ----

    def _hold(self, position_rad: float, velocity_rad_s: float) -> None:
        """One cycle of its loop; after a timeout, of a loop that only damps."""
        stiffness, damping = self._gains
        command, place_rad = self._command, position_rad - tau * self._zero_turns
        damped_nm = damping * command[Register.KD_SCALE] * (tau * command[Register.COMMAND_VELOCITY] - velocity_rad_s)
        if self.mode is Mode.POSITION:
            goal_rad = tau * command[Register.COMMAND_POSITION]
            held_nm = 0.0 if isnan(goal_rad) else stiffness * command[Register.KP_SCALE] * (goal_rad - place_rad)
            self._push(held_nm + damped_nm + self._feedforward_nm)
        elif self.mode in (Mode.TIMEOUT, Mode.ZERO_VELOCITY):
            damped_nm = -damping * command[Register.KD_SCALE] * velocity_rad_s
            self._push(min(max(damped_nm, -TIMEOUT_TORQUE_NM), TIMEOUT_TORQUE_NM))

    def _time_out(self) -> None:
        if self.mode is Mode.POSITION:
            self.mode = Mode.TIMEOUT
            self._push(0.0)

    def _look(self, _stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), LOOK_PERIOD_NS * 1e-9)
        if self.heating.too_hot and self.mode is not Mode.STOPPED:
            self.break_down(DriveFault.OVER_TEMPERATURE)
