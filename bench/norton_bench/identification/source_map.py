"""The two static experiments, as measured: the motion source (free) and the Thévenin source (blocked), section IV.D."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.distributions import f_tail
from norton_bench.errors import ExperimentError
from norton_bench.identification.branches import (
    PIECES,
    RESAMPLES,
    SKIPPED_SHARE,
    pieces_of,
    resting,
    settled,
)
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.readings import noise_deviation
from norton_bench.identification.results import BlockedMap, FitResult, SensorZero, SourceMap
from norton_bench.models.parameters import Status
from norton_bench.models.sliding import steepness_nms_rad
from norton_bench.records import Measured, SegmentInfo, Table

# A slope is one to divide by where it is so many of its deviations above zero: the quotient's error is then a fifth of
# its size at most, and nearly linear.
KNOWN_DEVIATIONS = 5.0


@dataclass(frozen=True)
class PortTorque:
    """What the torque that was left at the port does to a free velocity: how much, and how well that is known.

    A motion source is defined where the port's torque is zero. What torque there was is read by the sensor; its
    zero drifts, and is taken from the fit of the whole recording. Near a level, torque falls with velocity by the
    slope that the imposed grid has measured there, on the same side of rest; where there was no grid, by the fitted
    damping.

    The sensor's zero and the slopes. ``origin_ns`` is where the zero's time begins.
    """

    origin_ns: int
    zero: SensorZero
    table: ImpedanceTable | None
    damping_nms_rad: float
    damping_std_nms_rad: float

    @classmethod
    def of(cls, fit: FitResult, table: ImpedanceTable | None, origin_ns: int) -> "PortTorque | None":
        """None where the fit tells nothing of the sensor's zero."""
        damping, gain = fit.estimate("viscous_damping"), fit.estimate("torque_gain")
        if fit.torque_zero is None or not fit.converged or damping.status is not Status.VALID:
            return None
        # The loop of a servo takes its gain off a velocity commanded. How the two go together is left out: their sum is
        # then known no less well than this.
        std = damping.std if fit.network.servo is None else damping.std + gain.std
        return cls(origin_ns, fit.torque_zero, table, steepness_nms_rad(fit.network), std)

    def slope(self, command: float, velocity_rad_s: float) -> tuple[float, float]:
        """Fall of torque with velocity near this level [N m s/rad] and its deviation; NaN where it cannot be told."""
        result = (self.damping_nms_rad, self.damping_std_nms_rad)
        if self.table is not None:
            measured = self.table.fall(command, velocity_rad_s)
            result = measured if np.isfinite(measured).all() else result
        value, deviation = result
        return result if value > KNOWN_DEVIATIONS * deviation else (float("nan"), float("nan"))


# The last part of a hold counts: before it the shaft still settles.
SETTLED_SHARE = 0.5
SHORTEST_DWELL_TICKS = 20
LEAST_READINGS = 3 * PIECES
# How the names of held segments tell the history by which standstill was reached: "hold from above, fast", ...
FAST, FROM_REST = ", fast", "hold from rest"
# Holds are averaged in this many blocks; the scatter of the blocks is that of correlated noise.
BLOCKS = 5
SEED = 10


def source_map(measured: Measured, port: PortTorque | None = None) -> SourceMap:
    """Steady free velocity against command, from the staircases, without what torque at the ``port`` took from it.

    Velocities are as measured where the port's torque is not known. Raises ExperimentError where there is no staircase.
    """
    levels = list(_levels(measured))
    if not levels:
        raise ExperimentError("no staircase was recorded: run the step 'free' to measure the static source map")
    command, rising = np.array([level.command for level in levels]), np.array([level.rising for level in levels])
    velocity, span_s = np.stack([level.velocity for level in levels]), np.array([level.span_s for level in levels])
    result = settled(velocity, span_s)
    std = np.std(result.resampled, axis=0)
    source = SourceMap(command, result.velocity, std, rising, result.resampled, result.settling_s)
    torque = np.stack([level.torque_nm for level in levels])
    if port is None or not np.isfinite(torque).all():
        return source
    time_s = np.array([level.middle_ns - port.origin_ns for level in levels]) * 1e-9
    noise_nm = np.array([level.torque_noise_nm for level in levels])
    return _without_torque(source, velocity, span_s, torque, noise_nm, time_s, port)


def _without_torque(
    source: SourceMap,
    velocity: FloatArray,
    span_s: FloatArray,
    torque: FloatArray,
    noise_nm: FloatArray,
    time_s: FloatArray,
    port: PortTorque,
) -> SourceMap:
    """``source`` with each moving level taken to where the port has no torque; a shaft at rest is held by its friction.

    ``velocity`` and ``torque`` [N m] are in pieces (levels, PIECES), as read; ``noise_nm`` (levels,) is what the noise
    of readings leaves unknown of a level's mean, and ``time_s`` (levels,) each level's instant.
    """
    port_nm = torque - port.zero.at(time_s)[:, None]
    slopes = np.array([port.slope(*level) for level in zip(source.command, source.velocity_rad_s, strict=True)])
    moves = ~resting(source.velocity_rad_s, source.velocity_std_rad_s) & np.isfinite(slopes).all(axis=1)
    per_nm = np.where(moves, 1.0 / slopes[:, 0], 0.0)
    result = settled(velocity, span_s, port_nm * per_nm[:, None])
    mean_nm, scatter_nm = port_nm.mean(axis=1), port_nm.std(axis=1, ddof=1) / np.sqrt(PIECES)
    # What is the same in all levels: the zero, and the slope.
    random, weights = np.random.default_rng(SEED), port.zero.weights(time_s)
    zeros_nm = random.multivariate_normal(np.zeros(weights.shape[1]), port.zero.covariance_nm2, RESAMPLES) @ weights.T
    slope_errors = np.where(moves, mean_nm * per_nm**2 * slopes[:, 1], 0.0) * random.standard_normal((RESAMPLES, 1))
    drawn = result.resampled + per_nm * zeros_nm + slope_errors
    zero_std_nm = np.sqrt(np.einsum("ij,jk,ik->i", weights, port.zero.covariance_nm2, weights))
    return replace(
        source,
        velocity_rad_s=result.velocity,
        velocity_std_rad_s=np.std(drawn, axis=0),
        resampled_rad_s=drawn,
        port_torque_nm=mean_nm,
        # Feedback that holds the reading's mean at zero takes the noise out of the pieces, not out of what is known.
        port_torque_std_nm=np.hypot(np.maximum(scatter_nm, noise_nm), zero_std_nm),
    )


@dataclass(frozen=True)
class _Level:
    """One dwell: velocity and torque as read, in pieces (PIECES,), the latter NaN where too little of it was."""

    command: float
    rising: bool
    velocity: FloatArray
    torque_nm: FloatArray
    torque_noise_nm: float  # deviation of their mean, of the noise of readings alone
    span_s: float
    middle_ns: int


def _levels(measured: Measured) -> Iterator[_Level]:
    torque = measured.torque[measured.torque["valid"]]
    noise_nm = noise_deviation(torque["torque_nm"], np.ones(len(torque), dtype=bool))
    for segment in filter(is_staircase, measured.segments):
        before = _command_before(measured.ticks, segment)
        for command, begin_ns, end_ns in dwells(measured.ticks, segment):
            start_ns = round(begin_ns + SKIPPED_SHARE * (end_ns - begin_ns))
            rows = measured.motion[_rows(measured.motion, "arrival_ns", start_ns, end_ns)]
            if len(rows) >= LEAST_READINGS:
                time_s = (rows["arrival_ns"] - rows["arrival_ns"][0]) * 1e-9
                read_nm = torque["torque_nm"][_rows(torque, "arrival_ns", start_ns, end_ns)]
                yield _Level(
                    command,
                    command >= before,
                    pieces_of(time_s, rows["position_rad"]),
                    _means(read_nm),
                    noise_nm / np.sqrt(max(len(read_nm), 1)),
                    float(time_s[-1]),
                    (start_ns + end_ns) // 2,
                )
            before = command


def _means(values: FloatArray) -> FloatArray:
    """Of PIECES equal parts."""
    if len(values) < PIECES:
        return np.full(PIECES, np.nan)
    return np.array([float(np.mean(part)) for part in np.array_split(values, PIECES)])


def blocked_map(measured: Measured) -> BlockedMap:
    """Torque at standstill against command, by the side of approach. Raises ExperimentError where there is none."""
    levels, histories = [], []
    for segment in measured.segments:
        if segment.procedure != "blocked" or not segment.name.startswith("hold"):
            continue
        ticks = measured.ticks[_rows(measured.ticks, "tick_ns", segment.start_ns, segment.end_ns)]
        start_ns = round(segment.end_ns - SETTLED_SHARE * (segment.end_ns - segment.start_ns))
        torque = measured.torque[_rows(measured.torque, "arrival_ns", start_ns, segment.end_ns)]
        mean = _mean(torque["torque_nm"][torque["valid"]])
        if mean is not None and len(ticks):
            levels.append((float(np.median(ticks["command"])), *mean, "above" in segment.name))
            histories.append(_history(segment.name))
    if not levels:
        raise ExperimentError("no held level was recorded: run the step 'blocked' to measure the Thévenin source")
    table = np.array(levels, dtype=float)
    return BlockedMap(table[:, 0], table[:, 1], table[:, 2], table[:, 3] > 0, tuple(histories))


def _history(name: str) -> str:
    if name == FROM_REST:
        return "rest"
    return "fast" if name.endswith(FAST) else "slow"


def _rows(table: Table, key: str, start_ns: int, end_ns: int) -> slice:
    first, last = np.searchsorted(table[key], [start_ns, end_ns])
    return slice(int(first), int(last))


def _command_before(ticks: Table, segment: SegmentInfo) -> float:
    """The command from which the first level is reached, or would be by steps like the next one."""
    rows = _rows(ticks, "tick_ns", segment.start_ns, segment.end_ns)
    own = ticks["command"][rows]
    earlier = ticks["command"][: rows.start][-1] if rows.start > 0 else own[0]
    changed = own[own != own[0]]
    if earlier != own[0] or not changed.size:
        return float(earlier)
    return float(own[0] - (changed[0] - own[0]))


def is_staircase(segment: SegmentInfo) -> bool:
    """Whether it holds level after level with no torque at the port."""
    return segment.procedure == "free" and segment.name.startswith("staircase")


def dwells(ticks: Table, segment: SegmentInfo) -> list[tuple[float, int, int]]:
    """Each level of a staircase: the command, and when its dwell begins and ends [ns]."""
    own = ticks[_rows(ticks, "tick_ns", segment.start_ns, segment.end_ns)]
    edges = np.flatnonzero(np.diff(own["command"]) != 0) + 1
    return [
        (float(part["command"][0]), int(part["tick_ns"][0]), int(part["tick_ns"][-1]))
        for part in np.split(own, edges)
        if len(part) >= SHORTEST_DWELL_TICKS
    ]


def _mean(values: FloatArray) -> tuple[float, float] | None:
    if len(values) < 4 * BLOCKS:
        return None
    means = [float(np.mean(part)) for part in np.array_split(values, BLOCKS)]
    return float(np.mean(values)), float(np.std(means, ddof=1) / np.sqrt(BLOCKS))


Interval = tuple[float, float]

# The time constant may be this share of a dwell, from what shows in one piece to what hardly bends over all of them.
SHARES = np.geomspace(0.02, 1.0, 160)
# Chance gives the approach that is fitted so much less often than this.
SEEN_P = 0.01
SETTLING_RESAMPLES = 400
SETTLING_SEED = 8
QUARTER = PIECES // 4
TAILS = (0.025, 0.975)


# The zero dynamics as they are seen: how the port settles after each step of the command, with no torque on it.
@dataclass(frozen=True)
class Settling:
    """Over all steps: the time constant, and how much of a step's change still comes in the last quarter of its dwell.

    ``left`` is near 0 where the port comes to rest on its source, near 1 or above where it does not. Intervals are
    of 95 %, from steps drawn anew. ``time_s`` is 0 where the approach is too fast to be seen.
    """

    steps: int
    dwell_s: float
    time_s: float
    time_interval_s: Interval
    left: float
    left_interval: Interval


def settling(measured: Measured) -> Settling | None:
    """From the staircases of the free port; None where there are none."""
    velocity, spans_s, follows = _dwells(measured)
    if len(velocity) < 2:
        return None
    draws = np.random.default_rng(SETTLING_SEED).integers(0, len(velocity), (SETTLING_RESAMPLES, len(velocity)))
    end = velocity[:, -QUARTER:].mean(axis=1)
    late = end - velocity[:, -2 * QUARTER : -QUARTER].mean(axis=1)
    # What a first level steps from was not dwelt on.
    squares = np.stack([late**2, np.diff(end, prepend=end[:1]) ** 2]) * follows
    left = _rms_ratio(squares.sum(axis=1))
    left_drawn = _rms_ratio(squares[:, draws].sum(axis=2))
    dwell_s = float(np.mean(spans_s))
    share, shares_drawn = _time_shares(velocity, draws)
    return Settling(
        steps=len(velocity),
        dwell_s=dwell_s,
        time_s=share * dwell_s,
        time_interval_s=_interval(shares_drawn * dwell_s),
        left=float(left),
        left_interval=_interval(left_drawn),
    )


def _dwells(measured: Measured) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity in pieces (dwells, PIECES) from each dwell's very beginning; how long it lasts; 1 where one came before.

    The latter two are of shape (dwells,).
    """
    pieces, spans_s, follows = [], [], []
    for segment in filter(is_staircase, measured.segments):
        for place, (_, start_ns, end_ns) in enumerate(dwells(measured.ticks, segment)):
            first, last = np.searchsorted(measured.motion["arrival_ns"], [start_ns, end_ns])
            rows = measured.motion[first:last]
            if len(rows) >= LEAST_READINGS:
                time_s = (rows["arrival_ns"] - rows["arrival_ns"][0]) * 1e-9
                pieces.append(pieces_of(time_s, rows["position_rad"]))
                spans_s.append(float(time_s[-1]))
                follows.append(float(place > 0))
    return np.array(pieces), np.array(spans_s), np.array(follows)


def _time_shares(velocity: FloatArray, draws: npt.NDArray[np.int64]) -> tuple[float, FloatArray]:
    """The time constant as a share of the dwell, and as other steps might have given it; zeros where none shows."""
    middle = (np.arange(PIECES) + 0.5) / PIECES
    costs = np.stack([_cost(velocity, np.exp(-middle / share)) for share in SHARES], axis=1)
    plain = float(np.sum((velocity - velocity.mean(axis=1, keepdims=True)) ** 2))
    total = costs.sum(axis=0)
    steps, best = len(velocity), int(np.argmin(total))
    freedom = steps * (PIECES - 2) - 1
    gain = (plain - total[best]) / max(total[best], 1e-300) * freedom / (steps + 1)
    if f_tail(gain, steps + 1, freedom) >= SEEN_P:
        return 0.0, np.zeros(len(draws))
    return float(SHARES[best]), SHARES[np.argmin(costs[draws].sum(axis=1), axis=1)]


def _cost(velocity: FloatArray, approach: FloatArray) -> FloatArray:
    """What a constant and an approach of this shape leave of each dwell: sums of squares (dwells,)."""
    design = np.stack([np.ones(PIECES), approach], axis=1)
    left = velocity - velocity @ np.linalg.pinv(design).T @ design.T
    return np.asarray(np.sum(left**2, axis=1))


def _rms_ratio(sums: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(sums[0] / np.maximum(sums[1], 1e-300)))


def _interval(draws: FloatArray) -> Interval:
    low, high = np.quantile(draws, TAILS)
    return float(low), float(high)
