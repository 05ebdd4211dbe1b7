"""An ODrive on its UART or its USB port, by the ASCII protocol: torque commands out, motion, current and state in.

It speaks only when spoken to. In every tick it is asked for feedback. Behind the command goes now and then a second
question: for state, current, errors, supply and temperature. By the time that a drive on a UART has received the
command and this, its feedback is sent: what it is asked before that it does not answer (on USB now and then). Its
watchdog is armed here with both firmwares. See :mod:`norton_drivers.codecs.odrive_ascii` for the sources.
"""

from collections import deque
from collections.abc import Iterator
from itertools import cycle
from math import isclose, pi

from norton_drivers.codecs import odrive_ascii as ascii_protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.odrive import AxisState, ControlMode, InputMode
from norton_drivers.codecs.odrive_ascii import Told, feedback_in, line, number_in
from norton_drivers.errors import DeviceError
from norton_drivers.link import Link
from norton_drivers.odrive import properties
from norton_drivers.odrive.options import ASIDE_PERIOD_S, ASIDES, ODriveUartOptions
from norton_drivers.odrive.properties import AxisValues, find  # noqa: F401  (found here by whoever looks)
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from norton_drivers.serial_drive import Question, SerialDrive
from norton_drivers.wiring import DeviceSettings, parse_options

TURN_RAD = 2 * pi
SLOW_PERIOD_NS = round(ASIDE_PERIOD_S * 1e9)
SILENT_NS = 350_000_000  # three times that, and a bit
_ANSWER_S = 0.3

CONNECTION = "serial"
OPTION_UNITS = {"watchdog": "s", "timeout": "s"}


def open_amplifier(settings: DeviceSettings, link: Link) -> "ODriveUart":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    return ODriveUart(settings, parse_options(ODriveUartOptions, settings), link)


class ODriveUart(SerialDrive):
    """One axis of an ODrive."""

    heartbeat_timeout_ns = SILENT_NS
    command_unit = "N*m"

    def __init__(self, settings: DeviceSettings, options: ODriveUartOptions, link: Link) -> None:
        self.options = options
        self._values = values = AxisValues(options.firmware, options.axis)
        self._stream = ascii_protocol.TextStream()
        self._state_ns: int | None = None  # arrival of the state told last
        self._closed_loop_wanted = self._armed = False
        self._feedback = Question(line(f"f {options.axis}"), _is_feedback, self._on_feedback)
        self._others = cycle((*values.errors, properties.SUPPLY, values.temperature))
        self._due: deque[str] = deque()
        self._explaining = False  # it left its loop, and is asked why
        self._slow_ns: int | None = None
        super().__init__(settings, options, link)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask for the versions, and see that feedback comes."""
        version = [self._read(name, timeout_s) for name in properties.VERSION]
        numbers = ".".join(f"{number:.0f}" for number in version)
        if version[:2] != [float(part) for part in self.options.firmware.split(".")]:
            raise DeviceError(
                f'{self._place}: says it runs firmware {numbers}; the rig file has firmware = "{self.options.firmware}"'
            )
        hardware = ".".join(f"{self._read(name, timeout_s):.0f}" for name in properties.HARDWARE)
        moved = self._motion.count
        self._wait_for(lambda: self._motion.count > moved, timeout_s, "gives no feedback")
        return DeviceIdentity("odrive_uart", f"{self._port.name} axis {self.options.axis}", hardware, numbers)

    def enable(self, timeout_s: float = 2.0) -> None:
        """Arm the watchdog, clear errors, close the torque loop at zero torque; return when the drive says so."""
        end_ns = self._link.clock.now_ns() + round(timeout_s * 1e9)
        self._closed_loop_wanted, self._status = False, None
        if self.options.watchdog_s > 0:
            self._set(properties.WATCHDOG_TIMEOUT, self.options.watchdog_s)
            self._armed = True
            self.command(0.0)
            self._set(properties.ENABLE_WATCHDOG, 1)
        self._line.send(line(ascii_protocol.CLEAR_ERRORS))
        self._values.forget_errors()
        self._armed = True
        self.command(0.0)
        self._set(properties.CONTROL_MODE, ControlMode.TORQUE)
        self._set(properties.INPUT_MODE, InputMode.PASSTHROUGH)
        self._write(properties.REQUESTED_STATE, AxisState.CLOSED_LOOP_CONTROL)
        while self._read(self._values.state, timeout_s) != AxisState.CLOSED_LOOP_CONTROL:
            for path in self._values.errors:
                self._read(path, timeout_s)
            if self._values.failed:
                self._armed = False
                errors = "; ".join(self._values.words(wanted=True))
                raise DeviceError(f"{self._place}: refuses to close its torque loop: {errors}")
            if self._link.clock.now_ns() >= end_ns:
                raise self._late(timeout_s, "did not close its torque loop")
        self._closed_loop_wanted, self._explaining, self._status = True, False, None

    def command(self, value: float) -> float:
        """Command a torque [N m], which also feeds the watchdog; returns it as it is sent.

        Raises ConnectionFailedError, DeviceError.
        """
        try:
            text = ascii_protocol.torque_text(self.options.axis, self._direction * value)
        except CodecError as error:
            raise self._cannot(value) from error
        self._send_command(line(text))
        return self._direction * float(text.rpartition(" ")[2])

    @property
    def malformed(self) -> int:
        """Lines whose checksum was wrong."""
        return self._stream.garbled

    @property
    def position_resolution_rad(self) -> float:
        """The encoder's step, or that of the text if it is larger."""
        encoder_rev = 1 / self.options.counts_per_turn if self.options.counts_per_turn else 0.0
        return TURN_RAD * max(ascii_protocol.POSITION_STEP_REV, encoder_rev)

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        self.command(0.0)
        self._armed = False  # questions do not feed it

    def made_itself_safe(self) -> bool | None:
        return self._state_ns is not None and not self._values.in_closed_loop

    def stop(self) -> None:
        """Zero torque, then idle, each tried whatever became of the other."""
        self._closed_loop_wanted = self._armed = False
        self._status = None
        idle = f"w {self._values.path(properties.REQUESTED_STATE)} {AxisState.IDLE:d}"
        self._send_last(line(ascii_protocol.torque_text(self.options.axis, 0.0)), line(idle))

    def _feed(self) -> None:
        if self._armed:
            self._feed_now_and_then()

    # ---- Properties ----------------------------------------------------------------------------------------------

    def _read(self, path: str, timeout_s: float) -> float:
        """Raises DeviceTimeoutError; DeviceError where there is no such property."""
        text = self._asks(line(f"r {path}"), _is_value, timeout_s)
        if text is None:
            raise self._late(timeout_s, self._silent())
        number = number_in(text)
        if number is None:
            raise DeviceError(f'{self._place}: says "{text}" of {path}; is firmware = "{self.options.firmware}" right?')
        self._note(path, number)
        return number

    def _write(self, name: str, value: float) -> None:
        self._line.send(line(f"w {self._values.path(name)} {value:g}"))

    def _set(self, name: str, value: float) -> None:
        """Write, and read back: once more where the line was lost. Raises DeviceError where it is not taken."""
        path = self._values.path(name)
        for _ in range(2):
            self._write(name, value)
            taken = self._read(path, _ANSWER_S)
            if isclose(taken, value, rel_tol=1e-4):
                return
        raise DeviceError(f"{self._place}: does not take {path} = {value:g} (it says {taken:g})")

    def _note(self, path: str, number: float) -> None:
        self._values.note(path, number)
        self._status = None

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] ODrive axis {self.options.axis} on {self._port.name}"

    def _silent(self) -> str:
        rate = f"uart_a_baudrate = {self.options.baud}" if self.options.baud else "USB"
        return f"does not answer; is it powered, is its UART enabled with the ASCII protocol and {rate}?"

    def _new_status(self) -> DriveStatus:
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=self._state_ns,
            errors=self._values.words(wanted=self._closed_loop_wanted),
            transistor_temperature_c=self._values.get(self._values.temperature),
            bus_voltage_v=self._values.get(properties.SUPPLY),
        )

    def _state(self) -> DriveState:
        if self._state_ns is None:
            return DriveState.UNKNOWN
        if self._values.in_closed_loop:
            return DriveState.ENABLED
        return DriveState.FAULT if self._closed_loop_wanted or self._values.failed else DriveState.IDLE

    # ---- Questions and answers -----------------------------------------------------------------------------------

    def _next_question(self) -> Question:
        return self._feedback

    def _next_aside(self) -> Question | None:
        now_ns = self._link.clock.now_ns()
        if self._slow_ns is None or now_ns - self._slow_ns >= SLOW_PERIOD_NS:
            self._slow_ns = now_ns
            self._due.clear()  # what a lost drive was to be asked
            self._due.extend((self._values.state, *(ASIDES - 2) * (self._values.current,), next(self._others)))
        if not self._due:
            return None
        path = self._due.popleft()
        return Question(line(f"r {path}"), _is_value, lambda text, *when: self._on_value(path, text, *when))

    def _answers_in(self, data: bytes) -> Iterator[Told]:
        return self._stream.feed(data)

    def _on_feedback(self, text: str, asked_ns: int, arrival_ns: int) -> None:
        told = feedback_in(text)
        if told is not None:
            position_rad, velocity_rad_s = (self._direction * TURN_RAD * number for number in told)
            motion = self._motion
            motion.put(MotionReading(motion.count, arrival_ns, position_rad, velocity_rad_s, asked_ns))

    def _on_value(self, path: str, text: str, asked_ns: int, arrival_ns: int) -> None:
        number = number_in(text)
        if number is None:
            return  # firmware of another revision may not have it
        if path == self._values.state:
            self._state_ns = arrival_ns
            if self._closed_loop_wanted and number != AxisState.CLOSED_LOOP_CONTROL and not self._explaining:
                self._explaining = True  # the guard sees state and errors together
                self._due = deque((*self._values.errors, self._values.state))
                return
        self._note(path, number)
        if path == self._values.current:
            current_a = self._direction * number
            self._current.put(CurrentReading(self._current.count, arrival_ns, current_a, asked_ns))


def _is_feedback(text: str) -> bool:
    return feedback_in(text) is not None


def _is_value(text: str) -> bool:
    return feedback_in(text) is None
