"""A motor that speaks only when it is spoken to: every frame to it, a command or not, is answered with its motion.

So there is motion as often as there are commands; while it is not enabled it is asked now and then. Nothing is asked of
a motor that was left alone for its watchdog, but what a family knows to leave the watchdog alone.
"""

from collections.abc import Callable
from contextlib import suppress
from math import nan
from typing import ClassVar, NamedTuple, Protocol

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.ranges import GoalCodes, Ranges
from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DriveState, DriveStatus, MotionReading
from norton_drivers.servo import Servo
from norton_drivers.spoken_to.goals import Goals
from norton_drivers.spoken_to.shaft import OutOfRangeError, RangedShaft
from norton_drivers.wiring import DeviceSettings

SILENT_NS = 150_000_000
QUESTION_PERIOD_NS = 10_000_000
ASKED_AGAIN_NS = 20_000_000
PROBE_ENDED_NS = 60_000_000  # after the timeout: then the watchdog should have acted
_STRANGERS = 4

Addressed = tuple[int, bytes]  # a frame: its identifier and its payload


class Answer(NamedTuple):
    """What a motor says. ``enabled`` is None where it does not tell; ``error`` is in words."""

    position_code: int
    velocity_code: int
    torque_code: int
    enabled: bool | None = None
    error: str = ""
    motor_c: float = nan
    transistor_c: float = nan


class SpokenToOptions(Protocol):
    """What every family's options have."""

    @property
    def node(self) -> int: ...
    @property
    def command_unit(self) -> str | None: ...
    @property
    def beyond_range(self) -> str: ...
    @property
    def torque_constant_nm_a(self) -> float | None: ...
    @property
    def servo(self) -> Servo | None: ...
    @property
    def watchdog_s(self) -> float: ...


class SpokenToDrive(DriveBase):
    """One motor. ``malformed`` counts its answers that could not be decoded."""

    heartbeat_timeout_ns = SILENT_NS
    _kind: ClassVar[str]
    _extended: ClassVar[bool] = False

    def __init__(self, settings: DeviceSettings, options: SpokenToOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings)
        self.malformed = 0
        self.command_unit = options.command_unit or ""
        self._common = options
        self._port = port
        self._link = link
        self._ranges: Ranges | None = None
        self._shaft: RangedShaft | None = None
        self._goals: Goals[Addressed] | None = None
        self._position_rad = 0.0  # in its own sense
        self._told: Answer | None = None
        self._answers, self._answer_ns = 0, 0
        self._strangers: set[str] = set()  # who answered otherwise than this motor should
        self._enabled = False
        self._resting = True  # whether it is asked, and to be disabled
        self._faults: tuple[str, ...] = ()  # since it was enabled
        self._idle_from = 0  # the count of answers that first follows the last stop
        self._asked_ns: int | None = None
        self._provoked_ns: int | None = None
        self._made_safe = False
        link.questions.append(self._ask_now_and_then)

    # ---- What a family is ----------------------------------------------------------------------------------------

    def _pack_torque(self, code: int) -> Addressed:
        """A command of torque alone."""
        raise NotImplementedError

    def _pack_goal(self, codes: GoalCodes) -> Addressed:
        """A command of a position or a velocity."""
        raise NotImplementedError

    def _send_enable(self) -> None:
        raise NotImplementedError

    def _send_disable(self) -> None:
        """Also a question."""
        raise NotImplementedError

    def _ask_resting(self) -> None:
        """Ask a motor that is to rest; one that does not is disabled once more."""
        self._send_disable()

    def _ask_provoked(self, silent_ns: int) -> None:
        """Ask a motor that has been left alone for so long, without feeding its watchdog, whether it drives."""
        raise NotImplementedError

    def _prepare(self, timeout_s: float) -> None:
        """What is set before it is enabled. Raises DeviceError, DeviceTimeoutError."""

    def _know(self, ranges: Ranges) -> None:
        """From now on its integers span ``ranges``."""
        if ranges != self._ranges:
            self._ranges = ranges
            self._shaft = RangedShaft(ranges, wraps=self._common.beyond_range == "wraps")
            servo = self._common.servo
            self._goals = None if servo is None else Goals(ranges, servo, self._pack_goal)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def enable(self, timeout_s: float = 2.0) -> None:
        """Leave a command of zero, enable the motor, and see that it answers without an error."""
        self._rest()
        self._faults, self._status = (), None
        self._prepare(timeout_s)
        if self._shaft is not None:
            self._shaft.forget()
        self._await_answers(2, timeout_s)  # the first may have been on its way
        self._refuse_faults()
        self._begin_goals()
        self._resting = False
        self.command(0.0)  # the drive begins with the command that it had last
        self._send_enable()
        self._await_answers(3, timeout_s, self._feed)
        if not wait_until(self._may_be_enabled, self._link, timeout_s, self._feed):
            raise DeviceTimeoutError(f"{self._place}: says that it is not enabled ({timeout_s:g} s waited)")
        self._refuse_faults()
        self._enabled, self._status = True, None

    def command(self, value: float) -> float:
        """Command a torque [N m], a current [A], a position [rad] or a velocity [rad/s]; returns what is sent: the
        nearest that can be, or, soon after it was enabled away from a position of zero, where it is led. Raises
        ConnectionFailedError, DeviceError."""
        try:
            frame, sent = self._frame(self._direction * value)
        except CodecError as error:
            raise DeviceError(f"{self._place}: cannot command {value} {self.command_unit}") from error
        self._provoked_ns = None
        self._send(*frame)
        return self._direction * sent

    @property
    def position_resolution_rad(self) -> float:
        """The step of the position in an answer."""
        return 0.0 if self._ranges is None else self._ranges.position_step_rad

    @property
    def watchdog_s(self) -> float:
        return self._common.watchdog_s

    def provoke_watchdog(self) -> None:
        """A command of zero; what it says of itself afterwards shows whether the watchdog acted."""
        self._send(*self._plain_frame(0.0)[0])
        self._provoked_ns, self._made_safe = self._link.clock.now_ns(), False

    def made_itself_safe(self) -> bool | None:
        return self._made_safe

    def stop(self) -> None:
        """A command of no torque, and the frame that disables; that one again and again until it is enabled."""
        self._enabled, self._status = False, None
        self._idle_from = self._answers + 3  # after one on its way and those to the frames sent here
        with suppress(Exception):
            self._send(*self._plain_frame(0.0)[0])
        self._provoked_ns, self._resting = None, True
        with suppress(Exception):
            self._disable()

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _send(self, identifier: int, data: bytes) -> None:
        self._port.send(identifier, data, extended=self._extended)

    def _frame(self, value: float) -> tuple[Addressed, float]:
        """What to send for a command, and what of it that stands for."""
        if self._goals is not None:
            return self._goals.frame(value, self._link.clock.now_ns())
        return self._plain_frame(value)

    def _plain_frame(self, value: float) -> tuple[Addressed, float]:
        """Of a torque [N m], or what else is commanded that is no goal."""
        ranges = self._ranges
        if ranges is None:
            raise DeviceError(f"{self._place}: its ranges are not known before it is identified")
        code = ranges.command_code(value)
        return self._pack_torque(code), ranges.commanded_nm(code)

    def _begin_goals(self) -> None:
        if self._goals is not None:
            try:
                self._goals.begin(self._position_rad, self._link.clock.now_ns())
            except DeviceError as error:
                raise DeviceError(f"{self._place}: cannot be enabled: {error}") from error

    def _disable(self) -> None:
        self._asked_ns = self._link.clock.now_ns()
        self._send_disable()

    def _rest(self) -> None:
        self._enabled, self._resting, self._provoked_ns = False, True, None
        self._disable()

    def _feed(self) -> None:
        if self._is_due():
            self.command(0.0)

    def _ask_now_and_then(self) -> None:
        """Called before every poll."""
        if (self._resting or self._provoked_ns is not None) and self._is_due():
            if self._resting:
                self._ask_resting()
            elif self._provoked_ns is not None:
                self._ask_provoked(self._link.clock.now_ns() - self._provoked_ns)

    def _is_due(self) -> bool:
        """Whether it is time to ask; from then on it was asked."""
        now_ns = self._link.clock.now_ns()
        due = self._asked_ns is None or now_ns - self._asked_ns >= QUESTION_PERIOD_NS
        if due:
            self._asked_ns = now_ns
        return due

    def _await_answers(self, count: int, timeout_s: float, meanwhile: Callable[[], None] | None = None) -> None:
        wanted = self._answers + count
        if not wait_until(lambda: self._answers >= wanted, self._link, timeout_s, meanwhile):
            raise DeviceTimeoutError(f"{self._place}: does not answer ({timeout_s:g} s waited)")

    def _hear(self, timeout_s: float, remedy: str) -> None:
        """Disable the motor, and see that it answers. Raises DeviceTimeoutError with the remedy."""
        answers = self._answers
        self._rest()
        if not wait_until(lambda: self._answers > answers, self._link, timeout_s):
            received = f"; heard {', '.join(sorted(self._strangers))}" if self._strangers else ""
            raise DeviceTimeoutError(f"{self._place}: does not answer ({timeout_s:g} s waited{received}); {remedy}")

    def _inquire(self, question: Addressed, answered: Callable[[], bool], timeout_s: float) -> bool:
        """Ask, and again where an answer may have been lost, until it is there; False where it is not in time."""
        asked_ns: int | None = None

        def ask() -> None:
            nonlocal asked_ns
            now_ns = self._link.clock.now_ns()
            if asked_ns is None or now_ns - asked_ns >= ASKED_AGAIN_NS:
                asked_ns = now_ns
                self._send(*question)

        return wait_until(answered, self._link, timeout_s, ask)

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] {self._kind} {self._common.node} on {self._port.name}"

    @property
    def _address(self) -> str:
        return f"{self._port.name} node {self._common.node}"

    def _new_status(self) -> DriveStatus:
        told = self._told
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=None if told is None else self._answer_ns,
            errors=self._errors(),
            motor_temperature_c=nan if told is None else told.motor_c,
            transistor_temperature_c=nan if told is None else told.transistor_c,
        )

    def _state(self) -> DriveState:
        if self._told is None:
            return DriveState.UNKNOWN
        if self._errors():
            return DriveState.FAULT
        enabled = self._told.enabled
        if enabled is None:
            enabled = self._enabled or self._answers < self._idle_from
        return DriveState.ENABLED if enabled else DriveState.IDLE

    def _may_be_enabled(self) -> bool:
        """Whether its last answer does not say otherwise; one with an error is looked at by the caller."""
        return self._told is not None and (self._told.enabled is not False or bool(self._told.error))

    def _errors(self) -> tuple[str, ...]:
        return self._faults or ((self._told.error,) if self._told is not None and self._told.error else ())

    def _refuse_faults(self) -> None:
        if errors := self._errors():
            raise DeviceError(f"{self._place}: cannot be enabled: {'; '.join(errors)}")

    def _note_fault(self, words: str) -> None:
        if words not in self._faults:
            self._faults = (*self._faults, words)

    def _note_stranger(self, words: str) -> None:
        if self._told is None and len(self._strangers) < _STRANGERS:
            self._strangers.add(words)

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_answer(self, answer: Answer, arrival_ns: int) -> None:
        self._told, self._answer_ns = answer, arrival_ns
        self._answers += 1
        self._status = None
        if self._enabled and answer.error:
            self._note_fault(answer.error)
        self._made_safe |= self._provoked_ns is not None and answer.enabled is False
        ranges, shaft = self._ranges, self._shaft
        if ranges is None or shaft is None:
            return
        self._on_motion(shaft, answer, arrival_ns)
        constant_nm_a = self._common.torque_constant_nm_a
        if constant_nm_a is not None:
            current_a = self._direction * ranges.torque_of(answer.torque_code) / constant_nm_a
            self._current.put(CurrentReading(self._current.count, arrival_ns, current_a))

    def _on_motion(self, shaft: RangedShaft, answer: Answer, arrival_ns: int) -> None:
        try:
            position_rad, velocity_rad_s = shaft.follow(answer.position_code, answer.velocity_code, arrival_ns)
        except OutOfRangeError as error:
            # No reading rather than a wrong one; the guard sees the fault with its next tick.
            self._note_fault(str(error))
            return
        self._position_rad = position_rad
        sign, motion = self._direction, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, sign * position_rad, sign * velocity_rad_s))
