"""What VESCs have in common, whichever line they are on: options, commands and faults."""

from math import isfinite
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.vesc import describe_fault
from norton_drivers.wiring import DeviceOptions

TIMEOUT_LOOK_S = 0.010  # how often the firmware looks whether the timeout is over (bldc: timeout.c)
MOTOR_UNITS = {"torque_constant": "N*m/A", "minimum_current": "A", "watchdog": "s"}


class AmpereOptions(DeviceOptions):
    """Base of the options of drives that take currents. Each declares the fields, in the order of its questions."""

    if TYPE_CHECKING:
        mode: str
        torque_constant_nm_a: float | None
        minimum_current_a: float

    @property
    def per_ampere(self) -> float:
        """The command that one ampere is."""
        return self.torque_constant_nm_a if self.mode == "torque" and self.torque_constant_nm_a else 1.0

    @property
    def dead_band(self) -> float:
        return 0.0 if self.mode == "duty" else self.minimum_current_a * self.per_ampere

    @property
    def released_at_zero(self) -> bool:
        return self.dead_band > 0.0

    @field_validator("torque_constant_nm_a", check_fields=False)
    @classmethod
    def _is_there_for_torque(cls, constant: float | None, info: ValidationInfo) -> float | None:
        if constant is None and info.data.get("mode") == "torque":
            raise ValueError('mode = "torque" needs it')
        return constant

    def encoded(self, value: float) -> "Encoded":
        """A command in the drive's own sense. Raises CodecError for what cannot be sent."""
        current_a = value / self.per_ampere
        if abs(current_a) < self.minimum_current_a:
            current_a = 0.0  # the drive lets go of the motor
        payload = protocol.current_value(current_a)
        return Encoded(payload, protocol.current_of(payload) * self.per_ampere)


class VescMotorOptions(AmpereOptions):
    """What a rig file may say of a VESC and its motor."""

    asked: ClassVar[tuple[str, ...]] = ("mode", "position", "minimum_current")
    command_units: ClassVar = {"A": {"mode": "current"}, "N*m": {"mode": "torque"}, "1": {"mode": "duty"}}

    pole_pairs: int = Field(
        ge=1, description="pairs of magnet poles of the motor: the drive counts electrical turns", examples=[7]
    )
    mode: Literal["current", "torque", "duty"] = Field(
        "current", description='what is commanded: "current" [A], "torque" [N*m] or "duty" (share of the supply)'
    )
    torque_constant_nm_a: float | None = Field(
        None,
        alias="torque_constant",
        gt=0,
        validate_default=True,
        description='the motor\'s, with mode = "torque": the current for a torque is worked out with it',
        examples=["0.05 N*m/A"],
    )
    position: Literal["encoder", "tachometer"] = Field(
        "encoder", description="where the shaft's position comes from: encoder, or tachometer (coarse)"
    )
    minimum_current_a: float = Field(
        0.05,
        alias="minimum_current",
        ge=0,
        description="the drive's own Minimum Current: below it the motor is let go of",
        examples=["0.05 A"],
    )
    watchdog_s: float = Field(
        1.0,
        alias="watchdog",
        ge=0,
        description="the timeout set in the drive (App Settings, General)",
        examples=["1 s"],
    )

    def encoded(self, value: float) -> "Encoded":
        if self.mode == "duty":
            payload = protocol.duty_value(min(max(value, -1.0), 1.0) if isfinite(value) else value)
            return Encoded(payload, protocol.duty_of(payload))
        return super().encoded(value)


class Encoded(NamedTuple):
    """The four bytes of a command, and what they stand for in its unit."""

    payload: bytes
    sent: float


def fault_words(code: int) -> str:
    """Empty for no fault."""
    return describe_fault(code) if code else ""


class SeenFaults:
    """A fault clears itself after half a second: one that was seen while the drive was to drive stays until that is
    asked for anew. ``present`` is the one told last, empty for none."""

    def __init__(self) -> None:
        self.present = ""
        self._seen: tuple[str, ...] = ()

    def tell(self, words: str, *, kept: bool) -> None:
        """The fault that the drive tells now, empty for none."""
        self.present = words
        if words and kept and words not in self._seen:
            self._seen = (*self._seen, words)

    def forget(self) -> None:
        self._seen = ()

    def words(self) -> tuple[str, ...]:
        """Those seen, else the present one."""
        if self._seen or not self.present:
            return self._seen
        return (self.present,)
