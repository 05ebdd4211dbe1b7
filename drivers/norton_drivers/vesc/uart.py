"""A VESC on its UART or its USB port: current, torque or duty cycle out, motion, current and faults in.

It obeys every command, and lets go of the motor where none comes for its timeout, which no packet sets alone. It speaks
only when spoken to: one question, answered with what its mask selects, tells position, speed, current and fault;
temperatures and supply are asked for with the same question now and then. None of these feeds the timeout, and since
firmware 6 an answer tells whether the timeout has acted. Sources: vedderb/bldc, comm/commands.c, timeout.c (released
after the timeout, with the default brake current of zero), applications/app_uartcomm.c and appconf_default.h (115200
baud, timeout of 1000 ms), motor/mc_interface.c (currents are averages since they were last asked for).
"""

from collections.abc import Iterator
from math import nan

from norton_drivers.codecs import vesc, vesc_uart
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc_uart import PacketStream, Say, Value, mask_of
from norton_drivers.errors import DeviceError
from norton_drivers.finding import Found, answers_to
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import SerialPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from norton_drivers.serial_drive import Question, SerialDrive
from norton_drivers.vesc.motor import MOTOR_UNITS, TIMEOUT_LOOK_S, SeenFaults, fault_words
from norton_drivers.vesc.options import SLOW, VescUartOptions
from norton_drivers.vesc.shaft import VescShaft
from norton_drivers.wiring import DeviceSettings, parse_options

SILENT_NS = 150_000_000
SLOW_PERIOD_NS = 100_000_000
_CODES_PER_TURN = 360_000_000  # of the angle

CONNECTION = "serial"
OPTION_UNITS = {**MOTOR_UNITS, "timeout": "s"}


def find(port: SerialPort, link: Link) -> Iterator[Found]:
    """A VESC, by its version. Raises ConnectionFailedError."""
    heard = answers_to(vesc_uart.packet(vesc.ask_version()), port, link)
    for payload in (received.payload for received in PacketStream().feed(heard)):
        if payload[0] == Say.FW_VERSION and len(payload) > 2:
            yield Found("a VESC, firmware {}.{:02d}".format(*vesc.version_of(payload)[:2]))
            return


def open_amplifier(settings: DeviceSettings, link: Link) -> "VescUart":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    return VescUart(settings, parse_options(VescUartOptions, settings), link)


class VescUart(SerialDrive):
    """One motor of a VESC. ``malformed`` counts packets that could not be read."""

    heartbeat_timeout_ns = SILENT_NS

    def __init__(self, settings: DeviceSettings, options: VescUartOptions, link: Link) -> None:
        self.options = options
        self._stream = PacketStream()
        self._undecoded = 0
        encoder = options.position == "encoder"
        self._shaft = (
            VescShaft.by_encoder(options.pole_pairs, _CODES_PER_TURN)
            if encoder
            else VescShaft.by_tachometer(options.pole_pairs)
        )
        self._place_value = Value.POSITION_DEG if encoder else Value.TACHOMETER
        self._codes_per_unit = 1e6 if encoder else 1.0
        self._questions_by_mask = {mask: self._question(mask) for mask in self._masks}
        self._slow_ns: int | None = None
        self._values: dict[Value, float] = {}
        self._told_ns: int | None = None  # arrival of the last answer
        self._answers = 0
        self._faults = SeenFaults()
        self._enabled = self._provoked = False
        self._released_from = 0  # the count of answers that first tells what became of the last stop
        self._kind = Say.SET_DUTY if options.mode == "duty" else Say.SET_CURRENT
        super().__init__(settings, options, link)
        self.command_unit = options.command_unit or ""

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask for the version, and see that positions come."""
        version = self._asks(self._packet(vesc.ask_version()), _is_version, timeout_s)
        if version is None:
            raise self._late(timeout_s, self._silent())
        major, minor, hardware = vesc.version_of(version)
        moved = self._motion.count
        self._wait_for(lambda: self._motion.count > moved, timeout_s, "does not tell its values; update its firmware")
        address = (
            self._port.name if self.options.forward is None else f"{self._port.name} VESC ID {self.options.forward}"
        )
        return DeviceIdentity("vesc_uart", address, hardware, f"{major}.{minor:02d}")

    def enable(self, timeout_s: float = 2.0) -> None:
        """See that there is no fault, and command zero; there is no state to enter."""
        self._enabled, self._provoked, self._status = False, False, None
        self._faults.forget()
        told = self._answers
        faultless = wait_until(lambda: self._answers > told + 1 and not self._faults.present, self._link, timeout_s)
        if self._answers == told:
            raise self._late(timeout_s, "does not answer")
        if not faultless:
            raise DeviceError(f"{self._place}: refuses to drive its motor: {self._faults.present}")
        self.command(0.0)
        self._enabled, self._status = True, None

    def command(self, value: float) -> float:
        """Command a current, a torque or a duty cycle, which also feeds the timeout; returns what is sent of it.

        Raises ConnectionFailedError, DeviceError.
        """
        try:
            payload, sent = self.options.encoded(self._direction * value)
        except CodecError as error:
            raise self._cannot(value) from error
        self._provoked = False
        self._send_command(self._packet(bytes((self._kind,)) + payload))
        return self._direction * sent

    @property
    def malformed(self) -> int:
        return self._stream.malformed + self._undecoded

    @property
    def position_resolution_rad(self) -> float:
        """The step of the angle as the firmware has it, or a sixth of an electrical turn."""
        encoder_rad = vesc_uart.POSITION_STEP_DEG / 360 * _CODES_PER_TURN * self._shaft.step_rad
        return encoder_rad if self.options.position == "encoder" else self._shaft.step_rad

    @property
    def watchdog_s(self) -> float:
        """The timeout as set, and the interval at which the firmware looks whether it is over."""
        return self.options.watchdog_s + TIMEOUT_LOOK_S if self.options.watchdog_s else 0.0

    def provoke_watchdog(self) -> None:
        self.command(0.0)
        self._values.pop(Value.STATUS, None)
        self._provoked = True

    def made_itself_safe(self) -> bool | None:
        """None where the firmware is too old to tell."""
        status = self._values.get(Value.STATUS)
        return None if status is None or not self._provoked else bool(int(status) & vesc_uart.TIMED_OUT)

    def stop(self) -> None:
        """A command of zero, then a current of zero, which lets go of the motor in every mode."""
        self._enabled, self._status = False, None
        self._released_from = self._answers + 2  # one may have been on its way
        zero = bytes(4)
        self._send_last(*(self._packet(bytes((kind,)) + zero) for kind in (self._kind, Say.SET_CURRENT)))

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] VESC on {self._port.name}"

    def _silent(self) -> str:
        forward = "" if self.options.forward is None else f", is VESC ID {self.options.forward} on its CAN bus"
        return (
            f"does not answer; is it powered, is App to Use in VESC Tool UART or No App, is its baud rate "
            f"{self.options.baud or 'that of USB'}{forward}?"
        )

    def _new_status(self) -> DriveStatus:
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=self._told_ns,
            errors=self._faults.words(),
            transistor_temperature_c=self._values.get(Value.TRANSISTOR_C, nan),
            motor_temperature_c=self._values.get(Value.MOTOR_C, nan),
            bus_voltage_v=self._values.get(Value.SUPPLY_V, nan),
        )

    def _state(self) -> DriveState:
        if self._told_ns is None:
            return DriveState.UNKNOWN
        if self._faults.words():
            return DriveState.FAULT
        driving = self._answers < self._released_from or self._values.get(Value.Q_A, 0.0) != 0.0
        return DriveState.ENABLED if self._enabled or driving else DriveState.IDLE

    # ---- Questions and answers -----------------------------------------------------------------------------------

    @property
    def _masks(self) -> tuple[int, int]:
        return self.options.fast_mask, self.options.fast_mask | mask_of(*SLOW)

    def _packet(self, payload: bytes) -> bytes:
        return vesc_uart.packet(vesc_uart.forwarded(payload, self.options.forward))

    def _question(self, mask: int) -> Question:
        data = self._packet(vesc_uart.ask_values(mask))
        return Question(data, lambda payload: vesc_uart.mask_in(payload) == mask, self._on_values)

    def _next_question(self) -> Question:
        fast, slow = self._masks
        now_ns = self._link.clock.now_ns()
        if self._slow_ns is not None and now_ns - self._slow_ns < SLOW_PERIOD_NS:
            return self._questions_by_mask[fast]
        self._slow_ns = now_ns
        return self._questions_by_mask[slow]

    def _answers_in(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        yield from self._stream.feed(data)

    def _on_values(self, payload: bytes, asked_ns: int, arrival_ns: int) -> None:
        try:
            values = vesc_uart.values_of(payload)
        except CodecError:
            self._undecoded += 1
            return
        self._values.update(values)
        self._told_ns, self._status = arrival_ns, None
        self._answers += 1
        self._faults.tell(fault_words(int(values[Value.FAULT])), kept=self._enabled)
        self._shaft.on_erpm(values[Value.ERPM])
        sign, motion, current = self._direction, self._motion, self._current
        place = self._shaft.position_rad(round(values[self._place_value] * self._codes_per_unit), asked_ns)
        velocity_rad_s = self._shaft.velocity_rad_s or 0.0
        motion.put(MotionReading(motion.count, arrival_ns, sign * place, sign * velocity_rad_s, asked_ns))
        current_a = sign * vesc.middle(values[Value.Q_A], vesc_uart.CURRENT_STEP_A)
        current.put(CurrentReading(current.count, arrival_ns, current_a, asked_ns))


def _is_version(payload: bytes) -> bool:
    return payload[0] == Say.FW_VERSION and len(payload) > 2
