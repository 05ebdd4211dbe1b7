"""Actuators in MIT mode (mini-cheetah, CubeMars AK) on CAN: torques or goals out, motion in.

The drive speaks only when spoken to: every frame to it, a command or not, is answered with position, velocity and
torque as they were before the frame was obeyed. So there is motion as often as there are commands; while it is not
enabled it is asked with the frame that disables it. Nothing in a reply says whether it is enabled. After its timeout
the drive obeys a command of zero, and stays enabled. Exactly zero torque cannot be sent: what is sent instead is the
nearest code, half a step off. Sources: bgkatz/motorcontrol, Core/Src/stm32f4xx_it.c (reply before obedience; special
frames do not feed the timeout), fsm.c (timeout; enabled with the command that was stored last), can.c, main.c
(timeout of 1000 control cycles by default), foc.c (``torque_control``: the position loop), position_sensor.c (velocity
over 19 cycles of 25 µs); neurobionics/TMotorCANControl, mit_can.py (CubeMars' drives wrap).
"""

from collections.abc import Callable
from contextlib import suppress
from math import nan

import can

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.mit import Reply, Special
from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.mit.goals import Goals
from norton_drivers.mit.options import MitOptions
from norton_drivers.mit.replies import MitShaft, OutOfRangeError
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from norton_drivers.wiring import DeviceSettings

SILENT_NS = 150_000_000
QUESTION_PERIOD_NS = 10_000_000
# When the probe of the watchdog is looked at: once it flows, and once it should have ended.
PROBE_FLOWS_NS = 20_000_000
PROBE_ENDED_NS = 60_000_000  # after the timeout


class MitActuator(DriveBase):
    """One motor. ``malformed`` counts its replies that could not be decoded."""

    heartbeat_timeout_ns = SILENT_NS

    def __init__(self, settings: DeviceSettings, options: MitOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings)
        self.options = options
        self.malformed = 0
        self._port = port
        self._link = link
        self._ranges = options.ranges
        self.command_unit = options.command_unit or ""
        self._goals = None if options.servo is None else Goals(options.ranges, options.servo)
        self._position_rad = 0.0  # in its own sense
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
        self._begin_goals()
        self._resting = False
        self.command(0.0)  # the drive begins with the command that it had last
        self._send(Special.ENABLE)
        self._await_replies(3, timeout_s, self._feed)
        self._refuse_faults()
        self._enabled, self._status = True, None

    def command(self, value: float) -> float:
        """Command a torque [N m], or a position [rad]; returns what is sent: the nearest that can be, or, soon after
        it was enabled away from zero, where it is led. Raises ConnectionFailedError, DeviceError."""
        try:
            frame, sent = self._frame(self._direction * value)
        except CodecError as error:
            raise DeviceError(f"{self._place}: cannot command {value} {self.command_unit}") from error
        self._provoked_ns = None
        self._port.send(self.options.node, frame)
        return self._direction * sent

    def _frame(self, value: float) -> tuple[bytes, float]:
        if self._goals is not None:
            return self._goals.frame(value, self._link.clock.now_ns())
        return self._torque_frame(value)

    def _torque_frame(self, torque_nm: float) -> tuple[bytes, float]:
        code = self._ranges.command_code(torque_nm)
        return protocol.command_value(code), self._ranges.commanded_nm(code)

    def _begin_goals(self) -> None:
        if self._goals is not None:
            try:
                self._goals.begin(self._position_rad, self._link.clock.now_ns())
            except DeviceError as error:
                raise DeviceError(f"{self._place}: cannot be enabled: {error}") from error

    @property
    def position_resolution_rad(self) -> float:
        """The step of the position in a reply."""
        return self._ranges.position_step_rad

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        """The probe's torque, where the rig gives one; a frame that is no command shows how it ends."""
        self._port.send(self.options.node, self._torque_frame(self.options.watchdog_probe_nm)[0])
        self._provoked_ns = self._link.clock.now_ns()
        self._probe_flowed = self._probe_ended = False

    def made_itself_safe(self) -> bool | None:
        return self._probe_ended if self._probe_flowed else None

    def stop(self) -> None:
        """A command of no torque, and the frame that disables; that one again and again until it is enabled."""
        self._enabled, self._status = False, None
        self._idle_from = self._replies + 3  # after one on its way and those to the frames sent here
        with suppress(Exception):
            self._port.send(self.options.node, self._torque_frame(0.0)[0])
        self._provoked_ns, self._resting = None, True
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
        self._position_rad = position_rad
        sign, motion = self._direction, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, sign * position_rad, sign * velocity_rad_s))

    def _look_at_probe(self, reply: Reply, arrival_ns: int) -> None:
        if self._provoked_ns is None or not self.options.watchdog_probe_nm:
            return
        flows = abs(self._ranges.torque_of(reply.torque_code)) >= 0.5 * self.options.watchdog_probe_nm
        self._probe_ended = self._probe_flowed and not flows
        self._probe_flowed |= flows
