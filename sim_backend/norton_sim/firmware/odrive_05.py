"""An ODrive axis, firmware 0.5, in torque control, as it behaves on CAN.

Sources: ODrive's firmware 0.5.6 (``can_simple.cpp``, ``axis.cpp``), its CHANGELOG.md and issue 700. It tells no
version; the motor's errors show in the axis' heartbeat as a flag alone; the watchdog is set over USB, and bites an idle
axis too; a loop that cannot be closed leaves the axis idle. Cyclic messages come at the rates a bench would configure.
Where the rig says that everything must be asked for it is 0.5.4, which sends heartbeats and estimates alone, heartbeats
without flags, and knows no controller error. Only torque control with passed-through input is emulated.
"""

from collections.abc import Callable, Mapping
from functools import partial

import can

from norton_drivers.codecs import odrive, odrive_05
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.odrive import AxisState, MessageId
from norton_drivers.codecs.odrive_05 import Command05
from norton_drivers.odrive import ODriveOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Watchdog
from norton_sim.firmware.odrive import SUPPLY_V, ODriveMotor

ESTIMATES_PERIOD_NS = 1_000_000
IQ_PERIOD_NS = 10_000_000
SLOW_PERIOD_NS = 100_000_000
COUNT_WRAP = 1 << 32

MOTOR_NOT_A_NUMBER = 1 << 16
MOTOR_TOO_HOT = 1 << 18
CONTROLLER_INVALID_MODE = 1 << 1
MOTOR_ERRORS = {
    DriveFault.FAULT: 1 << 3,  # gate driver
    DriveFault.UNDERVOLTAGE: 1 << 24,  # system level
    DriveFault.OVER_TEMPERATURE: MOTOR_TOO_HOT,
}


class ODrive05Axis:
    """One axis and the machine it drives: the rig's actuator or its load."""

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(ODriveOptions, context.settings)
        self.axis_errors = 0
        self.motor_errors = 0
        self.controller_errors = 0
        self.axis_state = AxisState.IDLE
        self.motor = ODriveMotor(context, input_nm=0.0)
        self._node = options.node
        self._cpr = options.counts_per_turn or 8192  # the drive's own default
        self._before_056 = options.ask
        self._handlers = self._message_handlers()
        self._getters = self._message_getters()
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        self._watchdog = Watchdog(context.world, self._starve)
        self._watchdog.configure(enabled=options.watchdog_s > 0, timeout_ns=round(options.watchdog_s * 1e9))
        self._start(context, counts=options.position == "counts")

    def fail(self, axis_errors: int = 0, *, motor_errors: int = 0, controller_errors: int = 0) -> None:
        """Raise errors: an armed axis is disarmed. They stay until they are cleared."""
        self.axis_errors |= axis_errors
        self.motor_errors |= motor_errors
        self.controller_errors |= controller_errors
        self._go_idle()

    @property
    def armed(self) -> bool:
        return self.motor.armed

    def break_down(self, fault: DriveFault) -> None:
        self.fail(motor_errors=MOTOR_ERRORS[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self.motor.freeze()

    def _start(self, context: DeviceContext, *, counts: bool) -> None:
        context.cyclic(IQ_PERIOD_NS, self._warm_up)
        periods_ns = {MessageId.ENCODER_ESTIMATES: ESTIMATES_PERIOD_NS, MessageId.HEARTBEAT: SLOW_PERIOD_NS}
        if not self._before_056:
            periods_ns |= {MessageId.IQ: IQ_PERIOD_NS, MessageId.BUS_VOLTAGE_CURRENT: SLOW_PERIOD_NS}
        for command, period_ns in periods_ns.items():
            context.cyclic(period_ns, partial(self._send_cyclic, command))
        if counts and not self._before_056:
            context.cyclic(ESTIMATES_PERIOD_NS, partial(self._send_cyclic, Command05.ENCODER_COUNT))

    # ---- what it says ----

    def _message_getters(self) -> Mapping[int, Callable[[], bytes]]:
        motor = self.motor
        getters: dict[int, Callable[[], bytes]] = {
            MessageId.HEARTBEAT: self._heartbeat,
            Command05.MOTOR_ERROR: lambda: odrive_05.errors_value(self.motor_errors),
            Command05.ENCODER_ERROR: lambda: odrive_05.errors_value(0),
            Command05.SENSORLESS_ERROR: lambda: odrive_05.errors_value(0),
            MessageId.ENCODER_ESTIMATES: lambda: odrive.estimates_value(*motor.estimates()),
            Command05.ENCODER_COUNT: self._count,
            MessageId.IQ: lambda: odrive.Iq(motor.target_a(), motor.current_a()).encode(),
            MessageId.BUS_VOLTAGE_CURRENT: lambda: odrive.BusVoltageCurrent(
                SUPPLY_V, motor.supply_current_a()
            ).encode(),
        }
        if not self._before_056:
            getters[Command05.CONTROLLER_ERROR] = lambda: odrive_05.errors_value(self.controller_errors)
        return getters

    def _heartbeat(self) -> bytes:
        if self._before_056:
            return odrive_05.Heartbeat05(self.axis_errors, self.axis_state).encode()
        motor_failed, controller_failed = self.motor_errors != 0, self.controller_errors != 0
        return odrive_05.Heartbeat05(
            self.axis_errors, self.axis_state, motor_failed, controller_failed=controller_failed
        ).encode()

    def _count(self) -> bytes:
        count = round(self.motor.estimates()[0] * self._cpr)
        half = COUNT_WRAP // 2
        return odrive_05.EncoderCount((count + half) % COUNT_WRAP - half, count % self._cpr).encode()

    def _answer(self, command: int) -> None:
        self._connector.send(odrive.arbitration_id(self._node, command), self._getters[command]())

    def _send_cyclic(self, command: int, _stamp_ns: int) -> None:
        self._answer(command)

    def _warm_up(self, _stamp_ns: int) -> None:
        self.motor.warm_up(IQ_PERIOD_NS * 1e-9)
        if self.motor.heating.too_hot:
            self.fail(motor_errors=MOTOR_TOO_HOT)

    # ---- what it does when told ----

    def _message_handlers(self) -> Mapping[int, Callable[[bytearray], None]]:
        return {
            MessageId.ESTOP: lambda _: self.fail(odrive_05.ERROR_ESTOP),
            MessageId.SET_AXIS_STATE: lambda data: self._request(odrive.SetAxisState.decode(data).axis_state),
            MessageId.SET_CONTROLLER_MODE: self._set_controller_mode,
            MessageId.SET_INPUT_TORQUE: self._set_input_torque,
            MessageId.SET_LIMITS: lambda data: self.motor.limit(odrive.SetLimits.decode(data).current_a),
            Command05.CLEAR_ERRORS: self._clear_errors,
        }

    def _receive(self, message: can.Message) -> None:
        node, command = odrive.split_id(message.arbitration_id)
        if node != self._node or message.is_extended_id:
            return
        self._watchdog.feed()
        if command in self._getters:
            # Since 0.5.5 an empty data frame asks as well as a remote frame does.
            if message.is_remote_frame or (not self._before_056 and message.dlc == 0):
                self._answer(command)
            return
        handler = self._handlers.get(command)
        if handler is None or message.is_remote_frame:
            return
        try:
            handler(message.data)
        except CodecError:
            return  # a frame too short for its command is not taken notice of

    def _set_input_torque(self, data: bytearray) -> None:
        try:
            self.motor.input_nm = odrive.torque_of(data)
        except CodecError:
            self.fail(motor_errors=MOTOR_NOT_A_NUMBER)
            return
        self.motor.drive()

    def _set_controller_mode(self, data: bytearray) -> None:
        mode = odrive.SetControllerMode.decode(data)
        self.motor.mode = (mode.control_mode, mode.input_mode)
        if self.armed and not self.motor.in_torque_control:
            self.fail(controller_errors=CONTROLLER_INVALID_MODE)

    def _clear_errors(self, _data: bytearray) -> None:
        self.axis_errors = self.motor_errors = self.controller_errors = 0

    def _starve(self) -> None:
        self.fail(odrive_05.ERROR_WATCHDOG)

    def _request(self, state: int) -> None:
        self.axis_errors &= ~odrive_05.ERROR_INVALID_STATE
        if state == AxisState.IDLE:
            self._go_idle()
        elif state == AxisState.CLOSED_LOOP_CONTROL:
            self._close_loop()
        else:
            self.fail(odrive_05.ERROR_INVALID_STATE)

    def _close_loop(self) -> None:
        if not self.motor.in_torque_control:
            self.controller_errors |= CONTROLLER_INVALID_MODE
        if self.axis_errors or self.motor_errors or self.controller_errors:
            return  # it arms, and its next control cycle disarms it
        self.axis_state = AxisState.CLOSED_LOOP_CONTROL
        self.motor.arm()

    def _go_idle(self) -> None:
        self.axis_state = AxisState.IDLE
        self.motor.disarm()
