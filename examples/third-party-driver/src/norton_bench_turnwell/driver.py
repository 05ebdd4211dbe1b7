"""Turnwell T1 drives: torque commands out, motion, current and state in."""

import struct
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import can
from pydantic import Field

from norton_bench_turnwell import protocol
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, Inbox, MotionReading
from norton_drivers.registry import Recognised
from norton_drivers.wiring import DeviceOptions, DeviceSettings, parse_options

FIRMWARES = (3, 4)
STATE_PERIOD_NS = 20_000_000
WATCHDOG_S = 0.1

# Of the options below none is a quantity; a drive with a settable watchdog would say {"watchdog": "s"}.
OPTION_UNITS: dict[str, str] = {}
CONNECTION = "can"


class TurnwellOptions(DeviceOptions):
    """What a rig file may say of a Turnwell T1."""

    node: int = Field(ge=1, le=protocol.NODE_MAX, description="the drive's node number", examples=[5])


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """A state message is sure; other frames only tell more of a node that sends one."""
    kind, node = message.arbitration_id & ~protocol.NODE_MAX, message.arbitration_id & protocol.NODE_MAX
    if message.is_extended_id or message.is_remote_frame or not node:
        return None
    device, options = "a Turnwell T1", {"node": node}
    if kind == protocol.STATE and message.dlc == 3 and message.data[0] <= protocol.FAILED:
        return Recognised(device, "state", options)
    if kind == protocol.MOTION and message.dlc == 8:
        return Recognised(device, "motion", options, sure=False)
    if kind == protocol.COMMAND:
        return Recognised(device, "command", options, sure=False, from_host=True)
    return None


def open_amplifier(settings: DeviceSettings, link: Link) -> "Turnwell":
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return Turnwell(settings, parse_options(TurnwellOptions, settings), link.can_port(settings), link)


class Turnwell:
    """``malformed`` counts frames that could not be decoded."""

    command_unit = "N*m"
    heartbeat_timeout_ns = 3 * STATE_PERIOD_NS
    position_resolution_rad = protocol.motion_of(bytes([1, *bytes(7)])).position_rad
    watchdog_s = WATCHDOG_S

    def __init__(self, settings: DeviceSettings, options: TurnwellOptions, port: CanPort, link: Link) -> None:
        self.role = settings.role
        self.malformed = 0
        self._direction = settings.direction
        self._node = options.node
        self._port = port
        self._link = link
        self._motion: Inbox[MotionReading] = Inbox()
        self._current: Inbox[CurrentReading] = Inbox()
        self._state = protocol.State(protocol.IDLE, 0, 0)
        self._state_ns: int | None = None
        self._wanted = protocol.IDLE
        self._handlers = {protocol.MOTION + self._node: self._on_motion, protocol.STATE + self._node: self._on_state}
        port.subscribe(self._on_frame)

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        self._state_ns = None
        self._wait_for(lambda: self._state_ns is not None, timeout_s, "does not answer; check power, bus and node")
        if self._state.firmware not in FIRMWARES:
            raise DeviceError(
                f"{self._place}: runs firmware {self._state.firmware}; only 3 and 4 are spoken; update it"
            )
        before = self._motion.count
        self._wait_for(lambda: self._motion.count > before, timeout_s, "sends no motion; switch on its 1 kHz stream")
        return DeviceIdentity("turnwell", f"{self._port.name} node {self._node}", firmware=str(self._state.firmware))

    def enable(self, timeout_s: float = 2.0) -> None:
        self._port.send(protocol.CLEAR + self._node, b"")
        self._state_ns, self._wanted = None, protocol.TORQUE
        try:
            self._wait_for(self._is_enabled, timeout_s, "did not close its torque loop", feed=True)
        except DeviceError:
            self._wanted = protocol.IDLE
            raise

    def command(self, value: float) -> None:
        try:
            data = protocol.command(self._wanted, self._direction * value)
        except ValueError as error:
            raise DeviceError(f"{self._place}: {error}") from error
        self._port.send(protocol.COMMAND + self._node, data)

    def take_motion(self) -> list[MotionReading]:
        return self._motion.take()

    def take_current(self) -> list[CurrentReading]:
        return self._current.take()

    def status(self) -> DriveStatus:
        errors = (protocol.ERRORS.get(self._state.error, f"error {self._state.error}"),) if self._state.error else ()
        return DriveStatus(self._drive_state(), self._state_ns, errors)

    def provoke_watchdog(self) -> None:
        self.command(0.0)

    def made_itself_safe(self) -> bool | None:
        return self._state.state != protocol.TORQUE

    def stop(self) -> None:
        self._wanted = protocol.IDLE
        with suppress(Exception):
            self.command(0.0)

    # ---- What is behind it ---------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] Turnwell node {self._node} on {self._port.name}"

    def _wait_for(self, arrived, timeout_s: float, otherwise: str, *, feed: bool = False) -> None:
        meanwhile = (lambda: self.command(0.0)) if feed else None
        if not wait_until(arrived, self._link, timeout_s, meanwhile):
            raise DeviceTimeoutError(f"{self._place}: {otherwise} ({timeout_s:g} s waited)")

    def _is_enabled(self) -> bool:
        return self._state_ns is not None and self._state.state == protocol.TORQUE

    def _drive_state(self) -> DriveState:
        if self._state_ns is None:
            return DriveState.UNKNOWN
        if self._state.state == protocol.FAILED or (self._wanted != protocol.IDLE and not self._is_enabled()):
            return DriveState.FAULT
        return DriveState.ENABLED if self._is_enabled() else DriveState.IDLE

    def _on_frame(self, frame: can.Message, arrival_ns: int) -> None:
        handler = self._handlers.get(frame.arbitration_id)
        if handler is None or frame.is_extended_id or frame.is_remote_frame:
            return
        try:
            handler(bytes(frame.data), arrival_ns)
        except struct.error:
            self.malformed += 1

    def _on_motion(self, data: bytes, arrival_ns: int) -> None:
        said, sign = protocol.motion_of(data), self._direction
        motion, current = self._motion, self._current
        motion.put(MotionReading(motion.count, arrival_ns, sign * said.position_rad, sign * said.velocity_rad_s))
        current.put(CurrentReading(current.count, arrival_ns, sign * said.current_a))

    def _on_state(self, data: bytes, arrival_ns: int) -> None:
        self._state, self._state_ns = protocol.state_of(data), arrival_ns
