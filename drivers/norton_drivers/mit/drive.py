"""Actuators in MIT mode (mini-cheetah, CubeMars AK) on CAN: torque out, motion in.

The drive speaks only when spoken to: every frame to it, a command or not, is answered with position, velocity and
torque as they were before the frame was obeyed. So there is motion as often as there are commands; while it is not
enabled it is asked with the frame that disables it. Nothing in a reply says whether it is enabled. After its timeout
the drive obeys a command of zero, and stays enabled. Exactly zero torque cannot be sent: what is sent instead is the
nearest code, half a step off. Sources: bgkatz/motorcontrol, Core/Src/stm32f4xx_it.c (reply before obedience; special
frames do not feed the timeout), fsm.c (timeout; enabled with the command that was stored last), can.c, main.c
(timeout of 1000 control cycles by default); neurobionics/TMotorCANControl, mit_can.py (CubeMars' drives wrap).
"""

from collections.abc import Callable
from contextlib import suppress
from math import inf, nan
from typing import ClassVar, Literal

import can
from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.can_drive import CanDrive
from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.mit import Ranges, Reply, Special
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.mit.replies import MitShaft, OutOfRangeError, answers, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from norton_drivers.wiring import DeviceOptions, DeviceSettings, parse_options

SILENT_NS = 150_000_000
QUESTION_PERIOD_NS = 10_000_000
# When the probe of the watchdog is looked at: once it flows, and once it should have ended.
PROBE_FLOWS_NS = 20_000_000
PROBE_ENDED_NS = 60_000_000  # after the timeout
LEAST_PROBE_STEPS = 8

CONNECTION = "can"
BITRATE = "1 Mbit/s"
OPTION_UNITS = {
    "position_range": "rad",
    "velocity_range": "rad/s",
    "torque_range": "N*m",
    "torque_constant": "N*m/A",
    "watchdog": "s",
    "watchdog_probe": "N*m",
}


class MitOptions(DeviceOptions):
    """What a rig file may say of an actuator in MIT mode."""

    asked: ClassVar = ("beyond_range", "watchdog")
    command_units: ClassVar = {"N*m": {}}

    node: int = Field(ge=0, le=protocol.NODE_MAX, description="the motor's CAN id", examples=[1])
    master: int = Field(0, ge=0, le=protocol.IDENTIFIER_MAX, description="the CAN id that its replies come with")
    position_range_rad: float = Field(
        alias="position_range",
        gt=0,
        description="positions go from minus to plus this; as in the drive's own table",
        examples=["12.5 rad"],
    )
    velocity_range_rad_s: float = Field(
        alias="velocity_range",
        gt=0,
        description="velocities go from minus to plus this; as in the drive's own table",
        examples=["50 rad/s"],
    )
    torque_range_nm: float = Field(
        alias="torque_range",
        gt=0,
        description="torques go from minus to plus this; as in the drive's own table: a wrong one scales every torque",
        examples=["18 N*m"],
    )
    beyond_range: Literal["saturates", "wraps"] = Field(
        "saturates", description='what the position does there: "saturates", which stops the experiment, or "wraps"'
    )
    torque_constant_nm_a: float | None = Field(
        None,
        alias="torque_constant",
        gt=0,
        description="for telling the current from the torque in a reply",
        examples=["0.1 N*m/A"],
    )
    temperature_offset_c: float = Field(
        0.0,
        alias="temperature_offset",
        ge=-40,
        le=0,
        description="added to the temperature byte where a drive sends one: 0, or -40 by later manuals",
        examples=[-40],
    )
    watchdog_s: float = Field(
        0.0,
        alias="watchdog",
        ge=0,
        description="the timeout set in the drive; 0 where there is none, or nobody knows",
        examples=["200 ms"],
    )
    watchdog_probe_nm: float = Field(
        0.0,
        alias="watchdog_probe",
        ge=0,
        description="torque whose end shows the timeout at work; too small to turn the shaft, 0 for none",
        examples=["0.01 N*m"],
    )

    @property
    def ranges(self) -> Ranges:
        return Ranges(self.position_range_rad, self.velocity_range_rad_s, self.torque_range_nm)

    @property
    def greatest_position_rad(self) -> float:
        return self.position_range_rad if self.beyond_range == "saturates" else inf

    @property
    def greatest_velocity_rad_s(self) -> float:
        return self.velocity_range_rad_s

    @field_validator("watchdog_probe_nm")
    @classmethod
    def _can_be_seen(cls, probe_nm: float, info: ValidationInfo) -> float:
        least_nm = LEAST_PROBE_STEPS * Ranges(1.0, 1.0, info.data.get("torque_range_nm", 0.0)).torque_step_nm
        if 0 < probe_nm < least_nm:
            raise ValueError(f"cannot be told from nothing in steps of torque_range; at least {least_nm:.2g} N*m")
        return probe_nm


def open_amplifier(settings: DeviceSettings, link: Link) -> "MitActuator":
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return MitActuator(settings, parse_options(MitOptions, settings), link.can_port(settings), link)


class MitActuator(CanDrive):
    """One motor. ``malformed`` counts its replies that could not be decoded."""

    command_unit = "N*m"
    heartbeat_timeout_ns = SILENT_NS

    def __init__(self, settings: DeviceSettings, options: MitOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings)
        self.options = options
        self.malformed = 0
        self._port = port
        self._link = link
        self._ranges = options.ranges
        self._shaft = MitShaft(self._ranges, wraps=options.beyond_range == "wraps")
        self._reply: Reply | None = None
        self._replies, self._reply_ns = 0, 0
        self._strangers: set[str] = set()  # who answered otherwise than this motor should
        self._enabled = False
        self._resting = True  # whether it is asked with the frame that disables it
        self._faults: tuple[str, ...] = ()  # since it was enabled
        self._idle_from = 0  # the count of replies that first follows the last stop
        self._asked_ns: int | None = None
        self._provoked_ns: int | None = None
        self._probe_flowed = self._probe_ended = False
        port.subscribe(self._on_frame)
        link.questions.append(self._ask_now_and_then)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Disable the motor, which it answers: a drive in MIT mode tells nothing else of itself."""
        replies = self._replies
        self._rest()
        if not wait_until(lambda: self._replies > replies, self._link, timeout_s):
            received = f"; heard {', '.join(sorted(self._strangers))}" if self._strangers else ""
            raise DeviceTimeoutError(
                f"{self._place}: does not answer ({timeout_s:g} s waited{received}); is it powered and in MIT mode, "
                f"and are node and master (now 0x{self.options.master:X}) what is set in it?"
            )
        return DeviceIdentity(driver="mit", address=f"{self._port.name} node {self.options.node}")

    def enable(self, timeout_s: float = 2.0) -> None:
        """Leave a command of zero, enable the motor, and see that it answers without an error."""
        self._rest()
        self._faults, self._status = (), None
        self._shaft.forget()
        self._await_replies(2, timeout_s)  # the first may have been on its way
        self._refuse_faults()
        self._resting = False
        self.command(0.0)  # the drive begins with the command that it had last
        self._send(Special.ENABLE)
        self._await_replies(3, timeout_s, self._feed)
        self._refuse_faults()
        self._enabled, self._status = True, None

    def command(self, value: float) -> float:
        """Command a torque [N m]; returns the nearest that can be sent. Raises ConnectionFailedError, DeviceError."""
        try:
            code = self._ranges.command_code(self._direction * value)
        except CodecError as error:
            raise DeviceError(f"{self._place}: cannot command a torque of {value} N*m") from error
        self._provoked_ns = None
        self._port.send(self.options.node, protocol.command_value(code))
        return self._direction * self._ranges.commanded_nm(code)

    @property
    def position_resolution_rad(self) -> float:
        """The step of the position in a reply."""
        return self._ranges.position_step_rad

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        """The probe's torque, where the rig gives one; a frame that is no command shows how it ends."""
        self.command(self.options.watchdog_probe_nm)
        self._provoked_ns = self._link.clock.now_ns()
        self._probe_flowed = self._probe_ended = False

    def made_itself_safe(self) -> bool | None:
        return self._probe_ended if self._probe_flowed else None

    def stop(self) -> None:
        """A command of zero, and the frame that disables; that one again and again until it is enabled."""
        self._enabled, self._status = False, None
        self._idle_from = self._replies + 3  # after one on its way and those to the frames sent here
        with suppress(Exception):
            self.command(0.0)
        self._resting = True
        with suppress(Exception):
            self._send(Special.DISABLE)

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _send(self, special: Special) -> None:
        self._asked_ns = self._link.clock.now_ns()
        self._port.send(self.options.node, special.encode())

    def _rest(self) -> None:
        self._enabled, self._resting, self._provoked_ns = False, True, None
        self._send(Special.DISABLE)

    def _feed(self) -> None:
        now_ns = self._link.clock.now_ns()
        if self._asked_ns is None or now_ns - self._asked_ns >= QUESTION_PERIOD_NS:
            self._asked_ns = now_ns
            self.command(0.0)

    def _ask_now_and_then(self) -> None:
        """Called before every poll."""
        now_ns = self._link.clock.now_ns()
        if self._asked_ns is not None and now_ns - self._asked_ns < QUESTION_PERIOD_NS:
            return
        if self._resting:
            self._send(Special.DISABLE)
        elif self._provoked_ns is not None and self._may_look(now_ns - self._provoked_ns):
            self._send(Special.ENABLE)

    def _may_look(self, silent_ns: int) -> bool:
        """Whether the provoked drive may be asked: as seldom as will do, in case that its firmware counts it."""
        if silent_ns >= self.options.watchdog_s * 1e9 + PROBE_ENDED_NS:
            return True
        return not self._probe_flowed and silent_ns >= PROBE_FLOWS_NS

    def _await_replies(self, count: int, timeout_s: float, meanwhile: Callable[[], None] | None = None) -> None:
        wanted = self._replies + count
        if not wait_until(lambda: self._replies >= wanted, self._link, timeout_s, meanwhile):
            raise DeviceTimeoutError(f"{self._place}: does not answer ({timeout_s:g} s waited)")

    def _refuse_faults(self) -> None:
        if errors := self._faults or self._present_error():
            raise DeviceError(f"{self._place}: cannot be enabled: {'; '.join(errors)}")

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] MIT motor {self.options.node} on {self._port.name}"

    def _new_status(self) -> DriveStatus:
        reply = self._reply
        warmth = None if reply is None else reply.temperature
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=None if reply is None else self._reply_ns,
            errors=self._faults or self._present_error(),
            motor_temperature_c=nan if warmth is None else warmth + self.options.temperature_offset_c,
        )

    def _state(self) -> DriveState:
        if self._reply is None:
            return DriveState.UNKNOWN
        if self._faults or self._present_error():
            return DriveState.FAULT
        return DriveState.ENABLED if self._enabled or self._replies < self._idle_from else DriveState.IDLE

    def _present_error(self) -> tuple[str, ...]:
        error = None if self._reply is None else self._reply.error
        return (protocol.describe_error(error),) if error else ()

    def _note_fault(self, words: str) -> None:
        if words not in self._faults:
            self._faults = (*self._faults, words)

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if message.is_extended_id or message.is_remote_frame:
            return
        data = message.data
        if message.arbitration_id != self.options.master or not data or data[0] != self.options.node:
            self._note_stranger(message)
            return
        try:
            self._on_reply(Reply.decode(data), arrival_ns)
        except CodecError:
            self.malformed += 1

    def _note_stranger(self, message: can.Message) -> None:
        if self._reply is None and message.data and len(self._strangers) < 4:
            self._strangers.add(f"node {message.data[0]} with id 0x{message.arbitration_id:X}")

    def _on_reply(self, reply: Reply, arrival_ns: int) -> None:
        self._reply, self._reply_ns = reply, arrival_ns
        self._replies += 1
        self._status = None
        if self._enabled:
            for words in self._present_error():
                self._note_fault(words)
        self._look_at_probe(reply, arrival_ns)
        self._on_motion(reply, arrival_ns)
        if self.options.torque_constant_nm_a is not None:
            current_a = self._direction * self._ranges.torque_of(reply.torque_code) / self.options.torque_constant_nm_a
            self._current.put(CurrentReading(self._current.count, arrival_ns, current_a))

    def _on_motion(self, reply: Reply, arrival_ns: int) -> None:
        try:
            position_rad, velocity_rad_s = self._shaft.follow(reply.position_code, reply.velocity_code, arrival_ns)
        except OutOfRangeError as error:
            # No reading rather than a wrong one; the guard sees the fault with its next tick.
            self._note_fault(str(error))
            return
        sign, motion = self._direction, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, sign * position_rad, sign * velocity_rad_s))

    def _look_at_probe(self, reply: Reply, arrival_ns: int) -> None:
        if self._provoked_ns is None or not self.options.watchdog_probe_nm:
            return
        flows = abs(self._ranges.torque_of(reply.torque_code)) >= 0.5 * self.options.watchdog_probe_nm
        self._probe_ended = self._probe_flowed and not flows
        self._probe_flowed |= flows
