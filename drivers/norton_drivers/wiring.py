"""How the devices of one bench are connected: plain data, validated by whoever reads the rig file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any, ClassVar, Final, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from norton_drivers.errors import WiringError
from norton_drivers.serial_timing import Exchange
from norton_drivers.servo import Servo


@dataclass(frozen=True)
class CanBusSettings:
    """One CAN bus, in python-can's own terms (``interface``, ``channel``, ``bitrate`` and its further options).

    ``fd`` is whether it carries CAN FD frames beside classical ones. Their data go at ``data_bitrate_bit_s``; None:
    they have no rate of their own, and nothing is switched.
    """

    name: str
    interface: str
    channel: str
    bitrate_bit_s: int = 1_000_000
    options: Mapping[str, Any] = field(default_factory=dict)
    fd: bool = False
    data_bitrate_bit_s: int | None = None

    @property
    def switches_bitrate(self) -> bool:
        """Whether the data of CAN FD frames go at a rate of their own."""
        return self.fd and self.data_bitrate_bit_s is not None

    @property
    def rates(self) -> str:
        """Its bit rates in words."""
        data = f" (data {self.data_bitrate_bit_s} bit/s)" if self.switches_bitrate else ""
        return f"{self.bitrate_bit_s} bit/s{data}"


@dataclass(frozen=True)
class DeviceSettings:
    """One device: its driver's name, where it is connected, and the options its driver understands.

    ``direction`` is +1 or -1: the sign that turns the device's own positive sense into the bench's
    (the actuator's positive rotation, seen at the port; positive torque accelerates the load that way).
    """

    role: str  # its section in the rig file: "actuator", "load", "torque_sensor", "modulator", or a further sensor's
    driver: str
    bus: str | None = None  # the name of a CAN bus
    port: str | None = None  # a serial port: a path or any pyserial URL
    direction: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)
    released_at_zero: bool = False  # as its driver's options have it
    answers_commands: bool = False  # likewise
    dead_band: float = 0.0  # commands smaller than this do nothing, in the unit of its commands
    servo: Servo | None = None  # what it does with a command that is a position or a velocity


@dataclass(frozen=True)
class Wiring:
    """Everything the backends and the drivers need to know of a rig."""

    name: str
    tick_ns: int
    buses: tuple[CanBusSettings, ...]
    actuator: DeviceSettings
    torque_sensor: DeviceSettings | None = None
    load: DeviceSettings | None = None
    shaft: str = "free"  # where there is no load drive: "free" or "clamped"
    command_unit: str = "N*m"  # of the actuator's command
    modulator: DeviceSettings | None = None  # the actuator's second drive, which sets its impedance
    modulation_unit: str = ""  # of its command
    sensors: tuple[DeviceSettings, ...] = ()  # further ones, which only the recording and the screen need

    def devices(self) -> tuple[DeviceSettings, ...]:
        """The devices that are there, the actuator first."""
        present = (self.actuator, self.load, self.torque_sensor, self.modulator, *self.sensors)
        return tuple(device for device in present if device is not None)


# A sensor slower than this tells nothing of an actuator's lag.
AVERAGING_MAX_S: Final = 0.05


# The options of a device, as its driver declares them: checked in one place, complained about in one sentence.
#
# A driver module declares its options as a frozen pydantic model and names in ``OPTION_UNITS`` those that are
# quantities: a rig file says ``watchdog = "100 ms"``, and the driver receives ``0.1``, in the unit that
# ``OPTION_UNITS`` gives.
class DeviceOptions(BaseModel):
    """Base of every driver's options."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False, populate_by_name=False)

    # The units in which an amplifier can be commanded, each with what its options must be: {"A": {"mode": "current"}}.
    # Empty for a torque sensor, and for a driver that knows its unit only once it is open.
    command_units: ClassVar[Mapping[str, Mapping[str, object]]] = {}

    # Whether the drive takes its readings when a command arrives, and answers with them: they then belong to the
    # instants of the commands.
    answers_commands: ClassVar[bool] = False

    # Options whose default is often not right: who writes a new rig file is asked for them.
    asked: ClassVar[tuple[str, ...]] = ()

    # Options that come first in questions and lists although a base class has others: where the device is.
    first: ClassVar[tuple[str, ...]] = ("node",)

    @classmethod
    def __pydantic_init_subclass__(cls, **_settings: Any) -> None:
        fields = cls.__pydantic_fields__
        for name in [name for name in fields if name not in cls.first]:
            fields[name] = fields.pop(name)

    @property
    def command_unit(self) -> str | None:
        """The unit of its commands as these options set it; None where only the open device tells."""
        for unit, chosen in self.command_units.items():
            if all(getattr(self, name) == value for name, value in chosen.items()):
                return unit
        return None

    @property
    def dead_band(self) -> float:
        """Commands smaller than this do nothing: the drive lets go of its motor. In the unit of its commands."""
        return 0.0

    @property
    def greatest_position_rad(self) -> float:
        """How far from the drive's own zero its position can be read."""
        return inf

    @property
    def greatest_velocity_rad_s(self) -> float:
        """The greatest velocity that its readings can tell."""
        return inf

    @property
    def servo(self) -> Servo | None:
        """The drive's own loop, where its commands are positions or velocities."""
        return None

    @property
    def exchange(self) -> Exchange | None:
        """What crosses the serial line of a drive that has one of its own; None for what is on a bus, or streams."""
        return None

    @property
    def released_at_zero(self) -> bool:
        """Whether the drive switches its bridge off at a command of zero: the motor's current then ends at once,
        without the lag of its current loop."""
        return False


class TorqueSensorOptions(DeviceOptions):
    """Base of every shipped torque sensor's options: what the identification must know of how it measures."""

    averaging_s: float = Field(
        0.0,
        alias="averaging",
        ge=0,
        le=AVERAGING_MAX_S,
        description="over how long the sensor averages by itself: its filter's length",
        examples=["2 ms"],
    )


Options = TypeVar("Options", bound=DeviceOptions)


def parse_options(model: type[Options], settings: DeviceSettings) -> Options:
    """The options of ``settings``. Raises WiringError, in one sentence with the place, for the first mistake."""
    try:
        return model.model_validate(dict(settings.options))
    except ValidationError as error:
        raise WiringError(_sentence(error, model, settings)) from error


def written_as(model: type[DeviceOptions], name: str) -> str:
    """What a rig file calls the option: for a wrong default, the field's own name."""
    field = model.model_fields.get(name)
    return (field.alias if field is not None else None) or name


def _sentence(error: ValidationError, model: type[DeviceOptions], settings: DeviceSettings) -> str:
    mistake = error.errors()[0]
    name = written_as(model, str(mistake["loc"][0])) if mistake["loc"] else "options"
    hints = {field.alias or key: field.description or "" for key, field in model.model_fields.items()}
    if mistake["type"] == "missing":
        return f'[{settings.role}] driver = "{settings.driver}" needs {name}: {hints[name]}'
    if mistake["type"] == "extra_forbidden":
        return f'[{settings.role}] {name} is not an option of driver "{settings.driver}"; known: {", ".join(hints)}'
    message = mistake["msg"].removeprefix("Value error, ")
    return (
        f"[{settings.role}] {name} = {mistake['input']!r}: {message[:1].lower()}{message[1:]} ({hints.get(name, '')})"
    )
