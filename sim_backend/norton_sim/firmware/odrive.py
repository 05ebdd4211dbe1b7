"""An ODrive axis, firmware 0.6, in torque control, as it behaves on CAN.

Source: ODrive manual, "CAN Protocol" (messages, cyclic rates, watchdog fed by every frame to the axis), and the API
reference, "ODrive.Axis", "ODrive.Error", ``axis.config.enable_watchdog`` and ``axis.config.watchdog_timeout``. Cyclic
messages come at the rates a bench would configure: estimates at 1 kHz, current at 100 Hz, the rest at 10 Hz. Only
torque control with passed-through input is emulated.
"""

from collections.abc import Callable, Mapping
from functools import partial
from math import inf, isfinite, isnan, nan, tau
from typing import Protocol, cast

import can

from norton_drivers.codecs import odrive, odrive_06
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.odrive import AxisState, ControlMode, InputMode, MessageId
from norton_drivers.odrive import ODriveOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating, Watchdog
from norton_sim.plant import Machine

SUPPLY_V = 24.0
WINDING_OHM = 0.1

TORQUE_CONTROL = (ControlMode.TORQUE, InputMode.PASSTHROUGH)


class ODriveMotor:
    """What of an ODrive axis has nothing to do with CAN: its motor in torque control, and what is measured of it.

    ``input_nm`` is the torque wanted, NaN where none was given yet; ``mode`` control mode and input mode.
    """

    def __init__(self, context: DeviceContext, input_nm: float) -> None:
        self.armed = False
        self.input_nm = input_nm
        self.mode: tuple[int, int] = (ControlMode.POSITION, InputMode.PASSTHROUGH)
        self.heating = Heating()
        self._limit_nm = inf
        self._frozen: tuple[float, float] | None = None
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        self._amperes_per_nm = _amperes_per_nm(context)

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


def _amperes_per_nm(context: DeviceContext) -> float:
    """The drive's own idea of its motor: the current that it sets for each newton metre of input."""
    return context.truth.driven(context.settings.role).amplifier_gain


ENCODER_PERIOD_NS = 1_000_000
IQ_PERIOD_NS = 10_000_000
SLOW_PERIOD_NS = 100_000_000

VERSION = odrive.Version(protocol=2, hardware=(4, 4, 58), firmware=(0, 6, 10))

RESULT_SUCCESS = 0
RESULT_DISARMED = 3
RESULT_INVALID_STATE = 13

ERROR_BAD_CONFIGURATION = 1 << 4
ERROR_MISSING_INPUT = 1 << 6
ERROR_INVERTER_TOO_HOT = 1 << 14
ERROR_BITS = {
    DriveFault.FAULT: 1 << 5,  # system level
    DriveFault.UNDERVOLTAGE: 1 << 9,  # DC bus under voltage
    DriveFault.OVER_TEMPERATURE: ERROR_INVERTER_TOO_HOT,
}


class _Answer(Protocol):
    def encode(self) -> bytes: ...


class ODriveAxis:
    """One axis and the machine it drives: the rig's actuator or its load."""

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(ODriveOptions, context.settings)
        self.active_errors = 0
        self.disarm_reason = 0
        self.axis_state = AxisState.IDLE
        self.motor = ODriveMotor(context, input_nm=nan)
        self._result = RESULT_SUCCESS
        self._watchdog = Watchdog(context.world, self._starve)
        self._parameters = _Parameters(options, self._watchdog)
        self._node = options.node
        self._ids = {command: odrive.arbitration_id(options.node, command) for command in MessageId}
        self._estimates_id = self._ids[MessageId.ENCODER_ESTIMATES]
        self._handlers = self._message_handlers()
        self._getters = self._message_getters()
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        self._start(context)

    def fail(self, error_bits: int) -> None:
        """Raise errors: an armed axis is disarmed, and stays so until the errors are cleared."""
        self.active_errors |= error_bits
        if self.armed:
            self.disarm_reason = error_bits
            self._go_idle(RESULT_DISARMED)

    @property
    def armed(self) -> bool:
        return self.motor.armed

    def break_down(self, fault: DriveFault) -> None:
        self.fail(ERROR_BITS[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self.motor.freeze()

    def _start(self, context: DeviceContext) -> None:
        context.cyclic(ENCODER_PERIOD_NS, self._send_estimates)
        context.cyclic(IQ_PERIOD_NS, self._send_current)
        for command in (MessageId.HEARTBEAT, MessageId.TEMPERATURE, MessageId.BUS_VOLTAGE_CURRENT):
            context.cyclic(SLOW_PERIOD_NS, partial(self._send_cyclic, command))

    # ---- what it says ----

    def _message_getters(self) -> Mapping[int, Callable[[], _Answer]]:
        motor = self.motor
        return {
            MessageId.VERSION: lambda: VERSION,
            MessageId.HEARTBEAT: lambda: odrive.Heartbeat(self.active_errors, self.axis_state, self._result),
            MessageId.ERROR: lambda: odrive.GetError(self.active_errors, self.disarm_reason),
            MessageId.ENCODER_ESTIMATES: lambda: odrive.EncoderEstimates(*motor.estimates()),
            MessageId.IQ: lambda: odrive.Iq(motor.target_a(), motor.current_a()),
            MessageId.TEMPERATURE: lambda: odrive.Temperature(motor.heating.temperature_c, nan),
            MessageId.BUS_VOLTAGE_CURRENT: lambda: odrive.BusVoltageCurrent(SUPPLY_V, motor.supply_current_a()),
            MessageId.TORQUES: lambda: odrive.Torques(motor.target_nm(), motor.torque_nm()),
        }

    def _answer(self, command: int) -> None:
        self._connector.send(self._ids[MessageId(command)], self._getters[command]().encode())

    def _send_cyclic(self, command: int, _stamp_ns: int) -> None:
        self._answer(command)

    def _send_estimates(self, _stamp_ns: int) -> None:
        self._connector.send(self._estimates_id, odrive.estimates_value(*self.motor.estimates()))

    def _send_current(self, _stamp_ns: int) -> None:
        self.motor.warm_up(IQ_PERIOD_NS * 1e-9)
        if self.motor.heating.too_hot:
            self.fail(ERROR_INVERTER_TOO_HOT)
        self._answer(MessageId.IQ)

    # ---- what it does when told ----

    def _message_handlers(self) -> Mapping[int, Callable[[bytearray], None]]:
        return {
            MessageId.ESTOP: lambda _: self.fail(odrive.ERROR_ESTOP),
            MessageId.RX_SDO: self._access_parameter,
            MessageId.SET_AXIS_STATE: lambda data: self._request(odrive.SetAxisState.decode(data).axis_state),
            MessageId.SET_CONTROLLER_MODE: self._set_controller_mode,
            MessageId.SET_INPUT_TORQUE: self._set_input_torque,
            MessageId.SET_LIMITS: lambda data: self.motor.limit(odrive.SetLimits.decode(data).current_a),
            MessageId.CLEAR_ERRORS: self._clear_errors,
        }

    def _receive(self, message: can.Message) -> None:
        if message.arbitration_id >> 5 != self._node or message.is_extended_id:
            return
        _, command = odrive.split_id(message.arbitration_id)
        self._watchdog.feed()
        if message.is_remote_frame:
            if command in self._getters:
                self._answer(command)
            return
        handler = self._handlers.get(command)
        if handler is None:
            return
        try:
            handler(message.data)
        except CodecError:
            return  # a frame too short for its command is not taken notice of

    def _set_input_torque(self, data: bytearray) -> None:
        try:
            self.motor.input_nm = odrive.torque_of(data)
        except CodecError:
            self.fail(ERROR_MISSING_INPUT)  # a torque that is no number
            return
        self.motor.drive()

    def _set_controller_mode(self, data: bytearray) -> None:
        mode = odrive.SetControllerMode.decode(data)
        self.motor.mode = (mode.control_mode, mode.input_mode)
        if self.armed and not self.motor.in_torque_control:
            self.fail(ERROR_BAD_CONFIGURATION)

    def _clear_errors(self, _data: bytearray) -> None:
        self.active_errors = self.disarm_reason = 0

    def _access_parameter(self, data: bytearray) -> None:
        request = odrive_06.RxSdo.decode(data)
        if request.opcode == odrive_06.SdoOpcode.WRITE:
            self._parameters.write(request.endpoint, request.value)
            return
        value = self._parameters.read(request.endpoint)
        if value is not None:
            self._connector.send(self._ids[MessageId.TX_SDO], odrive_06.TxSdo(request.endpoint, value).encode())

    def _starve(self) -> None:
        if self.armed:
            self.fail(odrive.ERROR_WATCHDOG)

    def _request(self, state: int) -> None:
        if state == AxisState.IDLE:
            self._go_idle(RESULT_SUCCESS)
        elif state == AxisState.CLOSED_LOOP_CONTROL:
            self._close_loop()
        else:
            self._result = RESULT_INVALID_STATE

    def _close_loop(self) -> None:
        if not self.motor.in_torque_control:
            self.active_errors |= ERROR_BAD_CONFIGURATION
        elif isnan(self.motor.input_nm):
            self.active_errors |= ERROR_MISSING_INPUT
        if self.active_errors:
            self._result = RESULT_INVALID_STATE
            return
        self.axis_state = AxisState.CLOSED_LOOP_CONTROL
        self.disarm_reason = 0
        self._result = RESULT_SUCCESS
        self.motor.arm()

    def _go_idle(self, result: int) -> None:
        self.axis_state = AxisState.IDLE
        self._result = result
        self.motor.disarm()


class _Parameters:
    """The watchdog's parameters, at the endpoints that the rig names; others are left alone."""

    def __init__(self, options: ODriveOptions, watchdog: Watchdog) -> None:
        self._watchdog = watchdog
        self._enable_endpoint = options.enable_watchdog_endpoint
        self._timeout_endpoint = options.watchdog_timeout_endpoint

    def read(self, endpoint: int) -> bytes | None:
        """The parameter's four bytes; None where there is none."""
        if endpoint == self._enable_endpoint:
            return odrive_06.u32_value(self._watchdog.enabled)
        if endpoint == self._timeout_endpoint:
            return odrive_06.f32_value(self._watchdog.timeout_ns * 1e-9)
        return None

    def write(self, endpoint: int, value: bytes) -> None:
        enabled, timeout_ns = self._watchdog.enabled, self._watchdog.timeout_ns
        if endpoint == self._enable_endpoint:
            enabled = bool(odrive_06.u32_of(value) & 0xFF)
        elif endpoint == self._timeout_endpoint and isfinite(timeout_s := odrive_06.f32_of(value)):
            timeout_ns = max(0, round(timeout_s * 1e9))
        self._watchdog.configure(enabled=enabled, timeout_ns=timeout_ns)
