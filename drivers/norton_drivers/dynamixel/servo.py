"""Dynamixel X servos (XL330, XC330, XM430, XM540, XH430) on a half-duplex line, Protocol 2.0.

What the driver writes, in this order, with the torque off: status return level, Operating Mode (kept in the servo's
EEPROM; only where it differs), the indirect addresses of what is read in every cycle; profile velocity and
acceleration of zero, which is no profile; gains. Each is read back. A servo that has shut itself down is rebooted,
which is the only way out. Its Bus Watchdog counts packets of any kind on the line; once it has acted, goals can be
written again only after it was set to zero. Sources: as for :mod:`norton_drivers.dynamixel.table`.
"""

from struct import Struct, error
from typing import ClassVar

from norton_drivers.codecs import dynamixel as protocol
from norton_drivers.codecs.half_duplex import Answer
from norton_drivers.dynamixel import table
from norton_drivers.dynamixel.options import OPERATING_MODES, DynamixelOptions
from norton_drivers.dynamixel.table import MODELS
from norton_drivers.errors import DeviceError
from norton_drivers.half_duplex.drive import BusServo, Seen
from norton_drivers.half_duplex.line import Registers, Share
from norton_drivers.half_duplex.master import BusMaster
from norton_drivers.link import Link, wait_until
from norton_drivers.readings import DeviceIdentity
from norton_drivers.wiring import DeviceSettings

RESTART_S = 0.2  # what a servo that is rebooted needs before it answers
FAST_TRIED_S = 0.06
_SEEN = Struct(table.READ_FORMAT)
_GOALS = {"pwm": Registers(table.GOAL_PWM, 2), "current": Registers(table.GOAL_CURRENT, 2)}
_GOALS["torque"] = _GOALS["current"]
_GOAL_POSITION = Registers(table.GOAL_POSITION, 4)


def share_of(options: DynamixelOptions, indirect_data: int | None = None) -> Share:
    """Its part of a cycle."""
    first = MODELS[options.model].indirect_data[0] if indirect_data is None else indirect_data
    return Share(
        options.node,
        _GOALS.get(options.mode, _GOAL_POSITION),
        Registers(first, table.READ_LENGTH),
        options.return_delay_s,
    )


class DynamixelServo(BusServo):
    """One servo."""

    what: ClassVar = "Dynamixel"
    torque_enable: ClassVar = table.TORQUE_ENABLE

    def __init__(
        self, settings: DeviceSettings, options: DynamixelOptions, bus: BusMaster, dialect: protocol.Dialect, link: Link
    ) -> None:
        self._options = options
        self._dialect = dialect
        self._share = share_of(options)
        self._model = MODELS[options.model]
        self._greatest = 0  # of its goals, in its own unit
        self._identity: DeviceIdentity | None = None
        super().__init__(settings, options, bus, link)

    @property
    def share(self) -> Share:
        return self._share

    @property
    def position_resolution_rad(self) -> float:
        return table.POSITION_STEP_RAD

    # ---- Who is there --------------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ping it, look whether it is what the rig file says, and set up what is read of it. Nothing moves."""
        self._deadline_ns = self._link.clock.now_ns() + round(timeout_s * 1e9)
        answer = self._ask(self._dialect.ping(self._options.node), 3)
        number, firmware = int.from_bytes(answer.data[:2], "little"), answer.data[2]
        if number != self._model.number:
            raise DeviceError(
                f"{self._place}: is {table.model_in_words(number)}, not the {self._model.name} of the rig file, "
                "which would scale every current; correct type"
            )
        self._write(table.STATUS_RETURN_LEVEL, b"\2")
        delay_s = self._read(table.RETURN_DELAY, 1)[0] * table.RETURN_DELAY_STEP_S
        if abs(delay_s - self._options.return_delay_s) > 0.5 * table.RETURN_DELAY_STEP_S:
            raise DeviceError(
                f"{self._place}: its return delay time is {delay_s * 1e6:g} us, not "
                f"{self._options.return_delay_s * 1e6:g} us; set register 9 in it, or return_delay in the rig file"
            )
        if self._read(table.DRIVE_MODE, 1)[0] & table.TORQUE_ON_BY_GOAL:
            raise DeviceError(
                f"{self._place}: any goal switches its torque on (Drive Mode, bit 3), so it cannot be kept off; clear "
                "this bit in register 10"
            )
        self._map_registers()
        self._try_fast_reading()
        address = f"{self._bus.name} id {self._options.node}"
        self._identity = DeviceIdentity("dynamixel", address, self._model.name, str(firmware))
        return self._identity

    def _map_registers(self) -> None:
        """Let the indirect data show what is read in every cycle."""
        self.readable = False
        if self._read(table.INDIRECT_ADDRESS, 2 * table.READ_LENGTH) != table.indirect_map():
            self._set(table.TORQUE_ENABLE, b"\0")
            self._set(table.INDIRECT_ADDRESS, table.indirect_map())
        wanted = self._read(table.PRESENT_VOLTAGE, 2)
        for first in self._model.indirect_data:
            shown = _SEEN.unpack(self._read(first, table.READ_LENGTH))
            if abs(shown[6] - int.from_bytes(wanted, "little")) <= 5 and shown[6]:
                self._share, self.readable = share_of(self._options, first), True
                return
        raise DeviceError(
            f"{self._place}: its indirect data are at none of {', '.join(map(str, self._model.indirect_data))}; update "
            "its firmware"
        )

    def _try_fast_reading(self) -> None:
        """Whether it knows Fast Sync Read, as its firmware does since 2021."""
        if self._dialect.fast:
            return
        place = self._share.reading
        self._dialect.fast = True
        question = self._dialect.sync_read(place.address, place.length, [self._options.node])
        pending = self._bus.ask(question, self._options.node, place.length, self._options.return_delay_s)
        wait_until(lambda: pending.done, self._link, FAST_TRIED_S)
        self._dialect.fast = pending.answer is not None

    # ---- Enabling ------------------------------------------------------------------------------------------------

    def _set_up(self) -> None:
        if self._identity is None:
            self.identify(max(self._deadline_ns - self._link.clock.now_ns(), 0) * 1e-9)
        if self._read(table.HARDWARE_ERROR, 1) != b"\0":
            self._restart()
        self._set(table.BUS_WATCHDOG, b"\0")
        mode = bytes((OPERATING_MODES[self._options.mode],))
        if self._read(table.OPERATING_MODE, 1) != mode:
            self._set(table.OPERATING_MODE, mode)
        self._set(table.PROFILE_ACCELERATION, bytes(8))
        if self._options.servo is not None:
            self._set(table.POSITION_D_GAIN, bytes(4) + self._options.position_gain.to_bytes(2, "little"))
            self._set(table.FEEDFORWARD_2ND, bytes(4))
        self._learn_limits()

    def _restart(self) -> None:
        self._bus.reboot(protocol.reboot(self._options.node))
        self.readable = False
        begun_ns = self._link.clock.now_ns()
        wait_until(lambda: self._link.clock.now_ns() - begun_ns >= RESTART_S * 1e9, self._link, RESTART_S + 1.0)
        self._write(table.STATUS_RETURN_LEVEL, b"\2")
        self._set(table.TORQUE_ENABLE, b"\0")
        self._map_registers()

    def _learn_limits(self) -> None:
        current = int.from_bytes(self._read(table.CURRENT_LIMIT, 2), "little")
        if self._options.mode == "current-based position":
            wanted = min(self._options.greatest_current_a / self._options.current_unit_a, current)
            self._set(table.GOAL_CURRENT, int(wanted).to_bytes(2, "little"))
        elif self._options.mode == "pwm":
            self._greatest = int.from_bytes(self._read(table.PWM_LIMIT, 2), "little")
        else:
            self._greatest = current

    def _arm(self) -> None:
        steps = round(self.watchdog_s / table.WATCHDOG_STEP_S)
        if steps:
            self._set(table.BUS_WATCHDOG, bytes((steps,)))

    def _at_rest(self) -> tuple[tuple[int, bytes], ...]:
        return ((table.BUS_WATCHDOG, b"\0"),)

    # ---- Goals and readings --------------------------------------------------------------------------------------

    @property
    def _unit(self) -> float:
        """What one unit of a goal is, in :attr:`command_unit`."""
        options = self._options
        match options.mode:
            case "current":
                return options.current_unit_a
            case "torque":
                return options.current_unit_a * (options.torque_constant_nm_a or 0.0)
            case "pwm":
                return 1.0 / table.FULL_PWM
        return table.POSITION_STEP_RAD

    def _goal(self, value: float) -> tuple[bytes, float]:
        count = round(value / self._unit)
        if self._options.servo is None:
            count = min(max(count, -self._greatest), self._greatest)
            return count.to_bytes(2, "little", signed=True), count * self._unit
        place = count + self._options.zero
        if self._options.mode == "position":
            place = min(max(place, 0), table.COUNTS_PER_TURN - 1)
        place = min(max(place, -(2**20)), 2**20)
        return place.to_bytes(4, "little", signed=True), (place - self._options.zero) * self._unit

    def _decoded(self, answer: Answer) -> Seen:
        try:
            torque_on, hardware, watchdog, current, velocity, position, voltage, warmth = _SEEN.unpack(answer.data)
        except error as reason:
            raise ValueError(f"a reading of {len(answer.data)} bytes") from reason
        expired = watchdog == table.WATCHDOG_EXPIRED
        errors = table.describe_hardware_error(hardware)
        if expired:
            errors = (*errors, "its bus watchdog has stopped it: no packet came in time")
        return Seen(
            torque_on=bool(torque_on),
            position_rad=(position - self._options.zero) * table.POSITION_STEP_RAD,
            velocity_rad_s=velocity * table.VELOCITY_STEP_RAD_S,
            current_a=current * self._options.current_unit_a,
            errors=errors,
            expired=expired,
            supply_v=voltage * table.VOLTAGE_STEP_V,
            temperature_c=float(warmth),
        )
