"""What a rig file may say of a Feetech servo."""

from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.feetech import table
from norton_drivers.feetech.table import MODELS, Model
from norton_drivers.half_duplex.options import BusServoOptions
from norton_drivers.servo import Servo

Mode = Literal["pwm", "torque", "position"]
UNITS: dict[Mode, str] = {"pwm": "1", "torque": "N*m", "position": "rad"}


class FeetechOptions(BusServoOptions):
    """What a rig file may say of a Feetech servo."""

    asked: ClassVar = ("mode",)
    command_units: ClassVar = {unit: {"mode": mode} for mode, unit in UNITS.items()}

    model: str = Field(alias="type", description="which model it is: byte order and scales", examples=["STS3215"])
    mode: Mode = Field(
        "pwm",
        validate_default=True,
        description='what is commanded: "pwm" (a share of the supply), "torque" [N*m], as a share of stall_torque, '
        'or "position" [rad]',
    )
    stall_torque_nm: float | None = Field(
        None,
        alias="stall_torque",
        gt=0,
        validate_default=True,
        description="torque of the held shaft at full PWM; for the modes torque and position",
        examples=["1.9 N*m"],
    )
    position_gain: int = Field(
        32, ge=1, le=254, description='P (21), which the driver writes with D and I of zero; for mode = "position"'
    )
    zero_count: int | None = Field(
        None,
        alias="zero",
        ge=0,
        validate_default=True,
        description="the count of Present Position (56) that is an angle of zero; the middle of what it tells",
        examples=[2048],
    )
    loop_period_s: float = Field(
        1e-3, alias="loop_period", gt=0, le=1e-2, description="how often it works out its position loop"
    )

    @field_validator("model")
    @classmethod
    def _is_known(cls, model: str) -> str:
        if model.upper() not in MODELS:
            raise ValueError(f"not a model that is known here; known: {', '.join(MODELS)}")
        return model.upper()

    @field_validator("mode")
    @classmethod
    def _is_within_a_turn(cls, value: Mode, info: ValidationInfo) -> Mode:
        model = MODELS.get(info.data.get("model", ""))
        if value != "position" and model is not None and not model.turns:
            raise ValueError(f'{model.name} tells less than a turn, and turns on beyond it: write mode = "position"')
        return value

    @field_validator("zero_count")
    @classmethod
    def _is_told(cls, value: int | None, info: ValidationInfo) -> int | None:
        model = MODELS.get(info.data.get("model", ""))
        if value is not None and model is not None and value >= model.counts:
            raise ValueError(f"{model.name} tells counts from 0 to {model.counts - 1}")
        return value

    @field_validator("stall_torque_nm")
    @classmethod
    def _is_there_for_torque(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is None and info.data.get("mode") in ("torque", "position"):
            raise ValueError(f'mode = "{info.data["mode"]}" needs it')
        return value

    @property
    def command_unit(self) -> str:
        return UNITS[self.mode]

    @property
    def kind(self) -> Model:
        """What differs between the models."""
        return MODELS[self.model]

    @property
    def zero(self) -> int:
        """The count that is an angle of zero."""
        return self.kind.counts // 2 if self.zero_count is None else self.zero_count

    @property
    def greatest_position_rad(self) -> float:
        within = min(self.zero, self.kind.counts - 1 - self.zero)
        return within * self.kind.step_rad if self.mode == "position" else inf

    @property
    def servo(self) -> Servo | None:
        """As the scale of the table has it."""
        if self.mode != "position" or self.stall_torque_nm is None:
            return None
        stiffness = self.position_gain * table.DUTY_PER_RAD * self.stall_torque_nm
        return Servo(stiffness, delay_s=0.5 * self.loop_period_s, greatest_nm=self.stall_torque_nm)
