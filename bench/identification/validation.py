"""How well a network predicts what no fit has seen: the torque under a measured motion, and the free motion itself."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bench.errors import ExperimentError
from bench.identification.fit import trace
from bench.identification.kernels import FULL_BAND
from bench.identification.regression import INERTIA, Regression, Shape
from bench.identification.results import FitResult, Trace, Validation
from bench.identification.separable import linear_solution
from bench.identification.signals import Signals, signals
from bench.records import Measured, SegmentInfo
from bench.segments import Use

FloatArray = npt.NDArray[np.float64]

NAN = float("nan")
# What happened this long before a free segment, friction and amplifier may still remember.
MEMORY_S = 0.3
FREE_PROCEDURES = ("free", "validate")


def validate(result: FitResult, measured: Measured, *, tick_s: float, use: Use = Use.VALIDATE) -> Validation:
    """Predict every segment meant for ``use`` with the fit's network and delays. NaN for what was not measured.

    Raises ExperimentError where there is nothing to validate on.
    """
    return validate_signals(result, signals(measured, tick_s, use), measured.segments)


def validate_signals(
    result: FitResult, stretches: tuple[Signals, ...], segments: Sequence[SegmentInfo], *, use: Use = Use.VALIDATE
) -> Validation:
    """The same, from signals that stand on one grid already."""
    torque, torque_rms, torque_relative = _torque(result, stretches)
    free = [segment for segment in segments if segment.use is use and is_free(segment)]
    velocity, velocity_rms, velocity_relative = _free_motion(result, stretches, free)
    if np.isnan(torque_rms) and np.isnan(velocity_rms):
        raise ExperimentError("nothing to validate on: neither torque under motion nor free motion was recorded")
    return Validation(torque_rms, torque_relative, velocity_rms, velocity_relative, torque, velocity)


def is_free(segment: SegmentInfo) -> bool:
    """Whether a segment's port torque was held at zero, or its shaft free."""
    return segment.procedure in FREE_PROCEDURES and (segment.name.startswith("free") or segment.procedure == "free")


def network_trace(result: FitResult, stretches: tuple[Signals, ...], *, free_motion: bool = False) -> Trace:
    """Torque under the measured motion by the network alone: whatever else a fit found (cogging, say) stays in between.

    The sensor's slow zero and the friction's state after a rest are not predicted. ``free_motion`` compares what the
    network makes of the acceleration instead, as a torque per unit of torque gain: for networks that know only ratios.
    """
    network = result.network
    regression = Regression.of(stretches, FULL_BAND, free_motion=free_motion)
    s = network.presliding_stiffness_nm_rad / network.coulomb_torque_nm
    command_delay_s = result.command_delay_s + (result.motion_delay_s if free_motion else 0.0)
    columns, memory = regression.columns(
        Shape(network.amplifier_bandwidth_rad_s, s, command_delay_s, result.motion_delay_s)
    )
    known = np.array(
        [
            network.torque_gain,
            network.inertia_kgm2,
            network.viscous_damping_nms_rad,
            network.coulomb_torque_nm,
            network.presliding_damping_nms_rad,
        ]
    )
    unknown, to_torque = columns[5:], 1.0
    if free_motion:
        # Solved for the acceleration: all over the inertia, and what torque there is at the port counts for itself.
        to_torque = network.inertia_kgm2
        known = known / to_torque
        known[INERTIA] = 0.0
        unknown = np.concatenate([columns[[INERTIA]], unknown])
    target = regression.target()
    rest, seen = memory.taken_off(target - known @ columns[:5]), memory.taken_off(unknown)
    predicted = target - rest + linear_solution(seen, rest) @ seen
    return trace(stretches, target * to_torque, predicted * to_torque)


def _torque(result: FitResult, stretches: tuple[Signals, ...]) -> tuple[Trace, float, float]:
    if any(stretch.torque_nm is None for stretch in stretches):
        return _nothing("N*m"), NAN, NAN
    told = network_trace(result, stretches)
    rms = float(np.sqrt(np.nanmean((told.measured - told.predicted) ** 2)))
    return told, rms, rms / float(np.sqrt(np.nanmean(told.measured**2)))


def _free_motion(
    result: FitResult, stretches: tuple[Signals, ...], segments: list[SegmentInfo]
) -> tuple[Trace, float, float]:
    """Free velocity predicted from the command alone, started from rest before each segment."""
    pieces = [
        piece
        for segment in segments
        for stretch in stretches
        if (piece := _one_free_motion(result, stretch, segment)) is not None
    ]
    if not pieces:
        return _nothing("rad/s"), NAN, NAN
    time_s, measured, predicted = (np.concatenate([piece[row] for piece in pieces]) for row in range(3))
    rms = float(np.sqrt(np.mean((measured - predicted) ** 2)))
    relative = rms / float(np.sqrt(np.mean(measured**2)))
    return Trace(time_s, measured, predicted, "rad/s"), rms, relative


def _one_free_motion(result: FitResult, stretch: Signals, segment: SegmentInfo) -> FloatArray | None:
    inside = np.flatnonzero((stretch.segment == segment.index) & stretch.usable)
    if inside.size < 2:
        return None
    tick_s, network = stretch.tick_s, result.network
    first = max(0, inside[0] - round(MEMORY_S / tick_s))
    time_s = stretch.time_s[first : inside[-1] + 1]
    # The command that acts at an instant of the motion was sent this much earlier, to the nearest tick; the rest of
    # the delay is made up for by comparing at shifted instants.
    sent_s = time_s - result.command_delay_s
    index = np.clip(np.searchsorted(stretch.sent_s, sent_s, side="right") - 1, 0, stretch.command.size - 1)
    shift_s = float(np.median(sent_s - stretch.sent_s[index]))
    measured = Regression.of((stretch,), FULL_BAND).rows[0].kinematics(Shape(1.0, 1.0, 0.0, result.motion_delay_s))[0]
    start = float(measured[first])
    predicted = network.free_motion(
        stretch.command[index],
        tick_s,
        velocity_rad_s=start,
        motor_torque_nm=network.torque_gain * stretch.command[index[0]],
        friction_torque_nm=network.coulomb_torque_nm * float(np.sign(start)),
    )[1]
    at = inside - first
    later = np.interp(time_s[at], time_s - shift_s, predicted)
    return np.stack([time_s[at], measured[inside], later])


def _nothing(unit: str) -> Trace:
    return Trace(np.empty(0), np.empty(0), np.empty(0), unit)
