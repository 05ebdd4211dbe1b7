"""An ODrive axis, firmware 0.5 or 0.6, in torque control, as its ASCII protocol shows it on UART and USB.

Sources: as :mod:`norton_drivers.codecs.odrive_ascii`; interface_uart.cpp (bytes are looked for at 8 kHz); axis.cpp of
firmware 0.5.6 (the watchdog minds an idle axis too; a loop that cannot be closed leaves it idle); API reference of
firmware 0.6 (``disarm_reason``). Only torque control with passed-through input is emulated, and what hosts need for it.
"""

from collections.abc import Callable
from math import isnan, nan

from norton_drivers.codecs import odrive_ascii as ascii_protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.odrive import ERROR_WATCHDOG, AxisState
from norton_drivers.codecs.odrive_05 import ERROR_WATCHDOG as WATCHDOG_05
from norton_drivers.odrive import properties
from norton_drivers.odrive.options import ODriveUartOptions
from norton_drivers.serial_timing import BITS_PER_BYTE, opened_at
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Watchdog
from norton_sim.firmware.odrive import ERROR_BAD_CONFIGURATION, ERROR_BITS, ERROR_MISSING_INPUT, SUPPLY_V, ODriveMotor
from norton_sim.firmware.odrive_05 import CONTROLLER_INVALID_MODE, MOTOR_ERRORS
from norton_sim.firmware.text_lines import LineServer

LOOK_PERIOD_NS = 125_000
WARM_PERIOD_NS = 10_000_000
LONGEST_LINE = 256
NINE = 9  # characters of a property's value
BOARDS = {"0.5": ("0", "5", "6", "3", "6", "56"), "0.6": ("0", "6", "10", "4", "4", "58")}  # version and hardware


class ODriveText:
    """One axis and the machine it drives: the rig's actuator or its load."""

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(ODriveUartOptions, context.settings)
        self.old = options.firmware == "0.5"
        self.axis_state = AxisState.IDLE
        self.errors: dict[str, int] = {}  # bits, by the property's name
        self.motor = ODriveMotor(context, input_nm=0.0 if self.old else nan)
        self._axis = options.axis
        self._names = properties.FIRMWARES[options.firmware]
        self._world = context.world
        self._watchdog = Watchdog(context.world, self._starve)
        self._byte_ns = BITS_PER_BYTE * 1e9 / opened_at(options.baud)
        self._sent_ns = 0  # when the last response was out
        self._board = dict(zip(properties.VERSION + properties.HARDWARE, BOARDS[options.firmware], strict=True))
        self._board[properties.SUPPLY] = f"{SUPPLY_V:f}"[:NINE]
        self._connector = context.serial_connector()
        lines = LineServer(context, self._process, least_ns=0, jitter_ns=LOOK_PERIOD_NS, longest=LONGEST_LINE)
        self._connector.on_bytes(lines.receive)
        context.cyclic(WARM_PERIOD_NS, self._warm_up)

    @property
    def armed(self) -> bool:
        return self.motor.armed

    def break_down(self, fault: DriveFault) -> None:
        self.fail("motor.error" if self.old else "active_errors", (MOTOR_ERRORS if self.old else ERROR_BITS)[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self.motor.freeze()

    def fail(self, name: str, bits: int) -> None:
        """Raise errors: an armed axis is disarmed. They stay until they are cleared."""
        self.errors[name] = self.errors.get(name, 0) | bits
        if self.armed and not self.old:
            self.errors["disarm_reason"] = bits
        self._go_idle()

    # ---- lines ----

    def _process(self, data: bytes) -> None:
        data = data.partition(b";")[0].rstrip()
        text, summed = data.decode("ascii", "replace"), b"*" in data
        if summed:
            try:
                text = ascii_protocol.text_in(data)
            except CodecError:
                return
        if (answer := self._answer_to(text.strip())) is not None:
            self._respond(answer, summed)

    def _respond(self, text: str, summed: bool) -> None:
        """What comes while the last response is still being sent is dropped."""
        if self._world.now_ns < self._sent_ns and self._connector.wire.paced:
            return
        data = ascii_protocol.line(text, b"\r\n") if summed else f"{text}\r\n".encode()
        self._sent_ns = self._world.now_ns + round(len(data) * self._byte_ns)
        self._connector.send(data)

    def _answer_to(self, text: str) -> str | None:
        word, *rest = text.split() or [""]
        if word == ascii_protocol.CLEAR_ERRORS:
            self.errors.clear()
            return None
        answers = {"c": self._command, "f": self._feedback, "r": self._read, "u": self._feed, "w": self._write}
        try:
            return answers[word](rest) if word in answers else ascii_protocol.UNKNOWN
        except (ValueError, IndexError):
            return "invalid command format"

    def _is_other(self, axis: str) -> str | None:
        return None if int(axis) == self._axis else f"invalid motor {axis}"

    def _command(self, rest: list[str]) -> str | None:
        torque_nm, other = float(rest[1]), self._is_other(rest[0])
        if other is None:
            self._watchdog.feed()
            self.motor.input_nm = torque_nm
            self.motor.drive()
        return other

    def _feedback(self, rest: list[str]) -> str | None:
        return self._is_other(rest[0]) or ascii_protocol.feedback_text(*self.motor.estimates())

    def _feed(self, rest: list[str]) -> str | None:
        self._watchdog.feed()
        return self._is_other(rest[0])

    # ---- properties ----

    def _name_of(self, path: str) -> str:
        """Of this axis; "" for what is not."""
        prefix = f"axis{self._axis}."
        return path.removeprefix(prefix) if path.startswith(prefix) else ""

    def _read(self, rest: list[str]) -> str | None:
        (path,) = rest
        if path in self._board:
            return self._board[path]
        name = self._name_of(path)
        if name in self._names.errors or name in self._names.reasons:
            return str(self.errors.get(name, 0))
        numbers: dict[str, Callable[[], float]] = {
            properties.TEMPERATURE: lambda: self.motor.heating.temperature_c,
            self._names.current: self.motor.current_a,
            properties.WATCHDOG_TIMEOUT: lambda: self._watchdog.timeout_ns * 1e-9,
        }
        if name in numbers:
            return f"{numbers[name]():f}"[:NINE]
        integers = {
            properties.STATE: int(self.axis_state),
            properties.CONTROL_MODE: self.motor.mode[0],
            properties.INPUT_MODE: self.motor.mode[1],
            properties.ENABLE_WATCHDOG: int(self._watchdog.enabled),
        }
        return str(int(integers[name])) if name in integers else ascii_protocol.INVALID_PROPERTY

    def _write(self, rest: list[str]) -> str | None:
        name, value = self._name_of(rest[0]), float(rest[1])
        enabled, timeout_ns, (control, shaping) = self._watchdog.enabled, self._watchdog.timeout_ns, self.motor.mode
        match name:
            case properties.REQUESTED_STATE:
                self._request(int(value))
            case properties.CONTROL_MODE:
                self.motor.mode = (int(value), shaping)
            case properties.INPUT_MODE:
                self.motor.mode = (control, int(value))
            case properties.WATCHDOG_TIMEOUT:
                self._watchdog.configure(enabled=enabled, timeout_ns=max(0, round(value * 1e9)))
            case properties.ENABLE_WATCHDOG:
                self._watchdog.configure(enabled=bool(value), timeout_ns=timeout_ns)
            case _:
                return ascii_protocol.INVALID_PROPERTY
        return None

    # ---- states ----

    def _request(self, state: int) -> None:
        if state == AxisState.IDLE:
            self._go_idle()
        elif state == AxisState.CLOSED_LOOP_CONTROL:
            self._refuse()
            if not any(self.errors.values()):
                self.axis_state = AxisState.CLOSED_LOOP_CONTROL
                self.motor.arm()

    def _refuse(self) -> None:
        """Note what keeps the loop from being closed."""
        if not self.motor.in_torque_control:
            bits = CONTROLLER_INVALID_MODE if self.old else ERROR_BAD_CONFIGURATION
            self.fail("controller.error" if self.old else "active_errors", bits)
        elif isnan(self.motor.input_nm):
            self.fail("active_errors", ERROR_MISSING_INPUT)

    def _starve(self) -> None:
        if self.old:
            self.fail("error", WATCHDOG_05)
        elif self.armed:
            self.fail("active_errors", ERROR_WATCHDOG)

    def _warm_up(self, _stamp_ns: int) -> None:
        self.motor.warm_up(WARM_PERIOD_NS * 1e-9)
        if self.motor.heating.too_hot:
            self.break_down(DriveFault.OVER_TEMPERATURE)

    def _go_idle(self) -> None:
        self.axis_state = AxisState.IDLE
        self.motor.disarm()
