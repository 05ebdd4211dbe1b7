"""What a rig file may say of an actuator in MIT mode."""

from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.mit import Ranges
from norton_drivers.servo import SHORTEST_WINDOW_S, Servo
from norton_drivers.wiring import DeviceOptions

LEAST_PROBE_STEPS = 8


class MitOptions(DeviceOptions):
    """What a rig file may say of an actuator in MIT mode."""

    asked: ClassVar = ("beyond_range", "watchdog")
    command_units: ClassVar = {"N*m": {"mode": "torque"}, "rad": {"mode": "position"}}

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
    beyond_range: Literal["saturates", "wraps"] = Field(
        "saturates", description='what the position does there: "saturates", which stops the experiment, or "wraps"'
    )
    torque_constant_nm_a: float | None = Field(
        None,
        alias="torque_constant",
        gt=0,
        description="for telling the current from the torque in a reply",
        examples=["0.1 N*m/A"],
    )
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

    mode: Literal["torque", "position"] = Field(
        "torque", description='what is commanded: "torque" [N*m], or "position" [rad], which the drive then holds'
    )
    stiffness_nm_rad: float | None = Field(
        None,
        alias="stiffness",
        gt=0,
        le=protocol.STIFFNESS_MAX_NM_RAD,
        validate_default=True,
        description='kp of every command, with mode = "position"',
        examples=["2 N*m/rad"],
    )
    damping_nms_rad: float = Field(
        0.0,
        alias="damping",
        ge=0,
        le=protocol.DAMPING_MAX_NMS_RAD,
        description='kd of every command, with mode = "position"',
        examples=["0.02 N*m*s/rad"],
    )
    greatest_torque_nm: float = Field(
        inf,
        alias="greatest_torque",
        gt=0,
        description='the drive\'s own limit (its greatest current), with mode = "position"',
        examples=["0.4 N*m"],
    )
    loop_period_s: float = Field(
        25e-6, alias="loop_period", gt=0, le=1e-3, description="how often the drive works out its position loop"
    )
    velocity_window_s: float = Field(
        475e-6,
        alias="velocity_window",
        ge=SHORTEST_WINDOW_S,
        le=5e-3,
        description="how far apart are the positions that give it ω",
    )

    @property
    def servo(self) -> Servo | None:
        if self.mode == "torque" or self.stiffness_nm_rad is None:
            return None
        return Servo(
            stiffness_nm_rad=protocol.stiffness_of(protocol.stiffness_code(self.stiffness_nm_rad)),
            damping_nms_rad=protocol.damping_of(protocol.damping_code(self.damping_nms_rad)),
            delay_s=0.5 * self.loop_period_s,  # what is worked out is held for a period
            window_s=self.velocity_window_s,
            greatest_nm=self.greatest_torque_nm,
        )

    @field_validator("stiffness_nm_rad")
    @classmethod
    def _is_there_for_position(cls, stiffness_nm_rad: float | None, info: ValidationInfo) -> float | None:
        if info.data.get("mode") == "position" and protocol.stiffness_code(stiffness_nm_rad or 0.0) == 0:
            raise ValueError(f'mode = "position" needs it, at least {protocol.stiffness_of(1):.2g} N*m/rad')
        return stiffness_nm_rad

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
