"""An ODrive on CAN: torque commands out, motion, current and state in.

The drive sends its encoder estimates and currents by itself, at the rates of its own configuration
(``axis0.config.can.…_rate_ms``): set them in the drive and save. Firmware before 0.5.6 tells currents only to those who
ask: ``ask`` does. What else the firmwares say differently stands in :mod:`norton_drivers.odrive.firmwares` and
:mod:`norton_drivers.odrive.firmwares`. Positive torque is the torque that the actuator exerts on its load in the
drive's positive sense, times ``direction``."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from math import isnan, nan, pi
from typing import Any, Final, Literal

import can
from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import odrive as protocol
from norton_drivers.codecs import odrive_06
from norton_drivers.codecs.common import CodecError, float32_step
from norton_drivers.codecs.odrive import MessageId
from norton_drivers.codecs.odrive_05 import Command05, EncoderCount
from norton_drivers.codecs.odrive_06 import describe_axis_state
from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, Questions, wait_until
from norton_drivers.odrive.axis import ODriveAxisOptions
from norton_drivers.odrive.firmwares import Dialect, Drive, Firmware05, Firmware06, Handler, HeartbeatState, Message
from norton_drivers.ports import CanPort
from norton_drivers.readings import (
    CurrentReading,
    DeviceIdentity,
    DriveState,
    DriveStatus,
    MotionReading,
    Unwrapped,
)
from norton_drivers.registry import Recognised
from norton_drivers.wiring import DeviceSettings, parse_options

TURN_RAD = 2 * pi
_HEARTBEATS_MISSED = 3
_FEED_INTERVAL_NS = 10_000_000  # while waiting; half of the shortest watchdog
_ASK_AGAIN_S = 0.02
_CURRENT_INTERVAL_S = 0.01
_COUNT_SPAN = 1 << 32

DIALECTS: Final[Mapping[str, Callable[[Drive], Dialect]]] = {"0.5": Firmware05, "0.6": Firmware06}

CONNECTION = "can"
OPTION_UNITS = {"watchdog": "s", "heartbeat": "s"}


_AXIS_STATE_MAX = 16  # 13 in firmware 0.6.10; later ones may know more
_DEVICE = "an ODrive"
_SAYS: dict[int, str] = {
    MessageId.HEARTBEAT: "heartbeat",
    MessageId.ENCODER_ESTIMATES: "encoder estimates",
    MessageId.IQ: "current",
    MessageId.TEMPERATURE: "temperature",
    MessageId.BUS_VOLTAGE_CURRENT: "supply",
    MessageId.TORQUES: "torques",
}
_COMMANDS = {MessageId.ESTOP, MessageId.SET_AXIS_STATE, MessageId.SET_CONTROLLER_MODE, MessageId.SET_INPUT_TORQUE}
_COMMANDS |= {MessageId.SET_LIMITS, MessageId.CLEAR_ERRORS}


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """A heartbeat is sure; all else only belongs to a node that sends one, whose 32 identifiers are its own."""
    if message.is_extended_id or message.is_remote_frame:
        return None
    node, number = protocol.split_id(message.arbitration_id)
    heartbeat = number == MessageId.HEARTBEAT and message.dlc == 8 and 1 <= message.data[4] <= _AXIS_STATE_MAX
    says = _SAYS.get(number, f"message 0x{number:02X}")
    return Recognised(_DEVICE, says, {"node": node}, sure=heartbeat, from_host=number in _COMMANDS)


class ODriveOptions(ODriveAxisOptions):
    """What a rig file may say of an ODrive on CAN."""

    node: int = Field(ge=0, le=protocol.NODE_MAX, description="the drive's CAN node id, 0 to 63", examples=[1])
    heartbeat_s: float = Field(
        0.1, alias="heartbeat", gt=0, le=10, description="the drive's heartbeat period", examples=["100 ms"]
    )
    position: Literal["turns", "counts"] = Field(
        "turns", description='what positions are made from: estimates, or, exact however far it turns, "counts"'
    )
    ask: bool = Field(False, description="whether currents must be asked for, as before firmware 0.5.6")
    watchdog_timeout_endpoint: int = Field(
        odrive_06.ENDPOINT_WATCHDOG_TIMEOUT, ge=0, le=0xFFFF, description="from the board's flat_endpoints.json"
    )
    enable_watchdog_endpoint: int = Field(
        odrive_06.ENDPOINT_ENABLE_WATCHDOG, ge=0, le=0xFFFF, description="from the board's flat_endpoints.json"
    )

    @field_validator("position")
    @classmethod
    def _is_sent(cls, position: str, info: ValidationInfo) -> str:
        if position == "counts" and info.data.get("firmware") == "0.6":
            raise ValueError('firmware 0.6 sends no counts; use "turns"')
        if position == "counts" and not info.data.get("counts_per_turn"):
            raise ValueError("counts mean nothing without counts_per_turn; add it")
        return position

    @field_validator("ask")
    @classmethod
    def _is_exact_enough(cls, ask: bool, info: ValidationInfo) -> bool:
        # A remote frame is on its way for as long as the bus likes: a shaft turns by many counts meanwhile.
        if ask and info.data.get("position") == "counts":
            raise ValueError('counts that are asked for come too irregularly; write position = "turns"')
        return ask


def open_amplifier(settings: DeviceSettings, link: Link) -> "ODrive":
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return ODrive(settings, parse_options(ODriveOptions, settings), link.can_port(settings), link)


class ODrive(DriveBase):
    """One axis of an ODrive. ``malformed`` counts frames that could not be decoded."""

    command_unit = "N*m"

    def __init__(self, settings: DeviceSettings, options: ODriveOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings)
        self.options = options
        self.malformed = 0
        self.heartbeat_timeout_ns = round(_HEARTBEATS_MISSED * options.heartbeat_s * 1e9)
        self._rad_per_turn = settings.direction * TURN_RAD
        self._port = port
        self._link = link
        self._firmware = DIALECTS[options.firmware](self)
        self._position_rev = 0.0
        self._velocity_rev_s = nan
        self._counts = Unwrapped(_COUNT_SPAN)
        self._bus_voltage_v = nan
        self._heard = HeartbeatState(0, protocol.AxisState.UNDEFINED, failed=False)
        self._heartbeat_ns: int | None = None
        self._heartbeats = 0
        self._closed_loop_wanted = False
        self._fed_ns = 0
        self._questions = self._ask_for_current() if options.ask else None
        self._torque_id = protocol.arbitration_id(options.node, protocol.MessageId.SET_INPUT_TORQUE)
        self._handlers = self._handlers_by_id()
        port.subscribe(self._on_frame, self._handlers)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask who it is, and see that positions arrive."""
        before = self._motion.count
        hardware, firmware = self._firmware.identify(timeout_s)
        self.wait_for(lambda: self._motion.count > before, timeout_s, self._no_motion())
        return DeviceIdentity("odrive", f"{self._port.name} node {self.options.node}", hardware, firmware)

    def enable(self, timeout_s: float = 2.0) -> None:
        """Arm the watchdog, clear errors, close the torque loop at zero torque; return when the drive says so."""
        if self._questions is not None:
            self._questions.hushed = False
        if self.options.watchdog_s > 0:
            self._firmware.arm_watchdog()
        self._firmware.forget()
        self._status = None
        self.send(self._firmware.clear_errors)
        self.send(protocol.SetControllerMode(protocol.ControlMode.TORQUE, protocol.InputMode.PASSTHROUGH))
        self.command(0.0)
        self.send(protocol.SetAxisState(protocol.AxisState.CLOSED_LOOP_CONTROL))
        asked = self._heartbeats
        self.wait_for(lambda: self._is_closed_loop(asked), timeout_s, "did not close its torque loop")
        self._closed_loop_wanted = True
        self._status = None

    def command(self, value: float) -> float:
        """Command a torque [N m], which also feeds the watchdog; returns it as the float32 that is sent.

        Raises ConnectionFailedError, DeviceError.
        """
        try:
            payload = protocol.torque_value(self._direction * value)
        except CodecError as error:
            raise DeviceError(f"{self.place}: cannot command a torque of {value} N*m") from error
        self._port.send(self._torque_id, payload)
        sent_nm: float = protocol.TORQUE.unpack(payload)[0]
        return self._direction * sent_nm

    @property
    def position_resolution_rad(self) -> float:
        """The encoder's step, or that of the float32 turns on the wire at the present position if it is larger."""
        if self.options.position == "counts":
            return TURN_RAD / self.options.counts_per_turn
        encoder_step_rev = 1 / self.options.counts_per_turn if self.options.counts_per_turn else 0.0
        return TURN_RAD * max(float32_step(self._position_rev), encoder_step_rev)

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        self.command(0.0)
        if self._questions is not None:
            self._questions.hushed = True  # the drive takes every frame for a sign of life

    def made_itself_safe(self) -> bool | None:
        return self._heartbeat_ns is not None and not self._in_closed_loop

    def stop(self) -> None:
        """Zero torque, then idle, each tried whatever became of the other."""
        self._closed_loop_wanted = False
        self._status = None
        for message in (protocol.SetInputTorque(0.0), protocol.SetAxisState(protocol.AxisState.IDLE)):
            with suppress(Exception):
                self.send(message)

    # ---- What the dialects need too ------------------------------------------------------------------------------

    @property
    def place(self) -> str:
        """Where the drive is, for error messages."""
        return f"[{self.role}] ODrive node {self.options.node} on {self._port.name}"

    def send(self, message: Message) -> None:
        """Send one message. Raises ConnectionFailedError."""
        self._port.send(protocol.arbitration_id(self.options.node, message.COMMAND), message.encode())

    def request(self, command: int) -> None:
        """Ask for a message by remote frame. Raises ConnectionFailedError."""
        self._port.send(protocol.arbitration_id(self.options.node, command), b"", remote=True)

    def wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        """Poll until ``arrived()``, feeding the watchdog; raises DeviceTimeoutError saying ``otherwise``."""
        if not self.arrives(arrived, timeout_s):
            raise self.late(timeout_s, otherwise)

    def arrives(self, arrived: Callable[[], bool], timeout_s: float) -> bool:
        """Poll until ``arrived()``, feeding the watchdog; False where ``timeout_s`` passed first."""
        return wait_until(arrived, self._link, timeout_s, meanwhile=self._feed)

    def late(self, timeout_s: float, otherwise: str) -> DeviceTimeoutError:
        """What to raise where nothing came within ``timeout_s``."""
        return DeviceTimeoutError(f"{self.place}: {otherwise} ({timeout_s:g} s waited)")

    def _feed(self) -> None:
        now_ns = self._link.clock.now_ns()
        if now_ns - self._fed_ns >= _FEED_INTERVAL_NS:
            self._fed_ns = now_ns
            self.command(0.0)

    # ---- State ---------------------------------------------------------------------------------------------------

    def _is_closed_loop(self, heartbeats_when_asked: int) -> bool:
        """Whether a heartbeat since then says so. Raises DeviceError where the drive refuses."""
        since = self._heartbeats - heartbeats_when_asked
        # One heartbeat may have been on its way, with the old errors, when they were cleared.
        if since >= 2 and (reasons := self._reasons_to_refuse()):
            raise DeviceError(f"{self.place}: refuses to close its torque loop: {'; '.join(reasons)}")
        return since >= 1 and self._in_closed_loop and not self._heard.failed

    def _reasons_to_refuse(self) -> tuple[str, ...]:
        errors = self._errors()
        return errors if errors or self._in_closed_loop else self._firmware.refusals()

    @property
    def _in_closed_loop(self) -> bool:
        return self._heard.axis_state == protocol.AxisState.CLOSED_LOOP_CONTROL

    def _new_status(self) -> DriveStatus:
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=self._heartbeat_ns,
            errors=self._errors(),
            transistor_temperature_c=self._firmware.temperature.transistor_c,
            motor_temperature_c=self._firmware.temperature.motor_c,
            bus_voltage_v=self._bus_voltage_v,
        )

    def _state(self) -> DriveState:
        if self._heartbeat_ns is None:
            return DriveState.UNKNOWN
        if self._heard.failed or (self._closed_loop_wanted and not self._in_closed_loop):
            return DriveState.FAULT
        return DriveState.ENABLED if self._in_closed_loop else DriveState.IDLE

    def _errors(self) -> tuple[str, ...]:
        errors = self._firmware.errors(self._heard.error_bits)
        if errors or not self._closed_loop_wanted or self._in_closed_loop:
            return errors
        return (f"left closed loop without an error (now {describe_axis_state(self._heard.axis_state)})",)

    def _no_motion(self) -> str:
        setting = f"set axis0.config.can.{self._firmware.encoder_rate} = 1 in the drive and save"
        if self.options.position == "turns":
            return f"sends no encoder estimates; {setting}"
        counts = "set axis0.config.can.encoder_count_rate_ms = 1, which firmware before 0.5.6 has not"
        return f"sends no encoder counts, or no estimates beside them; {counts}; {setting}"

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _ask_for_current(self) -> Questions:
        return Questions(self._link, lambda: self.request(protocol.MessageId.IQ), _ASK_AGAIN_S, _CURRENT_INTERVAL_S)

    def _handlers_by_id(self) -> dict[int, Handler]:
        counts = self.options.position == "counts"
        handlers: dict[int, Handler] = {
            protocol.MessageId.HEARTBEAT: self._on_heartbeat,
            protocol.MessageId.ENCODER_ESTIMATES: self._on_velocity if counts else self._on_encoder_estimates,
            protocol.MessageId.IQ: self._on_iq,
            protocol.MessageId.BUS_VOLTAGE_CURRENT: self._on_bus_voltage,
        }
        if counts:
            handlers[Command05.ENCODER_COUNT] = self._on_encoder_count
        handlers |= {command: self._changing_status(call) for command, call in self._firmware.handlers().items()}
        return {protocol.arbitration_id(self.options.node, command): call for command, call in handlers.items()}

    def _changing_status(self, handler: Handler) -> Handler:
        def on_message(data: bytearray, arrival_ns: int) -> None:
            handler(data, arrival_ns)
            self._status = None

        return on_message

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if message.is_extended_id or message.is_remote_frame:
            return
        try:
            self._handlers[message.arbitration_id](message.data, arrival_ns)
        except CodecError:
            self.malformed += 1

    def _on_encoder_estimates(self, data: bytearray, arrival_ns: int) -> None:
        position_rev, velocity_rev_s = protocol.estimates_of(data)
        self._position_rev = position_rev
        scale, motion = self._rad_per_turn, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, scale * position_rev, scale * velocity_rev_s))

    def _on_velocity(self, data: bytearray, arrival_ns: int) -> None:
        _, self._velocity_rev_s = protocol.estimates_of(data)

    def _on_encoder_count(self, data: bytearray, arrival_ns: int) -> None:
        count = self._counts.follow(EncoderCount.decode(data).shadow_count)
        if isnan(self._velocity_rev_s):
            return  # no estimate has come yet
        scale, motion = self._rad_per_turn, self._motion
        position_rad = scale * count / self.options.counts_per_turn
        motion.put(MotionReading(motion.count, arrival_ns, position_rad, scale * self._velocity_rev_s))

    def _on_iq(self, data: bytearray, arrival_ns: int) -> None:
        measured_a = protocol.Iq.decode(data).measured_a
        if self._questions is not None:
            self._questions.answered(arrival_ns)
        self._current.put(CurrentReading(self._current.count, arrival_ns, self._direction * measured_a))

    def _on_heartbeat(self, data: bytearray, arrival_ns: int) -> None:
        self._heard = self._firmware.heard(data)
        self._status = None
        self._heartbeat_ns = arrival_ns
        self._heartbeats += 1
        if self._state() is not DriveState.FAULT:
            self._firmware.forget()
            return
        with suppress(DeviceError):  # a lost bus shows elsewhere
            self._firmware.ask_why()

    def _on_bus_voltage(self, data: bytearray, arrival_ns: int) -> None:
        self._bus_voltage_v = protocol.BusVoltageCurrent.decode(data).voltage_v
        self._status = None
