"""Options that the families have in common: of the range, of the current, and of the drive's own loop."""

from typing import Annotated, Literal, Protocol

from pydantic import Field

from norton_drivers.codecs.ranges import Ranges
from norton_drivers.servo import SHORTEST_WINDOW_S, Servo

BeyondRange = Annotated[
    Literal["saturates", "wraps"],
    Field(description='what the position does there: "saturates", which stops the experiment, or "wraps"'),
]
TorqueConstant = Annotated[
    float | None,
    Field(
        alias="torque_constant",
        gt=0,
        description="for telling the current from the torque in a reply",
        examples=["0.1 N*m/A"],
    ),
]
Stiffness = Annotated[
    float | None,
    Field(
        alias="stiffness",
        gt=0,
        validate_default=True,
        description='kp of every command, with mode = "position"',
        examples=["2 N*m/rad"],
    ),
]
Damping = Annotated[
    float,
    Field(
        alias="damping",
        ge=0,
        validate_default=True,
        description='kd of every command, with mode = "position" or "velocity"',
        examples=["0.02 N*m*s/rad"],
    ),
]
GreatestTorque = Annotated[
    float,
    Field(
        alias="greatest_torque",
        gt=0,
        description='the drive\'s own limit (its greatest current), with mode = "position" or "velocity"',
        examples=["0.4 N*m"],
    ),
]
LoopPeriod = Annotated[
    float, Field(alias="loop_period", gt=0, le=1e-3, description="how often the drive works out its loop")
]
VelocityWindow = Annotated[
    float,
    Field(
        alias="velocity_window",
        ge=SHORTEST_WINDOW_S,
        le=5e-3,
        description="how far apart are the positions that give it ω",
    ),
]
UNITS = {
    "torque_constant": "N*m/A",
    "watchdog": "s",
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "greatest_torque": "N*m",
    "loop_period": "s",
    "velocity_window": "s",
}


class WithLoop(Protocol):
    """Options of a drive whose commands may be positions or velocities."""

    @property
    def mode(self) -> str: ...
    @property
    def stiffness_nm_rad(self) -> float | None: ...
    @property
    def damping_nms_rad(self) -> float: ...
    @property
    def greatest_torque_nm(self) -> float: ...
    @property
    def loop_period_s(self) -> float: ...
    @property
    def velocity_window_s(self) -> float: ...


def servo_of(options: WithLoop, ranges: Ranges) -> Servo | None:
    """The loop with the gains that a frame can carry; None where no position or velocity is commanded."""
    if options.mode not in ("position", "velocity"):
        return None
    return Servo(
        stiffness_nm_rad=ranges.stiffness_of(ranges.stiffness_code(options.stiffness_nm_rad or 0.0)),
        damping_nms_rad=ranges.damping_of(ranges.damping_code(options.damping_nms_rad)),
        delay_s=0.5 * options.loop_period_s,  # what is worked out is held for a period
        window_s=options.velocity_window_s,
        greatest_nm=options.greatest_torque_nm,
    )


def check_gains(mode: str | None, stiffness_nm_rad: float | None, ranges: Ranges) -> None:
    """Raises ValueError where a stiffness is needed and missing, is there in vain, or is none that can be sent."""
    if mode == "velocity" and stiffness_nm_rad is not None:
        raise ValueError('mode = "velocity" has none: its gain is damping; leave it out')
    if mode == "position" and ranges.stiffness_code(stiffness_nm_rad or 0.0) == 0:
        raise ValueError(f'mode = "position" needs it, at least {ranges.stiffness_of(1):.2g} N*m/rad')
    check_greatest(stiffness_nm_rad, ranges.stiffness_nm_rad, "N*m/rad")


def check_damping(mode: str | None, damping_nms_rad: float, ranges: Ranges) -> None:
    """Raises ValueError where it is the gain and missing, or is none that can be sent."""
    if mode == "velocity" and ranges.damping_code(damping_nms_rad) == 0:
        raise ValueError(f'mode = "velocity" needs it, at least {ranges.damping_of(1):.2g} N*m*s/rad')
    check_greatest(damping_nms_rad, ranges.damping_nms_rad, "N*m*s/rad")


def check_greatest(value: float | None, greatest: float, unit: str) -> None:
    """Raises ValueError for more than a frame can carry."""
    if value is not None and value > greatest:
        raise ValueError(f"a frame carries no more than {greatest:g} {unit}")
