"""What a rig file may say of a Damiao motor."""

from math import inf
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import damiao as protocol
from norton_drivers.codecs.mit import IDENTIFIER_MAX
from norton_drivers.codecs.ranges import Ranges
from norton_drivers.drive_base import FedWatchdog
from norton_drivers.servo import Servo
from norton_drivers.spoken_to.options import (
    BeyondRange,
    Damping,
    GreatestTorque,
    Stiffness,
    TorqueConstant,
    check_damping,
    check_gains,
    servo_of,
)
from norton_drivers.wiring import DeviceOptions

VELOCITY_PERIOD_S = 1e-3  # its velocity is worked out, and its readings are filtered, once a millisecond
UNFILTERED_HZ = 500.0  # from there on the filter is off: position_sensor.c
_ANY = Ranges(1.0, 1.0, 1.0)  # the codes of gains do not depend on what a motor's other codes span


class DamiaoOptions(DeviceOptions):
    """What a rig file may say of a Damiao motor. Ranges that it does not give are as read from the motor."""

    asked: ClassVar = ("master", "beyond_range")
    answers_commands: ClassVar = True
    command_units: ClassVar = {
        "N*m": {"mode": "torque"},
        "rad": {"mode": "position"},
        "rad/s": {"mode": "velocity"},
    }

    node: int = Field(ge=1, le=protocol.NODE_MAX, description="the motor's CAN ID (ESC_ID); not above 15", examples=[1])
    master: int = Field(
        0, ge=0, le=IDENTIFIER_MAX - 1, description="the CAN id that its answers come with (MST_ID)", examples=[17]
    )
    mode: Literal["torque", "position", "velocity"] = Field(
        "torque",
        description='what is commanded: "torque" [N*m]; "position" [rad] or "velocity" [rad/s], which the drive holds',
    )
    position_range_rad: float | None = Field(
        None,
        alias="position_range",
        gt=0,
        description="positions go from minus to plus this (PMAX); if it is not given, as read from the motor",
        examples=["12.5 rad"],
    )
    velocity_range_rad_s: float | None = Field(
        None,
        alias="velocity_range",
        gt=0,
        description="velocities go from minus to plus this (VMAX); if it is not given, as read from the motor",
        examples=["30 rad/s"],
    )
    torque_range_nm: float | None = Field(
        None,
        alias="torque_range",
        gt=0,
        description="torques go from minus to plus this (TMAX); if it is not given, as read from the motor",
        examples=["10 N*m"],
    )
    beyond_range: BeyondRange = "wraps"
    velocity_bandwidth_hz: float = Field(
        40.0,
        alias="velocity_bandwidth",
        gt=0,
        description="the filter of its readings of velocity and torque as set in it (V_BW); 500 Hz: none",
        examples=["40 Hz"],
    )
    torque_constant_nm_a: TorqueConstant = None
    watchdog_s: FedWatchdog = Field(
        0.1, alias="watchdog", ge=0, le=10, description="silence that makes the motor let go; 0 leaves its TIMEOUT"
    )
    stiffness_nm_rad: Stiffness = None
    damping_nms_rad: Damping = 0.0
    greatest_torque_nm: GreatestTorque = inf

    @property
    def ranges(self) -> Ranges | None:
        """None where the rig leaves one to the motor."""
        position, velocity, torque = self.position_range_rad, self.velocity_range_rad_s, self.torque_range_nm
        if position is None or velocity is None or torque is None:
            return None
        return Ranges(position, velocity, torque)

    @property
    def loop_period_s(self) -> float:
        return 50e-6  # app/src/motor_control.c: 20 kHz

    @property
    def velocity_window_s(self) -> float:
        """Of two positions whose difference lags as much, on average, as the velocity in its loop without a filter: by
        half of the period over which it is worked out, and by the time for which it is held, from none to all but a
        cycle.
        """
        held_s = (VELOCITY_PERIOD_S - self.loop_period_s) / 2
        return 2 * (VELOCITY_PERIOD_S / 2 + held_s)

    @property
    def servo(self) -> Servo | None:
        return servo_of(self, _ANY)

    @property
    def greatest_position_rad(self) -> float:
        if self.position_range_rad is None or self.beyond_range == "wraps":
            return inf
        return self.position_range_rad

    @property
    def greatest_velocity_rad_s(self) -> float:
        return inf if self.velocity_range_rad_s is None else self.velocity_range_rad_s

    @field_validator("master")
    @classmethod
    def _is_another(cls, master: int, info: ValidationInfo) -> int:
        if master == info.data.get("node"):
            raise ValueError("is the motor's own id; set another MST_ID in it")
        return master

    @field_validator("stiffness_nm_rad")
    @classmethod
    def _is_there_for_position(cls, stiffness_nm_rad: float | None, info: ValidationInfo) -> float | None:
        check_gains(info.data.get("mode"), stiffness_nm_rad, _ANY)
        return stiffness_nm_rad

    @field_validator("damping_nms_rad")
    @classmethod
    def _can_be_sent(cls, damping_nms_rad: float, info: ValidationInfo) -> float:
        check_damping(info.data.get("mode"), damping_nms_rad, _ANY)
        if damping_nms_rad and info.data.get("velocity_bandwidth_hz", UNFILTERED_HZ) < UNFILTERED_HZ:
            raise ValueError(
                'needs velocity_bandwidth = "500 Hz", and V_BW = 500 in the motor: else the velocity in its loop is '
                "filtered, and what is identified is wrong"
            )
        return damping_nms_rad
