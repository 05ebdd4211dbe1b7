"""What a rig file may say of a Dynamixel X servo."""

from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.drive_base import FedWatchdog
from norton_drivers.dynamixel import table
from norton_drivers.dynamixel.table import MODELS, OperatingMode
from norton_drivers.half_duplex.options import BusServoOptions
from norton_drivers.servo import Servo

Mode = Literal["current", "torque", "pwm", "position", "extended position", "current-based position"]
OPERATING_MODES: dict[Mode, OperatingMode] = {
    "current": OperatingMode.CURRENT,
    "torque": OperatingMode.CURRENT,
    "pwm": OperatingMode.PWM,
    "position": OperatingMode.POSITION,
    "extended position": OperatingMode.EXTENDED_POSITION,
    "current-based position": OperatingMode.CURRENT_BASED_POSITION,
}
BY_PWM = ("position", "extended position")
BY_CURRENT = ("torque", "current-based position")
UNITS: dict[Mode, str] = {"current": "A", "torque": "N*m", "pwm": "1"}


class DynamixelOptions(BusServoOptions):
    """What a rig file may say of a Dynamixel X servo."""

    asked: ClassVar = ("baud", "mode")
    command_units: ClassVar = {
        "A": {"mode": "current"},
        "N*m": {"mode": "torque"},
        "1": {"mode": "pwm"},
        "rad": {"mode": "current-based position"},
    }

    model: str = Field(
        alias="type", description="which model it is: the unit of its currents depends on it", examples=["XL330-M288"]
    )
    mode: Mode = Field(
        "current",
        description='what is commanded: "current" [A], "torque" [N*m], "pwm" (a share of the supply), or an angle '
        '[rad]: "position", "extended position", "current-based position"',
    )
    torque_constant_nm_a: float | None = Field(
        None,
        alias="torque_constant",
        gt=0,
        validate_default=True,
        description="torque at the shaft per ampere; for the modes torque and current-based position",
        examples=["0.4 N*m/A"],
    )
    stall_torque_nm: float | None = Field(
        None,
        alias="stall_torque",
        gt=0,
        validate_default=True,
        description="torque of the held shaft at full PWM: supply voltage / winding resistance * torque constant; for "
        "the modes position and extended position",
        examples=["0.5 N*m"],
    )
    position_gain: int = Field(
        0,
        ge=0,
        le=16383,
        validate_default=True,
        description="Position P Gain (84), which the driver writes, with I, D and feed-forward gains of zero; for "
        "the modes that are commanded in rad",
        examples=[400],
    )
    greatest_current_a: float = Field(
        inf,
        alias="greatest_current",
        gt=0,
        description='Goal Current (102), its limit with mode = "current-based position"; by default that of the device',
        examples=["0.8 A"],
    )
    zero: int = Field(
        2048, ge=-(2**20), le=2**20, description="the count of Present Position (132) that is an angle of zero"
    )
    loop_period_s: float = Field(
        1e-3, alias="loop_period", gt=0, le=1e-2, description="how often it works out its position loop"
    )
    watchdog: FedWatchdog = Field(
        0.1,
        le=table.WATCHDOG_MAX * table.WATCHDOG_STEP_S,
        description="Bus Watchdog (98): silence on the line after which it stops, in steps of 20 ms; 0 for none",
        examples=["100 ms"],
    )

    @field_validator("model")
    @classmethod
    def _is_known(cls, model: str) -> str:
        if model.upper() not in MODELS:
            raise ValueError(f"not a model that is known here; known: {', '.join(MODELS)}")
        return model.upper()

    @field_validator("torque_constant_nm_a")
    @classmethod
    def _is_there_for_current(cls, value: float | None, info: ValidationInfo) -> float | None:
        return _needed(value, info, BY_CURRENT)

    @field_validator("stall_torque_nm")
    @classmethod
    def _is_there_for_pwm(cls, value: float | None, info: ValidationInfo) -> float | None:
        return _needed(value, info, BY_PWM)

    @field_validator("position_gain")
    @classmethod
    def _holds(cls, gain: int, info: ValidationInfo) -> int:
        if gain == 0 and info.data.get("mode") not in (None, *UNITS):
            raise ValueError(f'mode = "{info.data["mode"]}" needs it; with a gain of zero the servo holds nothing')
        return gain

    @property
    def command_unit(self) -> str:
        return UNITS.get(self.mode, "rad")

    @property
    def watchdog_s(self) -> float:
        return round(self.watchdog / table.WATCHDOG_STEP_S) * table.WATCHDOG_STEP_S

    @property
    def current_unit_a(self) -> float:
        return MODELS[self.model].current_unit_a

    @property
    def greatest_position_rad(self) -> float:
        within = min(self.zero, table.COUNTS_PER_TURN - 1 - self.zero)
        return within * table.POSITION_STEP_RAD if self.mode == "position" else inf

    @property
    def servo(self) -> Servo | None:
        """As the gain and the scales of the rig file have it: e-Manual, "Position PID Gain": KPP = gain / 128."""
        if self.command_unit != "rad":
            return None
        per_rad = self.position_gain / table.POSITION_P_SCALE / table.POSITION_STEP_RAD
        delay_s = 0.5 * self.loop_period_s  # what is worked out is held for a period
        if self.stall_torque_nm is not None and self.mode in BY_PWM:
            return Servo(
                per_rad / table.FULL_PWM * self.stall_torque_nm, delay_s=delay_s, greatest_nm=self.stall_torque_nm
            )
        constant = self.torque_constant_nm_a or 0.0
        return Servo(
            per_rad * self.current_unit_a * constant, delay_s=delay_s, greatest_nm=self.greatest_current_a * constant
        )


def _needed(value: float | None, info: ValidationInfo, modes: tuple[str, ...]) -> float | None:
    if value is None and info.data.get("mode") in modes:
        raise ValueError(f'mode = "{info.data["mode"]}" needs it')
    return value
