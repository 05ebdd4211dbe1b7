"""A motor of a SimpleFOC board: current, torque or voltage out, motion, current and whether it is enabled in.

It speaks only when spoken to, and prints every target that it gets. The library has no watchdog, and its lines no
checksum: a line that lost a character may be another target. What makes that safe: the board's own limit of current or
voltage, which is set and read back before the motor is enabled, the target that every answer tells, which must be one
that was sent, and a timeout in the sketch, where it has one (docs/devices.md).
"""

from collections import deque
from collections.abc import Iterator
from math import frexp, ldexp

from norton_drivers.codecs import simplefoc as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import LineStream
from norton_drivers.codecs.simplefoc import CONTROLLERS, flag_in, letter_in, state_in
from norton_drivers.errors import DeviceError
from norton_drivers.finding import Found, answers_to
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from norton_drivers.serial_drive import Question, SerialDrive
from norton_drivers.simplefoc.options import SimpleFocOptions
from norton_drivers.wiring import DeviceSettings, parse_options

SLOW_PERIOD_NS = 100_000_000
SILENT_NS = 350_000_000  # three times that, and a bit
_STEP_S = 0.3  # for one answer while it is set up
# Targets that may still be told; and so many of others, one after the other, were not sent by this program.
_REMEMBERED, _FOREIGN = 64, 5
_FLOAT32_BITS = 24

CONNECTION = "serial"
OPTION_UNITS = {"torque_constant": "N*m/A", "current_limit": "A", "supply": "V", "timeout": "s", "watchdog": "s"}


def find(port: SerialPort, link: Link) -> Iterator[Found]:
    """A board, by the letters of its commands. Raises ConnectionFailedError."""
    lines = LineStream(mid_line=False).feed(answers_to(b"\n" + protocol.SCAN, port, link))
    told = (letter_in(each.text.decode("ascii", "replace")) for each in lines)
    if letters := [letter for letter in told if letter is not None]:
        yield Found(f"a SimpleFOC board with the commands {', '.join(letters)}")


def open_amplifier(settings: DeviceSettings, link: Link) -> "SimpleFoc":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    return SimpleFoc(settings, parse_options(SimpleFocOptions, settings), link)


class SimpleFoc(SerialDrive):
    """One motor."""

    heartbeat_timeout_ns = SILENT_NS

    def __init__(self, settings: DeviceSettings, options: SimpleFocOptions, link: Link) -> None:
        self.options = options
        self.malformed = 0
        self._stream = LineStream(mid_line=False)
        self._letters: set[str] = set()
        self._angle_rad = 0.0
        self._told_enabled: bool | None = None
        self._told_ns: int | None = None
        self._sent: deque[float] = deque([0.0], maxlen=_REMEMBERED)  # targets
        self._foreign, self._foreign_target = 0, 0.0
        self._enabled = self._armed = False
        self._slow_ns: int | None = None
        self._state = Question(self._say("MG7"), _is_state, self._on_state)
        self._flag = Question(self._say("E"), _is_flag, self._on_flag)
        super().__init__(settings, options, link)
        self.command_unit = options.command_unit or ""

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask for the letters, and see that the motor tells its state."""
        self._letters.clear()
        if self._asks(protocol.SCAN, lambda text: letter_in(text) is not None, timeout_s) is None:
            rate = f"{self.options.baud} baud" if self.options.baud else "USB"
            raise self._late(timeout_s, f"does not answer; is it powered, does its sketch run Commander at {rate}?")
        self._set(protocol.BARE_VALUES, protocol.BARE_VALUES_SET)
        self._set(f"#{self.options.decimals}\n".encode(), f"{self.options.decimals}")
        if self.options.letter not in self._letters:
            known = ", ".join(sorted(self._letters))
            raise DeviceError(f'{self._place}: has no command "{self.options.letter}", but {known}; correct letter')
        moved = self._motion.count
        self._wait_for(lambda: self._motion.count > moved, timeout_s, "does not tell its state; is letter a motor's?")
        return DeviceIdentity("simplefoc", f"{self._port.name} motor {self.options.letter}", "SimpleFOC")

    def enable(self, timeout_s: float = 2.0) -> None:
        """Choose what is controlled, set the board's limit, and enable the motor at a target of zero."""
        self._enabled = self._armed = False
        self._foreign, self._status = 0, None
        number, name = CONTROLLERS[self.options.controller]
        step_s = min(_STEP_S, timeout_s)
        self._set(protocol.BARE_VALUES, protocol.BARE_VALUES_SET, step_s)
        self._set(f"#{self.options.decimals}\n".encode(), f"{self.options.decimals}", step_s)
        self._set(self._say("C0"), protocol.TORQUE_SET, step_s)
        self._set(self._say(f"T{number}"), name, step_s)
        limit = (
            ("LU", self.options.supply_v) if self.options.mode == "voltage" else ("LC", self.options.current_limit_a)
        )
        text = protocol.target_text(limit[1] or 0.0, self.options.decimals)
        self._set(self._say(limit[0] + text), text, step_s)
        self.command(0.0)
        self._set(self._say("E1"), "1", step_s)
        self._armed, self._enabled, self._told_enabled, self._status = True, True, True, None
        self._told_ns = self._link.clock.now_ns()
        self.command(0.0)

    def command(self, value: float) -> float:
        """Command a current, a torque or a share of the supply; returns what is sent of it.

        Raises ConnectionFailedError, DeviceError.
        """
        try:
            text = protocol.target_text(self._direction * value / self.options.per_target, self.options.decimals)
        except CodecError as error:
            raise self._cannot(value) from error
        target = float(text)
        self._sent.append(target)
        self._send_command(self._say(text))
        return self._direction * target * self.options.per_target

    @property
    def position_resolution_rad(self) -> float:
        """The last decimal, or the step of the board's float32 if it is larger."""
        _, exponent = frexp(self._angle_rad)
        return max(10.0**-self.options.decimals, ldexp(1.0, exponent - _FLOAT32_BITS))

    @property
    def watchdog_s(self) -> float:
        """The sketch's own; the library has none."""
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        self.command(0.0)
        self._armed = self._enabled = False

    def made_itself_safe(self) -> bool | None:
        return None if self._told_enabled is None else not self._told_enabled

    def stop(self) -> None:
        """A target of zero, then disable, each tried whatever became of the other."""
        self._enabled = self._armed = False
        self._status, self._slow_ns = None, None
        self._sent.append(0.0)
        self._send_last(self._say("0"), self._say("E0"))

    def _feed(self) -> None:
        if self._armed:
            self._feed_now_and_then()

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] SimpleFOC motor {self.options.letter} on {self._port.name}"

    def _say(self, what: str) -> bytes:
        return protocol.said(self.options.letter, what)

    def _set(self, data: bytes, expected: str, timeout_s: float = _STEP_S) -> None:
        """Raises DeviceTimeoutError where the board does not say that it has done so."""
        if self._asks(data, lambda text: text == expected, timeout_s) is None:
            raise self._late(timeout_s, f'does not answer "{expected}" to "{data.decode().strip()}"')

    def _new_status(self) -> DriveStatus:
        return DriveStatus(self._drive_state(), self._told_ns, self._errors())

    def _drive_state(self) -> DriveState:
        if self._told_enabled is None:
            return DriveState.UNKNOWN
        if self._errors():
            return DriveState.FAULT
        return DriveState.ENABLED if self._told_enabled else DriveState.IDLE

    def _errors(self) -> tuple[str, ...]:
        if self._enabled and self._told_enabled is False:
            return ("the motor is disabled: by its sketch, its driver's fault input, or a restart",)
        if self._foreign >= _FOREIGN:
            unit = "V" if self.options.mode == "voltage" else "A"
            return (f"its target is {self._foreign_target:g} {unit}, which was not sent: noise on the line?",)
        return ()

    # ---- Questions and answers -----------------------------------------------------------------------------------

    def _next_question(self) -> Question:
        return self._state

    def _next_aside(self) -> Question | None:
        now_ns = self._link.clock.now_ns()
        if self._slow_ns is not None and now_ns - self._slow_ns < SLOW_PERIOD_NS:
            return None
        self._slow_ns = now_ns
        return self._flag

    def _answers_in(self, data: bytes) -> Iterator[tuple[str, int]]:
        for each in self._stream.feed(data):
            text = each.text.decode("ascii", "replace")
            if (letter := letter_in(text)) is not None:
                self._letters.add(letter)
            yield text, each.later_bytes

    def _on_flag(self, text: str, _asked_ns: int, arrival_ns: int) -> None:
        self._told_enabled, self._told_ns, self._status = flag_in(text), arrival_ns, None

    def _on_state(self, text: str, asked_ns: int, arrival_ns: int) -> None:
        state = state_in(text)
        if state is None:
            return
        self._angle_rad = state.angle
        known = not self._enabled or state.target in self._sent
        self._foreign = 0 if known else self._foreign + 1
        if not known:
            self._foreign_target, self._status = state.target, None
        sign, motion, current = self._direction, self._motion, self._current
        motion.put(MotionReading(motion.count, arrival_ns, sign * state.angle, sign * state.velocity, asked_ns))
        if self.options.mode != "voltage":
            current.put(CurrentReading(current.count, arrival_ns, sign * state.current_q, asked_ns))


def _is_state(text: str) -> bool:
    return state_in(text) is not None


def _is_flag(text: str) -> bool:
    return flag_in(text) is not None
