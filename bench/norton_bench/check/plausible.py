"""Whether what devices say fits together: each encoder with itself, one with the other, the sensor with the drives."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from norton_bench.records import Measured, Table

# A drive's velocity filter, and the end of a record that is not quite at rest, account for less than this.
VELOCITY_TOLERANCE = 0.2
# So does the twist of a soft torque sensor between two encoders.
RATIO_TOLERANCE = 0.15
# Motors give what they are told to within some tenths, and friction is not the same twice; what is sought are factors.
TORQUE_TOLERANCE = 0.4
_DRIVE_MEND = "torque constant, gear ratio, rated torque or range table"
_SENSOR_MEND = "scale, range and axis"
# Of the velocity at which a push ends: from here on the whole friction is overcome.
SLIDING = 0.3
_TRAVEL_MIN_RAD = 0.02
_STEPS_MIN = 20  # of an encoder's resolution


@dataclass(frozen=True)
class Turned:
    """One drive's encoder over a stretch of motion that begins and ends nearly at rest."""

    role: str
    travel_rad: float
    from_velocity_rad: float  # the integral of the velocity readings
    readable: bool  # whether it turned far enough for the encoder to tell

    @property
    def velocity_scale(self) -> float:
        return self.from_velocity_rad / self.travel_rad


def turned_by(role: str, motion: Table, resolution_rad: float) -> Turned:
    """From the readings of one drive; ``motion`` is a table of :data:`norton_bench.records.MOTION`."""
    position, seconds = motion["position_rad"], motion["arrival_ns"] * 1e-9
    travel = float(position[-1] - position[0]) if len(position) else 0.0
    integral = float(np.trapezoid(motion["velocity_rad_s"], seconds))
    return Turned(role, travel, integral, abs(travel) > max(_TRAVEL_MIN_RAD, _STEPS_MIN * resolution_rad))


def velocity_faults(turned: Turned) -> Iterator[str]:
    """Position and velocity come from one encoder, and must tell of one motion."""
    if turned.readable and not _near(turned.velocity_scale, VELOCITY_TOLERANCE):
        yield (
            f"[{turned.role}] its velocity readings say {turned.velocity_scale:.2f} times what its positions do: "
            "check the scale of both in the drive and the rig file (range table, pole pairs, gear ratio, counts)"
        )


def ratio_faults(actuator: Turned, load: Turned) -> Iterator[str]:
    """One shaft: both encoders must turn equally far."""
    if not (actuator.readable and load.readable):
        return
    ratio = actuator.travel_rad / load.travel_rad
    if not _near(ratio, RATIO_TOLERANCE):
        yield (
            f"[actuator] turned {ratio:.2f} times as far as [load], though they are on one shaft: the position scale "
            "of one of them is wrong (encoder counts, gear ratio, pole pairs, range table), or the coupling slips"
        )


@dataclass(frozen=True)
class Push:
    """What a drive was told while it turned the shaft, and what the sensor felt of it, in magnitudes."""

    told: float  # in the drive's own unit
    felt_nm: float


def push_of(measured: Measured, told: str, at_rest_nm: float, moving_rad_s: float) -> Push:
    """``told`` is the column of the command, ``at_rest_nm`` what the sensor showed before; the sliding part counts."""
    ticks = measured.ticks
    sliding = ticks[np.abs(ticks["velocity_rad_s"]) > SLIDING * moving_rad_s]
    return Push(float(np.mean(np.abs(sliding[told]))), abs(float(np.mean(sliding["torque_nm"])) - at_rest_nm))


@dataclass(frozen=True)
class TorqueScales:
    """What each drive gives of what it is told, by the torque sensor; nan where that cannot be told.

    Whoever turns the shaft overcomes the friction of both sides. Of that the sensor feels the actuator's while the load
    pushes, and the load's while the actuator pushes: together, what either push must have amounted to.
    """

    actuator: float
    load: float


def torque_scales(load: Push, actuator: Push, *, in_newton_metres: bool) -> TorqueScales:
    """``in_newton_metres`` says whether the actuator is told a torque."""
    overcome_nm = load.felt_nm + actuator.felt_nm
    return TorqueScales(overcome_nm / actuator.told if in_newton_metres else float("nan"), overcome_nm / load.told)


def torque_faults(scales: TorqueScales) -> Iterator[str]:
    """Three that must agree on one torque: of a pair that does, neither is wrong."""
    actuator, load = scales.actuator, scales.load
    actuator_right, load_right = _near(actuator, TORQUE_TOLERANCE), _near(load, TORQUE_TOLERANCE)
    if load_right and (actuator_right or np.isnan(actuator)):
        return
    if np.isnan(actuator):
        yield (
            f"[load] gives {load:.2f} times the torque that it is told, by the torque sensor: the scale of one of them "
            f"is wrong (drive: {_DRIVE_MEND}; sensor: {_SENSOR_MEND})"
        )
    elif _near(actuator / load, TORQUE_TOLERANCE):
        shown = (actuator * load) ** 0.5
        yield (
            f"[torque_sensor] shows {shown:.2f} times the torque that [actuator] and [load] agree on: check its "
            f"{_SENSOR_MEND}"
        )
    elif actuator_right or load_right:
        wrong, scale, right = ("actuator", actuator, "load") if load_right else ("load", load, "actuator")
        yield (
            f"[{wrong}] gives {scale:.2f} times the torque that it is told, by [{right}] and [torque_sensor]: check "
            f"its {_DRIVE_MEND}"
        )
    else:
        yield (
            f"[torque_sensor] shows {actuator:.2f} times what [actuator] is told to give and {load:.2f} times what "
            f"[load] is: check the scales of all three (drives: {_DRIVE_MEND}; sensor: {_SENSOR_MEND})"
        )


def _near(ratio: float, tolerance: float) -> bool:
    """Whether ``ratio`` is 1 within ``tolerance``, the same either way."""
    return 1 / (1 + tolerance) <= ratio <= 1 + tolerance
