"""What a rig file may say of an actuator in MIT mode."""

from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.ranges import Ranges
from norton_drivers.servo import Servo
from norton_drivers.spoken_to.options import (
    BeyondRange,
    Damping,
    GreatestTorque,
    LoopPeriod,
    Stiffness,
    TorqueConstant,
    VelocityWindow,
    check_damping,
    check_gains,
    servo_of,
)
from norton_drivers.wiring import DeviceOptions

LEAST_PROBE_STEPS = 8
_ANY = Ranges(1.0, 1.0, 1.0)  # the codes of gains do not depend on what a motor's other codes span


class MitOptions(DeviceOptions):
    """What a rig file may say of an actuator in MIT mode."""

    asked: ClassVar = ("beyond_range", "watchdog")
    answers_commands: ClassVar = True
    command_units: ClassVar = {
        "N*m": {"mode": "torque"},
        "rad": {"mode": "position"},
        "rad/s": {"mode": "velocity"},
    }

    node: int = Field(ge=0, le=protocol.NODE_MAX, description="the motor's CAN id", examples=[1])
    master: int = Field(0, ge=0, le=protocol.IDENTIFIER_MAX, description="the CAN id that its replies come with")
    position_range_rad: float = Field(
        alias="position_range",
        gt=0,
        description="positions go from minus to plus this; as in the drive's own table",
        examples=["12.5 rad"],
    )
    velocity_range_rad_s: float = Field(
        alias="velocity_range",
        gt=0,
        description="velocities go from minus to plus this; as in the drive's own table",
        examples=["50 rad/s"],
    )
    torque_range_nm: float = Field(
        alias="torque_range",
        gt=0,
        description="torques go from minus to plus this; as in the drive's own table: a wrong one scales every torque",
        examples=["18 N*m"],
    )
    beyond_range: BeyondRange = "saturates"
    torque_constant_nm_a: TorqueConstant = None
    temperature_offset_c: float = Field(
        0.0,
        alias="temperature_offset",
        ge=-40,
        le=0,
        description="added to the temperature byte where a drive sends one: 0, or -40 by later manuals",
        examples=[-40],
    )
    watchdog_s: float = Field(
        0.0,
        alias="watchdog",
        ge=0,
        description="the timeout set in the drive; 0 where there is none, or nobody knows",
        examples=["200 ms"],
    )
    watchdog_probe_nm: float = Field(
        0.0,
        alias="watchdog_probe",
        ge=0,
        description="torque whose end shows the timeout at work; too small to turn the shaft, 0 for none",
        examples=["0.01 N*m"],
    )

    mode: Literal["torque", "position", "velocity"] = Field(
        "torque",
        description='what is commanded: "torque" [N*m]; "position" [rad] or "velocity" [rad/s], which the drive holds',
    )
    stiffness_nm_rad: Stiffness = None
    damping_nms_rad: Damping = 0.0
    greatest_torque_nm: GreatestTorque = inf
    loop_period_s: LoopPeriod = 25e-6
    velocity_window_s: VelocityWindow = 475e-6

    @property
    def servo(self) -> Servo | None:
        return servo_of(self, self.ranges)

    @field_validator("stiffness_nm_rad")
    @classmethod
    def _is_there_for_position(cls, stiffness_nm_rad: float | None, info: ValidationInfo) -> float | None:
        check_gains(info.data.get("mode"), stiffness_nm_rad, _ANY)
        return stiffness_nm_rad

    @field_validator("damping_nms_rad")
    @classmethod
    def _can_be_sent(cls, damping_nms_rad: float, info: ValidationInfo) -> float:
        check_damping(info.data.get("mode"), damping_nms_rad, _ANY)
        return damping_nms_rad

    @property
    def ranges(self) -> Ranges:
        return Ranges(self.position_range_rad, self.velocity_range_rad_s, self.torque_range_nm)

    @property
    def greatest_position_rad(self) -> float:
        return self.position_range_rad if self.beyond_range == "saturates" else inf

    @property
    def greatest_velocity_rad_s(self) -> float:
        return self.velocity_range_rad_s

    @field_validator("watchdog_probe_nm")
    @classmethod
    def _can_be_seen(cls, probe_nm: float, info: ValidationInfo) -> float:
        least_nm = LEAST_PROBE_STEPS * Ranges(1.0, 1.0, info.data.get("torque_range_nm", 0.0)).torque_step_nm
        if 0 < probe_nm < least_nm:
            raise ValueError(f"cannot be told from nothing in steps of torque_range; at least {least_nm:.2g} N*m")
        return probe_nm
