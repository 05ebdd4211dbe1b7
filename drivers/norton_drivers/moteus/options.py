"""What a rig file may say of a moteus controller."""

from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import moteus as protocol
from norton_drivers.codecs import multiplex
from norton_drivers.drive_base import FedWatchdog
from norton_drivers.servo import SHORTEST_WINDOW_S, Servo
from norton_drivers.wiring import DeviceOptions


class MoteusOptions(DeviceOptions):
    """What a rig file may say of a moteus controller."""

    answers_commands: ClassVar = True
    command_units: ClassVar = {
        "N*m": {"mode": "torque"},
        "rad": {"mode": "position"},
        "rad/s": {"mode": "velocity"},
    }

    node: int = Field(ge=1, le=multiplex.NODE_MAX, description="id.id as set in the controller", examples=[1])
    host_node: int = Field(0, ge=0, le=multiplex.NODE_MAX, description="the id of this computer, which no device has")
    prefix: int = Field(0, ge=0, le=multiplex.PREFIX_MAX, description="can.prefix as set in the controller")
    watchdog_s: FedWatchdog = Field(
        0.1,
        alias="watchdog",
        ge=0,
        le=protocol.TIMEOUT_MAX_S,
        description='silence after which the controller gives up; "0 s" leaves its own, servo.default_timeout_s',
        examples=["100 ms"],
    )
    counts_per_turn: int = Field(0, ge=0, description="encoder counts per turn; 0 where unknown", examples=[16384])
    mode: Literal["torque", "position", "velocity"] = Field(
        "torque",
        description='what is commanded: "torque" [N*m], "position" [rad] or "velocity" [rad/s], which the controller '
        "then holds",
    )
    stiffness_nm_rad: float | None = Field(
        None,
        alias="stiffness",
        gt=0,
        validate_default=True,
        description='servo.pid_position.kp as set in the controller, with mode = "position"',
        examples=["4 N*m/turn"],
    )
    damping_nms_rad: float = Field(
        0.0,
        alias="damping",
        ge=0,
        validate_default=True,
        description='servo.pid_position.kd as set in the controller, with mode = "position" or "velocity"',
        examples=["0.05 N*m*s/turn"],
    )
    greatest_torque_nm: float = Field(
        inf,
        alias="greatest_torque",
        gt=0,
        description='what servo.max_current_A comes to, with mode = "position" or "velocity"',
        examples=["0.4 N*m"],
    )
    loop_period_s: float = Field(
        1 / 30_000, alias="loop_period", gt=0, le=1e-3, description="how often it works out its loop"
    )
    velocity_window_s: float = Field(
        SHORTEST_WINDOW_S,
        alias="velocity_window",
        ge=SHORTEST_WINDOW_S,
        le=5e-3,
        description="twice the delay of the velocity in its loop",
    )

    @property
    def servo(self) -> Servo | None:
        if self.mode == "torque":
            return None
        return Servo(
            stiffness_nm_rad=self.stiffness_nm_rad or 0.0,
            damping_nms_rad=self.damping_nms_rad,
            delay_s=0.5 * self.loop_period_s,  # what is worked out is held for a period
            window_s=self.velocity_window_s,
            greatest_nm=self.greatest_torque_nm,
        )

    @field_validator("stiffness_nm_rad")
    @classmethod
    def _is_there_for_position(cls, stiffness_nm_rad: float | None, info: ValidationInfo) -> float | None:
        if info.data.get("mode") == "position" and stiffness_nm_rad is None:
            raise ValueError('mode = "position" needs it')
        if info.data.get("mode") == "velocity" and stiffness_nm_rad is not None:
            raise ValueError('mode = "velocity" has none: its gain is damping; leave it out')
        return stiffness_nm_rad

    @field_validator("damping_nms_rad")
    @classmethod
    def _is_there_for_velocity(cls, damping_nms_rad: float, info: ValidationInfo) -> float:
        if info.data.get("mode") == "velocity" and not damping_nms_rad:
            raise ValueError('mode = "velocity" needs it')
        return damping_nms_rad
