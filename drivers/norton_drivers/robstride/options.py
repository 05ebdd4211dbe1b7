"""What a rig file may say of a RobStride motor or a CyberGear."""

from dataclasses import replace
from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import robstride as protocol
from norton_drivers.codecs.ranges import Ranges
from norton_drivers.drive_base import FedWatchdog
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

ARMED_S = 0.1


class RobStrideOptions(DeviceOptions):
    """What a rig file may say of a RobStride motor or a CyberGear."""

    asked: ClassVar = ("mode", "beyond_range")
    answers_commands: ClassVar = True
    command_units: ClassVar = {
        "N*m": {"mode": "torque"},
        "A": {"mode": "current"},
        "rad": {"mode": "position"},
        "rad/s": {"mode": "velocity"},
    }

    node: int = Field(ge=1, le=protocol.NODE_MAX, description="the motor's CAN id", examples=[127])
    motor: Literal["cybergear", "rs00", "rs01", "rs02", "rs03", "rs04", "rs05", "rs06"] = Field(
        description="which motor it is: what its integers span follows from that", examples=["rs02"]
    )
    mode: Literal["torque", "current", "position", "velocity"] = Field(
        "torque",
        description='what is commanded: "torque" [N*m], "current" [A]; "position" [rad] or "velocity" [rad/s], which '
        "the drive then holds",
    )
    position_range_rad: float | None = Field(
        None,
        alias="position_range",
        gt=0,
        description="positions go from minus to plus this; if it is not given, as the model's manual says",
        examples=["12.566 rad"],
    )
    velocity_range_rad_s: float | None = Field(
        None,
        alias="velocity_range",
        gt=0,
        description="velocities go from minus to plus this; if it is not given, as the model's manual says",
        examples=["44 rad/s"],
    )
    torque_range_nm: float | None = Field(
        None,
        alias="torque_range",
        gt=0,
        description="torques go from minus to plus this; if it is not given, as the model's manual says",
        examples=["17 N*m"],
    )
    beyond_range: BeyondRange = "wraps"
    torque_constant_nm_a: TorqueConstant = None
    timeout_s: FedWatchdog | None = Field(
        None,
        alias="watchdog",
        ge=0,
        le=10,
        description="silence that makes the motor let go, 100 ms if it is not given; of a CyberGear, as set in it",
        examples=["100 ms"],
    )
    host: int = Field(253, ge=0, le=protocol.HOST_MAX, description="the CAN id of this computer: no motor's")
    stiffness_nm_rad: Stiffness = None
    damping_nms_rad: Damping = 0.0
    greatest_torque_nm: GreatestTorque = inf
    loop_period_s: LoopPeriod = 50e-6
    velocity_window_s: VelocityWindow = 1e-3

    @property
    def ranges(self) -> Ranges:
        usual = protocol.MODELS[self.motor]
        return replace(
            usual,
            position_rad=self.position_range_rad or usual.position_rad,
            velocity_rad_s=self.velocity_range_rad_s or usual.velocity_rad_s,
            torque_nm=self.torque_range_nm or usual.torque_nm,
        )

    @property
    def arms_watchdog(self) -> bool:
        """Whether the timeout can be set over CAN: a CyberGear takes no such parameter."""
        return self.motor != "cybergear"

    @property
    def watchdog_s(self) -> float:
        if self.timeout_s is not None:
            return self.timeout_s
        return ARMED_S if self.arms_watchdog else 0.0

    @property
    def servo(self) -> Servo | None:
        return servo_of(self, self.ranges)

    @property
    def greatest_position_rad(self) -> float:
        return self.ranges.position_rad if self.beyond_range == "saturates" else inf

    @property
    def greatest_velocity_rad_s(self) -> float:
        return self.ranges.velocity_rad_s

    @field_validator("host")
    @classmethod
    def _is_another(cls, host: int, info: ValidationInfo) -> int:
        if host == info.data.get("node"):
            raise ValueError("is the motor's own; choose one that no device on the bus has")
        return host

    @field_validator("stiffness_nm_rad")
    @classmethod
    def _is_there_for_position(cls, stiffness_nm_rad: float | None, info: ValidationInfo) -> float | None:
        if (usual := protocol.MODELS.get(info.data.get("motor", ""))) is not None:
            check_gains(info.data.get("mode"), stiffness_nm_rad, usual)
        return stiffness_nm_rad

    @field_validator("damping_nms_rad")
    @classmethod
    def _can_be_sent(cls, damping_nms_rad: float, info: ValidationInfo) -> float:
        if (usual := protocol.MODELS.get(info.data.get("motor", ""))) is not None:
            check_damping(info.data.get("mode"), damping_nms_rad, usual)
        return damping_nms_rad
