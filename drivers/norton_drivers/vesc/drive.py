"""VESC motor controllers on CAN: current, torque or duty cycle out, motion, current and faults in.

The drive sends its STATUS messages by itself, at the rates set with VESC Tool. It has no state "enabled": it obeys
every command, and lets go of the motor where none comes for its timeout, which cannot be set over CAN. STATUS tells of
no fault, and a fault clears itself after half a second: so the fault code is asked for all the while, and one that was
seen stays until the next :meth:`Vesc.enable`. Sources: vedderb/bldc, comm/comm_can.c, timeout.c (released after the
timeout, with the default brake current of zero), motor/mcpwm_foc.c (released below the minimum current; signs),
applications/appconf_default.h (timeout of 1000 ms, all status messages off).
"""

from collections.abc import Callable
from math import nan
from typing import ClassVar

import can
from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import Packet, describe_fault
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveStatus, MotionReading
from norton_drivers.vesc.current import CurrentDrive
from norton_drivers.vesc.messages import VescQueries, answers, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.vesc.motor import MOTOR_UNITS, VescMotorOptions, fault_words
from norton_drivers.vesc.shaft import VescShaft
from norton_drivers.wiring import DeviceSettings, parse_options

SILENT_NS = 250_000_000  # longer than a busy host may forget to ask
_MOTOR_CONTROLLER = 0
_CODES_PER_TURN = 18_000  # of the angle in STATUS_4

CONNECTION = "can"
BITRATE = "500 kbit/s"  # as it is delivered: appconf_default.h, APPCONF_CAN_BAUD_RATE
OPTION_UNITS = {**MOTOR_UNITS, "watchdog_probe": "A"}


class VescOptions(VescMotorOptions):
    """What a rig file may say of a VESC on CAN."""

    node: int = Field(ge=0, le=protocol.NODE_MAX, description="the VESC ID, 0 to 254", examples=[1])
    watchdog_probe_a: float = Field(
        0.0,
        alias="watchdog_probe",
        ge=0,
        description="current whose end shows the timeout at work; too small to turn the shaft, 0 for none",
        examples=["0.3 A"],
    )
    host_node: int = Field(254, ge=0, le=protocol.NODE_MAX, description="the VESC ID that this computer answers to")

    @field_validator("watchdog_probe_a")
    @classmethod
    def _can_be_seen(cls, probe_a: float) -> float:
        if 0 < probe_a < 0.3:
            raise ValueError("cannot be told from nothing in steps of 0.1 A; at least 0.3 A")
        return probe_a

    @field_validator("host_node")
    @classmethod
    def _is_another(cls, host_node: int, info: ValidationInfo) -> int:
        if host_node == info.data.get("node"):
            raise ValueError("is the drive's own; choose one that no device on the bus has")
        return host_node


def open_amplifier(settings: DeviceSettings, link: Link) -> "Vesc":
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return Vesc(settings, parse_options(VescOptions, settings), link.can_port(settings), link)


class Vesc(CurrentDrive):
    """One motor of a VESC."""

    _kind: ClassVar = "VESC"

    heartbeat_timeout_ns = SILENT_NS

    def __init__(self, settings: DeviceSettings, options: VescOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings, options, port, link)
        self.options = options
        self._queries = VescQueries(options.node, options.host_node, port, link.clock)
        pole_pairs, encoder = options.pole_pairs, options.position == "encoder"
        self._shaft = (
            VescShaft.by_encoder(pole_pairs, _CODES_PER_TURN) if encoder else VescShaft.by_tachometer(pole_pairs)
        )
        self._undecoded = 0
        self._frame = protocol.Status(0.0, 0.0, 0.0)
        self._temperatures = protocol.Status4(nan, nan, nan, nan)
        self._supply_v = nan
        self._handlers = self._handlers_by_id()
        port.subscribe(self._on_frame)
        link.questions.append(self._queries.ask_fault_now_and_then)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ping, ask for the version and the fault code, and see that the status messages arrive."""
        self._ping(timeout_s)
        major, minor, hardware = self._ask_version(timeout_s)
        queries, told, frames, moved = self._queries, self._queries.faults_told, self._frames, self._motion.count
        self._wait_for(
            lambda: queries.faults_told > told, timeout_s, "does not tell its fault code; update its firmware"
        )
        setting = "in VESC Tool, App Settings, General, switch CAN Status Message"
        self._wait_for(lambda: self._frames > frames, timeout_s, f"sends no STATUS; {setting} 1 on, at the loop's rate")
        number = 4 if self.options.position == "encoder" else 5
        self._wait_for(
            lambda: self._motion.count > moved, timeout_s, f"sends no STATUS_{number}; {setting} {number} on too"
        )
        return DeviceIdentity(
            driver="vesc",
            address=f"{self._port.name} VESC ID {self.options.node}",
            hardware=hardware,
            firmware=f"{major}.{minor:02d}",
        )

    def enable(self, timeout_s: float = 2.0) -> None:
        """See that there is no fault, and command zero; there is no state to enter."""
        queries, told = self._queries, self._queries.faults_told
        self._enabled, self._status = False, None
        self._faults.forget()
        faultless = wait_until(lambda: queries.faults_told > told and not queries.fault, self._link, timeout_s)
        if queries.faults_told == told:
            raise DeviceTimeoutError(f"{self._place}: does not tell its fault code ({timeout_s:g} s waited)")
        if not faultless:
            raise DeviceError(f"{self._place}: refuses to drive its motor: {describe_fault(queries.fault)}")
        self.command(0.0)
        frames = self._frames
        self._wait_for(lambda: self._frames > frames, timeout_s, "sends no STATUS")
        self._enabled, self._status = True, None

    @property
    def malformed(self) -> int:
        """Frames that could not be decoded, and packets that could not be put together."""
        return self._undecoded + self._queries.malformed

    @property
    def position_resolution_rad(self) -> float:
        """The step of STATUS_4's angle, or a sixth of an electrical turn."""
        return self._shaft.step_rad

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _ping(self, timeout_s: float) -> None:
        pongs, asked = self._queries.pongs, self._queries.pongs.count
        self._queries.ping()
        self._wait_for(
            lambda: pongs.count > asked,
            timeout_s,
            "does not answer a ping; is it powered, and are CAN Mode (VESC), VESC ID and baud rate set in it as here?",
        )
        if (kind := pongs.take()[-1]) != _MOTOR_CONTROLLER:
            raise DeviceError(
                f"{self._place}: is no motor controller (hardware type {kind}); give one's VESC ID as node"
            )

    def _ask_version(self, timeout_s: float) -> tuple[int, int, str]:
        versions, asked = self._queries.versions, self._queries.versions.count
        self._queries.ask_version()
        self._wait_for(lambda: versions.count > asked, timeout_s, "does not tell its firmware's version")
        return versions.take()[-1]

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _heard(self) -> bool:
        return self._frames > 0 and self._queries.faults_told > 0

    def _new_status(self) -> DriveStatus:
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=min(self._frame_ns, self._queries.fault_ns) if self._heard else None,
            errors=self._faults.words(),
            transistor_temperature_c=self._temperatures.transistor_c,
            motor_temperature_c=self._temperatures.motor_c,
            bus_voltage_v=self._supply_v,
        )

    @property
    def _flowing_a(self) -> float:
        return self._frame.drawn_a

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _handlers_by_id(self) -> dict[int, Callable[[bytearray, int], None]]:
        handlers: dict[Packet, Callable[[bytearray, int], None]] = {
            Packet.STATUS: self._on_status,
            Packet.STATUS_4: self._on_status_4,
            Packet.STATUS_5: self._on_status_5,
        }
        return {protocol.arbitration_id(packet, self.options.node): call for packet, call in handlers.items()}

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if not message.is_extended_id or message.is_remote_frame:
            return
        handler = self._handlers.get(message.arbitration_id)
        try:
            if handler is not None:
                handler(message.data, arrival_ns)
            elif self._queries.on_frame(message.arbitration_id, message.data, arrival_ns):
                self._on_fault_told()
        except CodecError:
            self._undecoded += 1

    def _on_status(self, data: bytearray, arrival_ns: int) -> None:
        frame = self._frame = protocol.Status.decode(data)
        self._on_current(arrival_ns)
        self._shaft.on_erpm(frame.erpm)
        if frame.current_a is not None:
            current_a = self._direction * protocol.middle(frame.current_a, protocol.CURRENT_STEP_A)
            self._current.put(CurrentReading(self._current.count, arrival_ns, current_a))

    def _on_status_4(self, data: bytearray, arrival_ns: int) -> None:
        self._temperatures = protocol.Status4.decode(data)
        self._status = None
        if self.options.position == "encoder":
            self._on_position(round(self._temperatures.position_deg / protocol.POSITION_STEP_DEG), arrival_ns)

    def _on_status_5(self, data: bytearray, arrival_ns: int) -> None:
        frame = protocol.Status5.decode(data)
        self._supply_v = frame.supply_v
        self._status = None
        if self.options.position == "tachometer":
            self._on_position(frame.tachometer, arrival_ns)

    def _on_position(self, code: int, arrival_ns: int) -> None:
        velocity_rad_s = self._shaft.velocity_rad_s
        if velocity_rad_s is None:
            return
        position_rad = self._shaft.position_rad(code, arrival_ns)
        sign, motion = self._direction, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, sign * position_rad, sign * velocity_rad_s))

    def _on_fault_told(self) -> None:
        self._status = None
        self._faults.tell(fault_words(self._queries.fault), kept=self._enabled)
