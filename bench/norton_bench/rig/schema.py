"""The sections of a rig file, as they are written; ``docs/rig-file.md`` explains them."""

from math import inf, isnan, nan
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator

from norton_bench.errors import nearest
from norton_bench.units import check_unit, parse_quantity, quantity_in, same_dimension
from norton_drivers.wiring import CanBusSettings

UNLIMITED = "unlimited"
# The guard's plausibility checks, which docs/safety.md explains.
PLAUSIBILITY = (
    "encoder",
    "coupling",
    "modulator",
    "standstill",
    "current",
    "frozen torque",
    "torque jump",
    "saturation",
    "balance",
)

# Faster than any machine turns: the record is 1e6 rpm (Zwyssig, Kolar and Round 2009, "Megaspeed drive systems").
FASTEST_RAD_S = 2e5


class SectionModel(BaseModel):
    """Base of every section: nothing is guessed, nothing unknown is passed over."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


def _or_unlimited(unit: str) -> BeforeValidator:
    """A quantity in ``unit``, or the word "unlimited", which is infinity."""
    return BeforeValidator(lambda text: inf if text == UNLIMITED else parse_quantity(text, unit))


def _in_command_unit(text: object, info: ValidationInfo) -> float:
    """A quantity in the unit that stands before it; nan where that one is wrong already."""
    unit = info.data.get("unit")
    return nan if unit is None else parse_quantity(text, unit)


def _per_second(text: object, info: ValidationInfo) -> float:
    """A quantity in the command's unit per second, or "unlimited"."""
    unit = (info.context or {}).get("command_unit")
    if text == UNLIMITED or unit is None:
        return inf
    return parse_quantity(text, f"({unit})/s")


def _positive_or_unknown(value: float) -> float:
    if not (isnan(value) or value > 0):
        raise ValueError("must be greater than 0")
    return value


def _of_can_fd(data_bitrate_bit_s: float, info: ValidationInfo) -> float:
    if not info.data.get("fd"):
        raise ValueError("is of CAN FD alone; write fd = true, or leave it out")
    if data_bitrate_bit_s < info.data.get("bitrate_bit_s", 0.0):
        raise ValueError("is below bitrate; the data of CAN FD go at least as fast as the rest")
    return data_bitrate_bit_s


def _plausibility(name: str) -> str:
    if name not in PLAUSIBILITY:
        raise ValueError(f'"{name}" is no plausibility check; {nearest(name, PLAUSIBILITY)}')
    return name


class RigSection(SectionModel):
    """``[rig]``: the bench as a whole."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", examples=["my-bench"])
    rate_hz: Annotated[float, quantity_in("Hz")] = Field(alias="rate", ge=10, le=5000, examples=["1 kHz"])
    backend: str = Field("hardware", examples=["hardware"])
    shaft: Literal["free", "clamped"] = "free"


class BusSection(SectionModel):
    """``[bus.NAME]``: one CAN bus, in python-can's terms; ``options`` are handed to python-can as they stand.

    ``fd``: it carries CAN FD frames, too, whose data go at ``data_bitrate``, or at no rate of their own.
    """

    interface: str = Field(examples=["socketcan"])
    channel: str = Field(examples=["can0"])
    bitrate_bit_s: Annotated[float, quantity_in("bit/s")] = Field(1e6, alias="bitrate", gt=0, examples=["1 Mbit/s"])
    fd: bool = Field(False, examples=[True])
    data_bitrate_bit_s: Annotated[float, quantity_in("bit/s"), AfterValidator(_of_can_fd)] | None = Field(
        None, alias="data_bitrate", gt=0, examples=["5 Mbit/s"]
    )
    options: dict[str, Any] = Field(default_factory=dict)

    def settings(self, name: str) -> CanBusSettings:
        """For the drivers."""
        data_bit_s = None if self.data_bitrate_bit_s is None else round(self.data_bitrate_bit_s)
        bitrate_bit_s = round(self.bitrate_bit_s)
        return CanBusSettings(name, self.interface, self.channel, bitrate_bit_s, self.options, self.fd, data_bit_s)


class DeviceSection(SectionModel):
    """What every device has; keys beyond these are its driver's options."""

    model_config = ConfigDict(strict=True, frozen=True, extra="allow")

    driver: str = Field(examples=["odrive"])
    bus: str | None = Field(None, examples=["can0"])
    port: str | None = Field(None, examples=["/dev/ttyUSB0"])
    direction: Literal[1, -1] = 1

    @property
    def driver_options(self) -> dict[str, Any]:
        return dict(self.model_extra or {})


class CommandSection(SectionModel):
    """``command = { unit, limit }``: what the actuator is told, and how much of it at most.

    ``lowest`` is the least that it makes sense to tell; ``sent_as`` is the unit in which the drive understands the
    same number, where its input stands for something else.
    """

    unit: Annotated[str, AfterValidator(check_unit)] = Field(examples=["N*m"])
    limit: Annotated[float, BeforeValidator(_in_command_unit), AfterValidator(_positive_or_unknown)] = Field(
        examples=["0.5 N*m"]
    )
    lowest: Annotated[float, BeforeValidator(_in_command_unit)] = Field(-inf, examples=["0 N*m"])
    sent_as: Annotated[str, AfterValidator(check_unit)] | None = Field(None, examples=["N*m"])

    @model_validator(mode="after")
    def _in_order(self) -> "CommandSection":
        if self.lowest >= self.limit:
            raise ValueError(f"lowest = {self.lowest:g} {self.unit} is not below limit; lower it, or raise the limit")
        return self

    @property
    def limit_nm(self) -> float | None:
        """The limit in newton metres, where the command is a torque."""
        return parse_quantity(f"{self.limit!r} {self.unit}", "N*m") if same_dimension(self.unit, "N*m") else None


class ActuatorSection(DeviceSection):
    """``[actuator]``: the device under test. ``model`` is what it is identified as: "none" measures tables alone."""

    model: Literal["dahl_motor", "none"] = "dahl_motor"
    command: CommandSection = Field(examples=[{"unit": "N*m", "limit": "0.5 N*m"}])


class LoadSection(DeviceSection):
    """``[load]``: the machine that imposes torque or motion."""

    torque_limit_nm: Annotated[float, _or_unlimited("N*m")] = Field(inf, alias="torque_limit", gt=0, examples=["1 N*m"])


class ModulatorSection(DeviceSection):
    """``[modulator]``: the second drive of the device under test, which sets its impedance and not its source."""

    command: CommandSection = Field(examples=[{"unit": "N*m/rad", "limit": "4 N*m/rad", "lowest": "0 N*m/rad"}])


class LimitsSection(SectionModel):
    """``[limits]``: what the guard holds."""

    torque_nm: Annotated[float, _or_unlimited("N*m")] = Field(inf, alias="torque", gt=0, examples=["1 N*m"])
    velocity_rad_s: Annotated[float, quantity_in("rad/s")] = Field(
        alias="velocity", gt=0, le=FASTEST_RAD_S, examples=["60 rad/s"]
    )
    position_rad: Annotated[float, _or_unlimited("rad")] = Field(inf, alias="position", gt=0, examples=["20 rad"])
    power_w: Annotated[float, _or_unlimited("W")] = Field(inf, alias="power", gt=0, examples=["20 W"])
    temperature_c: Annotated[float, _or_unlimited("degC")] = Field(inf, alias="temperature", gt=0, examples=["80 degC"])
    command_rate_per_s: Annotated[float, BeforeValidator(_per_second)] = Field(
        inf, alias="command_rate", gt=0, examples=["50 N*m/s"]
    )
    twist_rad: Annotated[float, _or_unlimited("rad")] = Field(0.5, alias="twist", gt=0, examples=["0.5 rad"])
    stale_after_s: Annotated[float, quantity_in("s")] = Field(5e-3, alias="stale_after", gt=0, examples=["5 ms"])
    stall_after_s: Annotated[float, quantity_in("s")] = Field(50e-3, alias="stall_after", gt=0, examples=["50 ms"])


class GuardSection(SectionModel):
    """``[guard]``: what the guard does beyond its limits."""

    leave_out: list[Annotated[str, AfterValidator(_plausibility)]] = Field(default_factory=list, examples=[["current"]])
    verify_watchdogs: bool = Field(True, examples=[True])


class RecordingSection(SectionModel):
    """``[recording]``: what is written beside the recording."""

    candump: bool = Field(True, examples=[False])
