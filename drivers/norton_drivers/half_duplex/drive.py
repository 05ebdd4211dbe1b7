"""What drives of servos on a half-duplex line have in common: registers written and read back, states, stopping.

Registers are written by packets that nobody answers, and then read: so it does not matter which writes a servo answers
to. Readings come with the master's cycles.
"""

from collections.abc import Callable
from contextlib import suppress
from math import isfinite, nan
from typing import ClassVar, NamedTuple

from norton_drivers.codecs.half_duplex import Answer
from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.half_duplex.line import Share
from norton_drivers.half_duplex.master import BusMaster
from norton_drivers.half_duplex.options import BusServoOptions
from norton_drivers.link import Link, wait_until
from norton_drivers.readings import CurrentReading, DriveState, DriveStatus, MotionReading
from norton_drivers.servo import Lead
from norton_drivers.wiring import DeviceSettings

FEED_NS = 10_000_000


class Seen(NamedTuple):
    """What a servo's registers say, in its own sense. ``expired``: its watchdog has acted."""

    torque_on: bool
    position_rad: float
    velocity_rad_s: float
    current_a: float = nan
    errors: tuple[str, ...] = ()
    expired: bool = False
    supply_v: float = nan
    temperature_c: float = nan


class BusServo(DriveBase):
    """One servo. ``malformed`` counts readings that were cut short."""

    heartbeat_timeout_ns = 100_000_000
    what: ClassVar[str]  # "Dynamixel": how it is called in sentences
    torque_enable: ClassVar[int]  # the register

    def __init__(self, settings: DeviceSettings, options: BusServoOptions, bus: BusMaster, link: Link) -> None:
        super().__init__(settings)
        self.malformed = 0
        self.command_unit = options.command_unit or ""
        self.readable = self.driving = False
        self.quiet_until_ns = 0
        self._bus = bus
        self._link = link
        self._servo_options = options
        self._led = None if options.servo is None else Lead()
        self._seen: Seen | None = None
        self._seen_ns = 0
        self._count = 0
        self._faults: tuple[str, ...] = ()  # since it was enabled
        self._deadline_ns = self._fed_ns = 0
        bus.join(self)

    # ---- What each family says of itself -------------------------------------------------------------------------

    @property
    def share(self) -> Share:
        """Its part of a cycle."""
        raise NotImplementedError

    def _decoded(self, answer: Answer) -> Seen:
        """Readings from the registers that are read in a cycle. Raises ValueError where they are none."""
        raise NotImplementedError

    def _goal(self, value: float) -> tuple[bytes, float]:
        """The registers of a goal, in its own sense, and what they hold. Raises OverflowError for what they cannot."""
        raise NotImplementedError

    def _set_up(self) -> None:
        """With the torque off: everything that must be set and clear. Raises DeviceError."""
        raise NotImplementedError

    def _arm(self) -> None:
        """With the torque just on: the watchdog, where there is one."""

    def _at_rest(self) -> tuple[tuple[int, bytes], ...]:
        """What to write once the torque is off: addresses and bytes."""
        return ()

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def enable(self, timeout_s: float = 2.0) -> None:
        """Torque off, everything set and read back, then torque on at a command of zero."""
        self._deadline_ns = self._link.clock.now_ns() + round(timeout_s * 1e9)
        self.driving, self.quiet_until_ns, self._fed_ns, self._faults, self._status = False, 0, 0, (), None
        self._set(self.torque_enable, b"\0")
        self._set_up()
        self._await(lambda: not self._now().torque_on)
        if errors := self._now().errors:
            raise DeviceError(f"{self._place}: cannot be enabled: {'; '.join(errors)}")
        if self._led is not None:
            try:
                self._led.begin(self._now().position_rad, self._link.clock.now_ns())
            except DeviceError as error:
                raise DeviceError(f"{self._place}: cannot be enabled: {error}") from error
        standing = 0.0 if self._led is None else self._now().position_rad
        self._write(self.share.goal.address, self._goal(standing)[0])
        self._set(self.torque_enable, b"\1")
        self._arm()
        self.driving, self._status = True, None
        self._await(lambda: self._now().torque_on and not self._now().expired, self._feed)
        self._bus.finish(self._deadline_ns)

    def command(self, value: float) -> float:
        """Command in :attr:`command_unit`; returns what is sent. Raises ConnectionFailedError, DeviceError."""
        if not isfinite(value):
            raise DeviceError(f"{self._place}: cannot command {value} {self.command_unit}")
        asked = self._direction * value
        if self._led is not None:
            asked = self._led.led_rad(asked, self._link.clock.now_ns())
        goal, sent = self._goal(asked)
        self.quiet_until_ns = 0
        self._bus.command(self, goal)
        return self._direction * sent

    @property
    def watchdog_s(self) -> float:
        return self._servo_options.watchdog_s

    def provoke_watchdog(self) -> None:
        """A last command of zero; then silence until it should have acted."""
        self.command(0.0)
        self.quiet_until_ns = self._link.clock.now_ns() + round(self.watchdog_s * 1e9) + 2 * FEED_NS

    def made_itself_safe(self) -> bool | None:
        return self._seen is not None and self._seen.expired

    def stop(self) -> None:
        """A command of no torque, the torque off, and no watchdog: at once, and again once the line is free."""
        self.driving, self.quiet_until_ns, self._status = False, 0, None
        at_rest = ((self.torque_enable, b"\0"), *self._at_rest())
        if self._led is None:
            at_rest = ((self.share.goal.address, self._goal(0.0)[0]), *at_rest)
        with suppress(Exception):
            self._bus.stop(self.share.node, at_rest)

    # ---- Registers -----------------------------------------------------------------------------------------------

    def _write(self, address: int, data: bytes) -> None:
        self._bus.write(address, self.share.node, data)

    def _set(self, address: int, data: bytes) -> None:
        """Write, and see that it is there. Raises DeviceError where it is not."""
        self._write(address, data)
        found = self._read(address, len(data))
        if found != data:
            self._write(address, data)  # a packet may have been lost
            found = self._read(address, len(data))
        if found != data:
            raise DeviceError(f"{self._place}: register {address} keeps {found.hex(' ')}, not {data.hex(' ')} (hex)")

    def _read(self, address: int, length: int) -> bytes:
        """Raises DeviceTimeoutError where it does not answer, DeviceError where it refuses."""
        question = self._bus.dialect.read(self._servo_options.node, address, length)
        answer = self._ask(question, length)
        if len(answer.data) != length:
            raise DeviceError(f"{self._place}: does not let register {address} be read (error {answer.error})")
        return answer.data

    def _ask(self, question: bytes, length: int) -> Answer:
        asked = (question, self._servo_options.node, length, self._servo_options.return_delay_s)
        pending = self._bus.ask(*asked)

        def answered() -> bool:
            nonlocal pending
            if pending.done and pending.answer is None:
                pending = self._bus.ask(*asked)
            return pending.answer is not None

        if not wait_until(answered, self._link, self._left_s()) or pending.answer is None:
            raise DeviceTimeoutError(self._silence())
        return pending.answer

    def _silence(self) -> str:
        return (
            f"{self._place}: does not answer; check its supply, its wiring, its id "
            f"(node = {self._servo_options.node}) and its baud rate ({self._servo_options.baud})"
        )

    def _await(self, arrived: Callable[[], bool], meanwhile: Callable[[], object] | None = None) -> None:
        """Wait for readings that come from now on."""
        count = self._count
        if not wait_until(lambda: self._count > count + 1 and arrived(), self._link, self._left_s(), meanwhile):
            raise DeviceTimeoutError(self._silence() if self._count == count else self._stuck())

    def _left_s(self) -> float:
        return max(self._deadline_ns - self._link.clock.now_ns(), 0) * 1e-9

    def _stuck(self) -> str:
        errors = "; ".join(self._now().errors) or "it reports no error"
        return f"{self._place}: cannot be enabled: torque {'on' if self._now().torque_on else 'off'}, {errors}"

    def _feed(self) -> None:
        now_ns = self._link.clock.now_ns()
        if now_ns - self._fed_ns >= FEED_NS:
            self._fed_ns = now_ns
            self.command(0.0)

    def _now(self) -> Seen:
        assert self._seen is not None
        return self._seen

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] {self.what} {self._servo_options.node} on {self._bus.name}"

    def _new_status(self) -> DriveStatus:
        seen = self._seen
        if seen is None:
            return DriveStatus(DriveState.UNKNOWN)
        errors = self._faults or seen.errors
        state = DriveState.FAULT if errors else DriveState.ENABLED if seen.torque_on else DriveState.IDLE
        return DriveStatus(
            state=state,
            heartbeat_ns=self._seen_ns,
            errors=errors,
            motor_temperature_c=seen.temperature_c,
            bus_voltage_v=seen.supply_v,
        )

    # ---- What arrives --------------------------------------------------------------------------------------------

    def take(self, answer: Answer, stamp_ns: int) -> None:
        """Its registers as they were read in a cycle."""
        try:
            seen = self._decoded(answer)
        except ValueError:
            self.malformed += 1
            return
        self._seen, self._seen_ns, self._status = seen, stamp_ns, None
        self._count += 1
        if self.driving:
            self._faults = tuple(dict.fromkeys((*self._faults, *seen.errors)))
        sign = self._direction
        motion = MotionReading(self._motion.count, stamp_ns, sign * seen.position_rad, sign * seen.velocity_rad_s)
        self._motion.put(motion)
        if isfinite(seen.current_a):
            self._current.put(CurrentReading(self._current.count, stamp_ns, sign * seen.current_a))
