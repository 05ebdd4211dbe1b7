"""The kinds of fault, and what may be said of each.

In a file, a fault is a table: ``[[simulated.fault]]`` of a rig, ``[[fault]]`` of a session. Quantities are written
there with their units, under the attribute's name without it (``by_s`` is ``by``, ``lasts_s`` is ``for``). In Python
the same classes are made from SI numbers: ``Delay(on="can0", at_s=0.3, lasts_s=0.1, by_s=20e-3)``.
"""

from math import inf, nan
from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from norton_bench.units import parse_quantity
from norton_drivers.registry import DRIVES
from norton_drivers.wiring import Wiring

Place = Literal["drive", "shaft", "sensor", "bus"]
DRIVE: frozenset[Place] = frozenset({"drive"})
SHAFT: frozenset[Place] = frozenset({"shaft"})  # the drives that turn it
SENSOR: frozenset[Place] = frozenset({"sensor"})
BUS: frozenset[Place] = frozenset({"bus"})
DEVICE = DRIVE | SENSOR


def _quantity(value: object, info: ValidationInfo, unit: str) -> float:
    """With its unit where it comes from a file, which gives a context; a plain SI number from Python."""
    if info.context is None and isinstance(value, (int, float)):
        return float(value)
    return parse_quantity(value, unit)


def _in(unit: str) -> BeforeValidator:
    return BeforeValidator(lambda value, info: _quantity(value, info, unit))


def _torque_or_nan(value: object, info: ValidationInfo) -> float:
    """A torque, or the word "nan"."""
    return nan if value == "nan" else _quantity(value, info, "N*m")


Seconds = Annotated[float, _in("s")]
Share = Annotated[float, _in("dimensionless")]
Torque = Annotated[float, _in("N*m")]
Angle = Annotated[float, _in("rad")]


class Fault(BaseModel):
    """What every fault has: when it begins, counted from when it was given to the world or from when all drives are
    armed after that."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)
    kind: ClassVar[str]

    at_s: Seconds = Field(0.0, alias="at", ge=0, examples=["2 s"])
    after: Literal["start", "armed"] = "start"

    @property
    def duration_s(self) -> float:
        """How long it lasts; inf for what stays."""
        return inf

    @property
    def where(self) -> str:
        """Which device, bus or machine it hits."""
        return "the bench"

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        """Why it cannot happen on this bench: the key that is wrong, and a sentence with the remedy."""
        return None


class _Lasting(Fault):
    lasts_s: Seconds = Field(inf, alias="for", gt=0, examples=["100 ms"])

    @property
    def duration_s(self) -> float:
        return self.lasts_s


class _Placed(Fault):
    places: ClassVar[frozenset[Place]]

    on: str = Field(examples=["actuator"])

    @property
    def where(self) -> str:
        return self.on

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        known = _names(wiring, self.places)
        if self.on in known:
            return None
        return "on", f'"{self.on}" is no place for {self.kind}; on this bench: {", ".join(known) or "none"}'


# ---- On the wire ---------------------------------------------------------------------------------------------------


class Carriage(_Lasting, _Placed):
    """Hits frames, or on a serial line what is written at once: of one device, or all on a bus.

    Each has the chance ``share``, until ``count`` were hit.
    """

    places = DEVICE | BUS

    towards: Literal["host", "device", "both"] = "both"
    share: Share = Field(1.0, gt=0, le=1, examples=["10 %"])
    count: int | None = Field(None, ge=1, examples=[1])


class Drop(Carriage):
    """They are lost."""

    kind = "drop"


class Delay(Carriage):
    """They come later, one after the other."""

    kind = "delay"
    by_s: Seconds = Field(alias="by", gt=0, examples=["20 ms"])


class Duplicate(Carriage):
    """They come twice."""

    kind = "duplicate"


class Reorder(Carriage):
    """They come after the one that follows them."""

    kind = "reorder"

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        if _port_of(wiring, self.on) is not None:
            return "on", f"nothing overtakes on the serial line of [{self.on}]; use duplicate, drop or delay there"
        return super().complaint(wiring)


class Corrupt(Carriage):
    """Bits of them are flipped.

    CAN's own check catches that, so that they are sent again, unless ``crc`` is "missed". A serial line has no check
    but the device's own.
    """

    kind = "corrupt"
    bits: int = Field(1, ge=1, le=64, examples=[1])
    crc: Literal["caught", "missed"] | None = None

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        if self.crc is not None and _port_of(wiring, self.on) is not None:
            return "crc", f"the serial line of [{self.on}] has no check of its own; leave crc out"
        return super().complaint(wiring)


class BabblingNode(_Lasting, _Placed):
    """A node that belongs to nobody sends frames of the highest priority, and takes ``load`` of the bus."""

    kind = "babbling-node"
    places = BUS
    load: Share = Field(1.0, gt=0, le=1, examples=["80 %"])
    arbitration_id: int = Field(0, alias="id", ge=0, le=0x7FF)


class BusOff(_Lasting, _Placed):
    """A CAN controller leaves the bus after too many errors: the host's (on = the bus) or a device's."""

    kind = "bus-off"
    places = DEVICE | BUS

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        if _port_of(wiring, self.on) is not None:
            return "on", f"[{self.on}] is on a serial line, which knows no bus-off; use unplugged or dropout there"
        return super().complaint(wiring)


class Unplugged(_Placed):
    """The host's adapter is gone: that of a bus, or of the serial port of a device."""

    kind = "unplugged"
    places = DEVICE | BUS

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        if self.on in _names(wiring, DEVICE) and _port_of(wiring, self.on) is None:
            return "on", f"[{self.on}] has no adapter of its own; name its bus, or use dropout"
        return super().complaint(wiring)


class Dropout(_Lasting, _Placed):
    """A device is silent and deaf, as with its cable pulled."""

    kind = "dropout"
    places = DEVICE


# ---- What sensors say ----------------------------------------------------------------------------------------------


class Freeze(_Lasting, _Placed):
    """An encoder or the torque sensor stands at its last value, in ever new messages."""

    kind = "freeze"
    places = DEVICE


class SignFlip(_Lasting, _Placed):
    """The torque sensor gives the opposite; an encoder goes on counting the other way."""

    kind = "sign-flip"
    places = DEVICE


class Saturation(_Lasting, _Placed):
    """The torque sensor gives no more than this."""

    kind = "saturation"
    places = SENSOR
    limit_nm: Torque = Field(alias="limit", gt=0, examples=["50 mN*m"])


class BiasJump(_Lasting, _Placed):
    """The torque sensor gives so much more, from one sample to the next."""

    kind = "bias-jump"
    places = SENSOR
    by_nm: Torque = Field(alias="by", examples=["0.2 N*m"])


class FalseReading(_Lasting, _Placed):
    """The torque sensor gives this, whatever is there; "nan" is no number."""

    kind = "false-reading"
    places = SENSOR
    torque_nm: Annotated[float, BeforeValidator(_torque_or_nan)] = Field(alias="torque", examples=["1.5 N*m"])


class EncoderJump(_Lasting, _Placed):
    """An encoder's position jumps by this."""

    kind = "encoder-jump"
    places = DRIVE
    by_rad: Angle = Field(alias="by", examples=["10 deg"])


# ---- Drives --------------------------------------------------------------------------------------------------------


class DriveError(_Placed):
    """A drive finds an error in itself, and does what it does then."""

    kind = "drive-error"
    places = DRIVE


class Undervoltage(_Placed):
    """A drive's supply fails."""

    kind = "undervoltage"
    places = DRIVE


class OverTemperature(_Placed):
    """A drive is too hot."""

    kind = "over-temperature"
    places = DRIVE


class Runaway(_Lasting, _Placed):
    """A drive gives its motor this torque whatever it is commanded, for as long as it is armed."""

    kind = "runaway"
    places = SHAFT
    torque_nm: Torque = Field(alias="torque", examples=["0.3 N*m"])


# ---- Mechanics and host --------------------------------------------------------------------------------------------


class Stuck(_Lasting, _Placed):
    """A machine stands at once, and nothing turns it."""

    kind = "stuck"
    places = DRIVE


class BrokenCoupling(Fault):
    """Actuator and load are no longer coupled."""

    kind = "broken-coupling"

    def complaint(self, wiring: Wiring) -> tuple[str, str] | None:
        return (
            ("kind", "nothing is coupled to the actuator of this bench; leave it out") if wiring.load is None else None
        )


class HostStall(Fault):
    """The host stands still while the world goes on."""

    kind = "host-stall"
    lasts_s: Seconds = Field(alias="for", gt=0, examples=["150 ms"])

    @property
    def where(self) -> str:
        return "the host"

    @property
    def duration_s(self) -> float:
        return self.lasts_s


KINDS: dict[str, type[Fault]] = {
    kind.kind: kind
    for kind in (
        Drop,
        Delay,
        Duplicate,
        Reorder,
        Corrupt,
        BabblingNode,
        BusOff,
        Unplugged,
        Dropout,
        Freeze,
        SignFlip,
        Saturation,
        BiasJump,
        FalseReading,
        EncoderJump,
        DriveError,
        Undervoltage,
        OverTemperature,
        Runaway,
        Stuck,
        BrokenCoupling,
        HostStall,
    )
}


def _names(wiring: Wiring, places: frozenset[Place]) -> list[str]:
    """What of this bench is such a place."""
    roles = [device.role for device in wiring.devices()]
    sensors = [role for role in roles if role == "torque_sensor" and "sensor" in places]
    drives = [role for role in roles if role in DRIVES and "drive" in places]
    drives += [role for role in roles if role in ("actuator", "load") and "shaft" in places]
    return [*drives, *sensors, *(bus.name for bus in wiring.buses if "bus" in places)]


def _port_of(wiring: Wiring, role: str) -> str | None:
    """The serial port of the device in that role; None where it has none, or there is no such device."""
    return next((device.port for device in wiring.devices() if device.role == role), None)
