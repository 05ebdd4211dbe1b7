"""How well a network predicts what no fit has seen: the torque under a measured motion, and the free motion itself."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.expansion import Linearised
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.results import FitResult, SensorZero, Trace, Validation, trace
from norton_bench.identification.rows import Rows
from norton_bench.identification.separable import LOW_BAND, linear_solution
from norton_bench.identification.shape import INERTIA, Shape
from norton_bench.identification.signals import Signals, signals
from norton_bench.models.network import NortonNetwork
from norton_bench.records import Measured, SegmentInfo
from norton_bench.segments import Use

NAN = float("nan")
# What happened this long before a free segment, friction and amplifier may still remember.
MEMORY_S = 0.3
# The noise that the torque's reading puts into a free motion's prediction is that of so many drawn beside it.
NOISE_DRAWS = 4
FREE_PROCEDURES = ("free", "validate")


def validate(result: FitResult, measured: Measured, *, tick_s: float, use: Use = Use.VALIDATE) -> Validation:
    """Predict every segment meant for ``use`` with the fit's network and delays. NaN for what was not measured.

    Raises ExperimentError where there is nothing to validate on.
    """
    return validate_signals(result, signals(measured, tick_s, use), measured.segments)


def validate_signals(
    result: FitResult,
    stretches: tuple[Signals, ...],
    segments: Sequence[SegmentInfo],
    *,
    zero: SensorZero | None = None,
    use: Use = Use.VALIDATE,
) -> Validation:
    """The same, from signals that stand on one grid already. ``zero`` is the fit's; else that of its mean."""
    known = zero if zero is not None else SensorZero.constant(result.torque_bias_nm)
    torque, torque_rms, torque_relative = _torque(result, stretches, known)
    runs = free_runs(result, stretches, [segment for segment in segments if segment.use is use], known)
    velocity, velocity_rms, velocity_relative = _free_motion(runs)
    if np.isnan(torque_rms) and np.isnan(velocity_rms):
        raise ExperimentError("nothing to validate on: neither torque under motion nor free motion was recorded")
    noise = float(np.sqrt(np.mean([run.noise_rad2_s2 for run in runs]))) if runs else NAN
    return Validation(torque_rms, torque_relative, velocity_rms, velocity_relative, torque, velocity, noise)


def is_free(segment: SegmentInfo) -> bool:
    """Whether a segment's port torque was held at zero, or its shaft free."""
    return segment.procedure in FREE_PROCEDURES and (segment.name.startswith("free") or segment.procedure == "free")


def network_trace(
    result: FitResult, stretches: tuple[Signals, ...], *, zero: SensorZero | None = None, free_motion: bool = False
) -> Trace:
    """Torque under the measured motion by the network's parameters alone: cogging stays in between, to be looked at.

    The friction's state after a rest is not predicted, nor is the sensor's slow zero, unless it is given: then it is
    taken off the torque, nothing is fitted here but that state, the network's cogging is in the prediction, and all is
    seen in the band of the fit. ``free_motion``
    compares what the network makes of the acceleration instead, as a torque per unit of torque gain: for networks that
    know only ratios.
    """
    network = result.network
    at = Linearised.at(result)
    if zero is None:
        at = replace(at, cogging=(), band=FULL_BAND)
    regression = replace(at.regression(stretches), free_motion=free_motion)
    command_delay_s = result.command_delay_s + (result.motion_delay_s if free_motion else 0.0)
    columns, memory = regression.columns(replace(at.shape, command_delay_s=command_delay_s))
    known, first = np.concatenate([at.linear, at.waves]), 5 + len(at.waves)
    unknown, to_torque = columns[first:], 1.0
    if free_motion:
        # Solved for the acceleration: all over the inertia, and what torque there is at the port counts for itself.
        to_torque = network.inertia_kgm2
        known = known / to_torque
        known[INERTIA] = 0.0
        unknown = np.concatenate([columns[[INERTIA]], unknown])
    target = regression.target()
    if zero is not None:
        target = target - zero.at(regression.time_s())
        unknown = unknown[:0]
    rest, seen = memory.taken_off(target - known @ columns[:first]), memory.taken_off(unknown)
    predicted = target - rest + (linear_solution(seen, rest) @ seen if len(seen) else 0.0)
    return trace(stretches, target * to_torque, predicted * to_torque)


def _torque(result: FitResult, stretches: tuple[Signals, ...], zero: SensorZero) -> tuple[Trace, float, float]:
    if any(stretch.torque_nm is None for stretch in stretches):
        return _nothing("N*m"), NAN, NAN
    told = network_trace(result, stretches, zero=zero)
    rms = float(np.sqrt(np.nanmean((told.measured - told.predicted) ** 2)))
    return told, rms, rms / float(np.sqrt(np.nanmean(told.measured**2)))


@dataclass(frozen=True)
class FreeMotion:
    """One segment of free motion and MEMORY_S before it, to be predicted: arrays of shape (ticks,).

    ``port_nm`` is the torque measured at the port, ``deviation_nm`` that of its noise, a tick; ``band`` (taps,) is the
    low-pass that both velocities pass. Compared are the samples at ``compared_s`` (n,), by time that begins with
    ``time_s``, at which the motion follows what was sent.
    """

    tick_s: float
    time_s: FloatArray
    compared_s: FloatArray
    command: FloatArray
    port_nm: FloatArray
    deviation_nm: float
    position_rad: float  # as it begins
    velocity_rad_s: float
    band: FloatArray

    def predicted(self, network: NortonNetwork, port_error_nm: FloatArray | float = 0.0) -> FloatArray:
        """The velocity (n,) [rad/s] by a network, were the torque at the port another by ``port_error_nm`` (ticks,)."""
        velocity = network.free_motion(
            self.command,
            self.tick_s,
            port_torque_nm=self.port_nm + port_error_nm,
            position_rad=self.position_rad,
            velocity_rad_s=self.velocity_rad_s,
            motor_torque_nm=network.torque_gain * self.command[0],
            friction_torque_nm=network.coulomb_torque_nm * float(np.sign(self.velocity_rad_s)),
        )[1]
        return np.asarray(np.interp(self.compared_s, self.time_s, np.convolve(velocity, self.band, "same")))


@dataclass(frozen=True)
class FreeRun:
    """One segment of free motion: time, velocity as measured and as predicted by ``network``, all (n,)."""

    segment: int
    motion: FreeMotion
    network: NortonNetwork
    measured: FloatArray
    position_noise_rad2_s2: float

    @property
    def time_s(self) -> FloatArray:
        return self.motion.compared_s

    @cached_property
    def predicted(self) -> FloatArray:
        return self.motion.predicted(self.network)

    @cached_property
    def noise_rad2_s2(self) -> float:
        """The mean square that the noise of both readings, torque and position, leaves between both velocities."""
        motion, random = self.motion, np.random.default_rng(0)
        if motion.deviation_nm == 0.0:
            return self.position_noise_rad2_s2
        draws_nm = random.normal(0.0, motion.deviation_nm, (NOISE_DRAWS, motion.time_s.size))
        others = np.stack([motion.predicted(self.network, draw_nm) for draw_nm in draws_nm])
        return float(np.mean((others - self.predicted) ** 2)) + self.position_noise_rad2_s2


def free_runs(
    result: FitResult, stretches: Sequence[Signals], segments: Sequence[SegmentInfo], zero: SensorZero
) -> tuple[FreeRun, ...]:
    """The free motion of every free segment, predicted from the command and the torque that was measured at the port.

    Zero torque is never quite zero, and what is left of it moves the shaft. Both velocities have passed the same
    low-pass, so that the encoder's counts are no error of the prediction.
    """
    return tuple(
        run
        for segment in segments
        if is_free(segment)
        for stretch in stretches
        if (run := _free_run(result, stretch, segment, zero)) is not None
    )


def _free_motion(runs: Sequence[FreeRun]) -> tuple[Trace, float, float]:
    if not runs:
        return _nothing("rad/s"), NAN, NAN
    time_s, measured, predicted = (
        np.concatenate([getattr(run, name) for run in runs]) for name in ("time_s", "measured", "predicted")
    )
    rms = float(np.sqrt(np.mean((measured - predicted) ** 2)))
    return Trace(time_s, measured, predicted, "rad/s"), rms, rms / float(np.sqrt(np.mean(measured**2)))


def _free_run(result: FitResult, stretch: Signals, segment: SegmentInfo, zero: SensorZero) -> FreeRun | None:
    reach = int(np.ceil(LOW_BAND.half_width))
    inside = np.flatnonzero((stretch.segment == segment.index) & stretch.usable)[:-reach]
    if inside.size < 2:
        return None
    tick_s = stretch.tick_s
    first = max(0, inside[0] - round(MEMORY_S / tick_s))
    time_s = stretch.time_s[first : inside[-1] + 1 + reach]
    # The command that acts at an instant of the motion was sent this much earlier, to the nearest tick; the rest of
    # the delay is made up for by comparing at shifted instants.
    sent_s = time_s - result.command_delay_s
    index = np.clip(np.searchsorted(stretch.sent_s, sent_s, side="right") - 1, 0, stretch.command.size - 1)
    shift_s = float(np.median(sent_s - stretch.sent_s[index]))
    rows = Rows(stretch, LOW_BAND)
    shape = Shape(1.0, 1.0, 0.0, result.motion_delay_s)
    measured, place = rows.kinematics(shape)[0], rows.position(shape)[0]
    motion = FreeMotion(
        tick_s=tick_s,
        time_s=time_s - shift_s,
        compared_s=time_s[inside - first],
        command=stretch.command[index],
        port_nm=_port_torque(result, stretch, time_s - shift_s + 0.5 * tick_s, zero),
        deviation_nm=_torque_deviation(result, stretch),
        position_rad=float(place[first]),
        velocity_rad_s=float(measured[first]),
        band=LOW_BAND.taps(np.arange(-reach, reach + 1, dtype=np.float64), 0),
    )
    return FreeRun(segment.index, motion, result.network, measured[inside], float(rows.noise()[2]))


def _torque_deviation(result: FitResult, stretch: Signals) -> float:
    """Of white noise, a sample a tick; none where the torque is not looked at."""
    if stretch.torque_nm is None or result.ratios_only:
        return 0.0
    return float(np.sqrt(stretch.torque_noise / stretch.tick_s))


def _port_torque(result: FitResult, stretch: Signals, time_s: FloatArray, zero: SensorZero) -> FloatArray:
    """As measured, at instants (n,); none where it was not, or where the network has no scale of torque."""
    if stretch.torque_nm is None or result.ratios_only:
        return np.zeros(time_s.size)
    return np.asarray(np.interp(time_s, stretch.time_s, stretch.torque_nm) - zero.at(time_s))


def _nothing(unit: str) -> Trace:
    return Trace(np.empty(0), np.empty(0), np.empty(0), unit)
