"""ODrive drives, CANSimple protocol, firmware 0.6: torque commands out, motion, current and state in.

The drive sends its encoder estimates, currents and temperatures by itself, at the rates of its own configuration
(``axis0.config.can.encoder_msg_rate_ms`` and so on): set them in the drive and save. Positive torque is the torque that
the actuator exerts on its load in the drive's positive sense, times ``direction``.
"""

from collections.abc import Callable
from contextlib import suppress
from math import frexp, ldexp, nan, pi
from typing import ClassVar, Protocol

import can
from pydantic import Field, field_validator

from drivers.codecs import odrive as protocol
from drivers.codecs import odrive_words as words
from drivers.codecs.errors import CodecError
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.inbox import Inbox
from drivers.link import Link
from drivers.odrive_watchdog import arm_watchdog
from drivers.options import DeviceOptions, parse_options
from drivers.ports import CanPort
from drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from drivers.waiting import wait_until
from drivers.wiring import DeviceSettings

TURN_RAD = 2 * pi
_FLOAT32_BITS = 24
_HEARTBEATS_MISSED = 3
_FEED_INTERVAL_NS = 10_000_000  # while waiting; half of the shortest watchdog

OPTION_UNITS = {"watchdog": "s", "heartbeat": "s"}


class ODriveOptions(DeviceOptions):
    """What a rig file may say of an ODrive."""

    node: int = Field(ge=0, le=protocol.NODE_MAX, description="the drive's CAN node id, 0 to 63", examples=[1])
    firmware: str = Field("0.6", description="the firmware's version", examples=["0.6"])
    watchdog_s: float = Field(
        0.1,
        alias="watchdog",
        ge=0,
        le=10,
        description='silence that makes the drive stop; "0 s" leaves the drive\'s watchdog as it is',
        examples=["100 ms"],
    )
    heartbeat_s: float = Field(
        0.1, alias="heartbeat", gt=0, le=10, description="the drive's heartbeat period", examples=["100 ms"]
    )
    counts_per_turn: int = Field(0, ge=0, description="encoder counts per turn; 0 where unknown", examples=[16384])
    watchdog_timeout_endpoint: int = Field(
        protocol.ENDPOINT_WATCHDOG_TIMEOUT, ge=0, le=0xFFFF, description="from the board's flat_endpoints.json"
    )
    enable_watchdog_endpoint: int = Field(
        protocol.ENDPOINT_ENABLE_WATCHDOG, ge=0, le=0xFFFF, description="from the board's flat_endpoints.json"
    )

    @field_validator("watchdog_s")
    @classmethod
    def _can_be_fed(cls, watchdog_s: float) -> float:
        if 0 < watchdog_s < 0.02:
            raise ValueError("shorter than a computer can be relied on to feed; at least 20 ms")
        return watchdog_s

    @field_validator("firmware")
    @classmethod
    def _is_supported(cls, firmware: str) -> str:
        if firmware != "0.6":
            raise ValueError("only ODrive firmware 0.6 is spoken here; update the drive")
        return firmware


class Message(Protocol):
    """Anything of the codec that can be sent."""

    COMMAND: ClassVar[protocol.Command]

    def encode(self) -> bytes: ...


def open_amplifier(settings: DeviceSettings, link: Link) -> "ODrive":
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return ODrive(settings, parse_options(ODriveOptions, settings), link.can_port(settings), link)


class ODrive:
    """One axis of an ODrive. ``malformed`` counts frames that could not be decoded."""

    command_unit = "N*m"

    def __init__(self, settings: DeviceSettings, options: ODriveOptions, port: CanPort, link: Link) -> None:
        self.role = settings.role
        self.options = options
        self.malformed = 0
        self.parameters: dict[int, bytes] = {}  # endpoint -> value, as answered
        self.heartbeat_timeout_ns = round(_HEARTBEATS_MISSED * options.heartbeat_s * 1e9)
        self._direction = settings.direction
        self._rad_per_turn = settings.direction * TURN_RAD
        self._port = port
        self._link = link
        self._versions: Inbox[protocol.Version] = Inbox()
        self._motion: Inbox[MotionReading] = Inbox()
        self._current: Inbox[CurrentReading] = Inbox()
        self._position_rev = 0.0
        self._temperature = protocol.Temperature(nan, nan)
        self._bus_voltage_v = nan
        self._heartbeat = protocol.Heartbeat(0, protocol.AxisState.UNDEFINED)
        self._heartbeat_ns: int | None = None
        self._heartbeats = 0
        self._disarm_bits = 0
        self._closed_loop_wanted = False
        self._status: DriveStatus | None = None  # as last told; None where it has changed since
        self._fed_ns = 0
        self._torque_id = protocol.arbitration_id(options.node, protocol.Command.SET_INPUT_TORQUE)
        self._handlers = self._handlers_by_id()
        port.subscribe(self._on_frame)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask for the version, and see that encoder estimates arrive."""
        asked = self._versions.count
        before = self._motion.count
        self.request(protocol.Command.VERSION)
        self.wait_for(
            lambda: self._versions.count > asked, timeout_s, "does not answer; is it powered and on this bus?"
        )
        version = self._versions.take()[-1]
        if version.firmware[:2] != (0, 6):
            said = ".".join(map(str, version.firmware))
            raise DeviceError(f"{self.place}: says it runs firmware {said}; only 0.6 is spoken here")
        self.wait_for(
            lambda: self._motion.count > before,
            timeout_s,
            "sends no encoder estimates; set axis0.config.can.encoder_msg_rate_ms = 1 in the drive and save",
        )
        return DeviceIdentity(
            driver="odrive",
            address=f"{self._port.name} node {self.options.node}",
            hardware=".".join(map(str, version.hardware)),
            firmware=".".join(map(str, version.firmware)),
        )

    def enable(self, timeout_s: float = 2.0) -> None:
        """Arm the watchdog, clear errors, close the torque loop at zero torque; return when the drive says so."""
        if self.options.watchdog_s > 0:
            arm_watchdog(self)
        self._disarm_bits = 0
        self._status = None
        self.send(protocol.ClearErrors())
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
        return self._direction * protocol.torque_of(payload)

    def take_motion(self) -> list[MotionReading]:
        return self._motion.take()

    def take_current(self) -> list[CurrentReading]:
        return self._current.take()

    def status(self) -> DriveStatus:
        # Asked every tick, but it changes only with the slow messages.
        if self._status is None:
            self._status = DriveStatus(
                state=self._state(),
                heartbeat_ns=self._heartbeat_ns,
                errors=self._errors(),
                transistor_temperature_c=self._temperature.transistor_c,
                motor_temperature_c=self._temperature.motor_c,
                bus_voltage_v=self._bus_voltage_v,
            )
        return self._status

    @property
    def position_resolution_rad(self) -> float:
        """The encoder's step, or that of the float32 turns on the wire at the present position if it is larger."""
        _, exponent = frexp(self._position_rev)
        wire_step_rev = ldexp(1.0, exponent - _FLOAT32_BITS)
        encoder_step_rev = 1 / self.options.counts_per_turn if self.options.counts_per_turn else 0.0
        return TURN_RAD * max(wire_step_rev, encoder_step_rev)

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        self.command(0.0)

    def made_itself_safe(self) -> bool | None:
        return self._heartbeat_ns is not None and not self._in_closed_loop

    def stop(self) -> None:
        """Zero torque, then idle, each tried whatever became of the other."""
        self._closed_loop_wanted = False
        self._status = None
        for message in (protocol.SetInputTorque(0.0), protocol.SetAxisState(protocol.AxisState.IDLE)):
            with suppress(Exception):
                self.send(message)

    # ---- What the watchdog's arming needs too --------------------------------------------------------------------

    @property
    def place(self) -> str:
        """Where the drive is, for error messages."""
        return f"[{self.role}] ODrive node {self.options.node} on {self._port.name}"

    def send(self, message: Message) -> None:
        """Send one message. Raises ConnectionFailedError."""
        self._port.send(protocol.arbitration_id(self.options.node, message.COMMAND), message.encode())

    def request(self, command: protocol.Command) -> None:
        """Ask for a message by remote frame. Raises ConnectionFailedError."""
        self._port.send(protocol.arbitration_id(self.options.node, command), b"", remote=True)

    def wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        """Poll until ``arrived()``, feeding the watchdog; raises DeviceTimeoutError saying ``otherwise``."""
        if not wait_until(arrived, self._link, timeout_s, meanwhile=self._feed):
            raise DeviceTimeoutError(f"{self.place}: {otherwise} ({timeout_s:g} s waited)")

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
        return since >= 1 and self._in_closed_loop and not self._heartbeat.error_bits

    def _reasons_to_refuse(self) -> tuple[str, ...]:
        if errors := self._errors():
            return errors
        result = self._heartbeat.procedure_result
        if self._in_closed_loop or result in (protocol.RESULT_SUCCESS, protocol.RESULT_BUSY):
            return ()
        return (words.describe_procedure_result(result),)

    @property
    def _in_closed_loop(self) -> bool:
        return self._heartbeat.axis_state == protocol.AxisState.CLOSED_LOOP_CONTROL

    def _state(self) -> DriveState:
        if self._heartbeat_ns is None:
            return DriveState.UNKNOWN
        if self._heartbeat.error_bits or (self._closed_loop_wanted and not self._in_closed_loop):
            return DriveState.FAULT
        return DriveState.ENABLED if self._in_closed_loop else DriveState.IDLE

    def _errors(self) -> tuple[str, ...]:
        errors = words.describe_errors(self._heartbeat.error_bits | self._disarm_bits)
        if errors or not self._closed_loop_wanted or self._in_closed_loop:
            return errors
        return (f"left closed loop without an error (now {words.describe_axis_state(self._heartbeat.axis_state)})",)

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _handlers_by_id(self) -> dict[int, Callable[[bytearray, int], None]]:
        handlers: dict[protocol.Command, Callable[[bytearray, int], None]] = {
            protocol.Command.VERSION: self._on_version,
            protocol.Command.HEARTBEAT: self._on_heartbeat,
            protocol.Command.ERROR: self._on_error,
            protocol.Command.TX_SDO: self._on_parameter,
            protocol.Command.ENCODER_ESTIMATES: self._on_encoder_estimates,
            protocol.Command.IQ: self._on_iq,
            protocol.Command.TEMPERATURE: self._on_temperature,
            protocol.Command.BUS_VOLTAGE_CURRENT: self._on_bus_voltage,
        }
        return {protocol.arbitration_id(self.options.node, command): call for command, call in handlers.items()}

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        handler = self._handlers.get(message.arbitration_id)
        if handler is None or message.is_extended_id or message.is_remote_frame:
            return
        try:
            handler(message.data, arrival_ns)
        except CodecError:
            self.malformed += 1

    def _on_encoder_estimates(self, data: bytearray, arrival_ns: int) -> None:
        position_rev, velocity_rev_s = protocol.estimates_of(data)
        self._position_rev = position_rev
        scale, motion = self._rad_per_turn, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, scale * position_rev, scale * velocity_rev_s))

    def _on_iq(self, data: bytearray, arrival_ns: int) -> None:
        measured_a = protocol.Iq.decode(data).measured_a
        self._current.put(CurrentReading(self._current.count, arrival_ns, self._direction * measured_a))

    def _on_heartbeat(self, data: bytearray, arrival_ns: int) -> None:
        self._heartbeat = protocol.Heartbeat.decode(data)
        self._status = None
        self._heartbeat_ns = arrival_ns
        self._heartbeats += 1
        if self._state() is not DriveState.FAULT:
            self._disarm_bits = 0
        elif not self._disarm_bits:
            with suppress(DeviceError):  # a lost bus shows elsewhere
                self.request(protocol.Command.ERROR)

    def _on_error(self, data: bytearray, arrival_ns: int) -> None:
        error = protocol.GetError.decode(data)
        self._status = None
        self._disarm_bits = error.active_bits | error.disarm_bits

    def _on_version(self, data: bytearray, arrival_ns: int) -> None:
        self._versions.put(protocol.Version.decode(data))

    def _on_parameter(self, data: bytearray, arrival_ns: int) -> None:
        answer = protocol.TxSdo.decode(data)
        self.parameters[answer.endpoint] = answer.value

    def _on_temperature(self, data: bytearray, arrival_ns: int) -> None:
        self._temperature = protocol.Temperature.decode(data)
        self._status = None

    def _on_bus_voltage(self, data: bytearray, arrival_ns: int) -> None:
        self._bus_voltage_v = protocol.BusVoltageCurrent.decode(data).voltage_v
        self._status = None
