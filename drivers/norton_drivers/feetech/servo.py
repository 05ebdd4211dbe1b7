"""Feetech STS and SCS servos on a half-duplex line: PWM, a torque as a share of PWM, or an angle.

What the driver writes, with the torque off, is not kept in the servo: it locks the EPROM first, and values written to
locked addresses act until the supply is switched off. Each is read back. Sources: as for
:mod:`norton_drivers.feetech.table`. The servo has no watchdog: if the program dies, it goes on with its last goal.
"""

from math import nan
from typing import ClassVar

from norton_drivers.codecs.feetech import describe_error, signed, with_sign
from norton_drivers.codecs.half_duplex import Answer
from norton_drivers.errors import DeviceError
from norton_drivers.feetech import table
from norton_drivers.feetech.options import FeetechOptions
from norton_drivers.half_duplex.drive import BusServo, Seen
from norton_drivers.half_duplex.line import Registers, Share
from norton_drivers.half_duplex.master import BusMaster
from norton_drivers.link import Link
from norton_drivers.readings import DeviceIdentity, Unwrapped
from norton_drivers.wiring import DeviceSettings


def share_of(options: FeetechOptions) -> Share:
    """Its part of a cycle."""
    goal = table.GOAL_POSITION if options.mode == "position" else table.GOAL_PWM
    return Share(options.node, Registers(goal, 2), Registers(*options.kind.read), options.return_delay_s)


class FeetechServo(BusServo):
    """One servo."""

    what: ClassVar = "Feetech servo"
    torque_enable: ClassVar = table.TORQUE_ENABLE

    def __init__(self, settings: DeviceSettings, options: FeetechOptions, bus: BusMaster, link: Link) -> None:
        self._options = options
        self._model = options.kind
        self._share = share_of(options)
        self._phase = 0
        self._places: Unwrapped | None = None
        self._identity: DeviceIdentity | None = None
        super().__init__(settings, options, bus, link)

    @property
    def share(self) -> Share:
        return self._share

    @property
    def position_resolution_rad(self) -> float:
        return self._model.step_rad

    def made_itself_safe(self) -> bool | None:
        return None

    # ---- Who is there --------------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Read which model it is, and how it tells positions and speeds. Nothing moves."""
        self._deadline_ns = self._link.clock.now_ns() + round(timeout_s * 1e9)
        told = self._read(table.IDENTITY, table.IDENTITY_LENGTH)
        number = int.from_bytes(told[3:5], self._model.order)
        if number != self._model.number:
            other = int.from_bytes(told[3:5], "big" if self._model.order == "little" else "little")
            known = {model.number for model in table.MODELS.values()}
            name = table.model_in_words(number if number in known else other)
            raise DeviceError(
                f"{self._place}: is {name}, not the {self._model.name} of the rig file, which would read its numbers "
                "wrongly; correct type"
            )
        delay_s = self._read(table.RETURN_DELAY, 1)[0] * table.RETURN_DELAY_STEP_S
        if abs(delay_s - self._options.return_delay_s) > 0.5 * table.RETURN_DELAY_STEP_S:
            raise DeviceError(
                f"{self._place}: its return delay is {delay_s * 1e6:g} us, not "
                f"{self._options.return_delay_s * 1e6:g} us; set register 7 in it, or return_delay in the rig file"
            )
        self._phase = self._read(table.PHASE, 1)[0]
        self._places = None
        self.readable = True
        address = f"{self._bus.name} id {self._options.node}"
        self._identity = DeviceIdentity("feetech", address, self._model.name, f"{told[0]}.{told[1]}")
        return self._identity

    # ---- Enabling ------------------------------------------------------------------------------------------------

    def _set_up(self) -> None:
        if self._identity is None:
            self.identify(max(self._deadline_ns - self._link.clock.now_ns(), 0) * 1e-9)
        sts = self._model.together
        self._set(table.LOCK_STS if sts else table.LOCK_SCS, b"\1")
        holds = self._options.mode == "position"
        if sts:
            self._set(table.MODE, bytes((table.MODE_POSITION if holds else table.MODE_PWM,)))
            self._set(table.TORQUE_LIMIT, self._number(table.FULL_PWM))
        else:  # limits of zero would make a motor of it
            self._set(table.MIN_ANGLE, self._number(0) + self._number(self._model.counts - 1))
        if holds:
            self._set(table.P_GAIN, bytes((self._options.position_gain, 0, 0)))
            self._set(table.MIN_START_FORCE, bytes(4))  # and no dead zone
            self._set(table.ACCELERATION, b"\0")
            self._set(table.GOAL_SPEED, self._number(table.FASTEST_COUNTS_S))

    def _number(self, value: int) -> bytes:
        return value.to_bytes(2, self._model.order)

    # ---- Goals and readings --------------------------------------------------------------------------------------

    def _goal(self, value: float) -> tuple[bytes, float]:
        options = self._options
        if options.mode == "position":
            step_rad = self._model.step_rad
            place = round(value / step_rad) + options.zero
            place = min(max(place, 0), self._model.counts - 1)
            return self._number(place), (place - options.zero) * step_rad
        unit = (options.stall_torque_nm or 1.0) if options.mode == "torque" else 1.0
        pwm = round(value / unit * table.FULL_PWM)
        pwm = min(max(pwm, -table.FULL_PWM), table.FULL_PWM)
        return self._number(with_sign(pwm, table.PWM_SIGN)), pwm * unit / table.FULL_PWM

    def _decoded(self, answer: Answer) -> Seen:
        first, length = self._model.read
        if len(answer.data) != length:
            raise ValueError(f"a reading of {len(answer.data)} bytes")

        def number(address: int, sign_bit: int = 16) -> int:
            at = address - first
            return signed(int.from_bytes(answer.data[at : at + 2], self._model.order), sign_bit)

        def byte(address: int) -> int:
            return answer.data[address - first]

        speed = number(table.PRESENT_SPEED, table.POSITION_SIGN)
        speed *= 1 if self._phase & table.SLOW_UNIT_BIT else table.COARSE_SPEED_COUNTS_S
        place = self._followed(number(table.PRESENT_POSITION, table.POSITION_SIGN))
        current = number(table.PRESENT_CURRENT, table.CURRENT_SIGN) if self._model.currents else nan
        return Seen(
            torque_on=bool(byte(table.TORQUE_ENABLE)),
            position_rad=(place - self._options.zero) * self._model.step_rad,
            velocity_rad_s=speed * self._model.step_rad,
            current_a=current * table.CURRENT_STEP_A,
            errors=describe_error(answer.error | byte(table.STATUS)),
            supply_v=byte(table.PRESENT_VOLTAGE) * table.VOLTAGE_STEP_V,
            temperature_c=float(byte(table.PRESENT_TEMPERATURE)),
        )

    def _followed(self, place: int) -> int:
        """Over several turns, where it tells the place within one."""
        if self._phase & table.WHOLE_ANGLE_BIT or self._options.mode == "position":
            return place
        if self._places is None:
            self._places = Unwrapped(self._model.counts)
        return self._places.follow(place)
