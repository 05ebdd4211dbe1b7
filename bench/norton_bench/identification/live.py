"""Identification while the experiment runs: the final fit, of the recording as far as it goes, again and again.

Each fit sees everything that was recorded for identification so far, so it is as right as the final one of the same
data; what the calibration told of the actuator counts too, for nothing else sets a scale before motion is imposed.
What moves meanwhile is followed from there (``Drift``). Deviations are those of the parametric bootstrap, and the
network's terms those that the residual asks for. Both are worked out each time that the data have doubled; in between
deviations shrink as the residual's, and the terms stay."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification import cleaning
from norton_bench.identification.bootstrap import Readings
from norton_bench.identification.cleaning import Cleaned
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.fit import bias_of, result_of, solution_of, solution_with
from norton_bench.identification.judged_fit import composed, looked_at
from norton_bench.identification.load import coupling_of
from norton_bench.identification.model_error import ModelError, judged_estimates
from norton_bench.identification.motor_values import names_of, physical, stated_by_name
from norton_bench.identification.results import FitResult, LiveEstimate, Simulated
from norton_bench.identification.ringing import without_ringing
from norton_bench.identification.sanity_checks import Blocks
from norton_bench.identification.separable import Solution
from norton_bench.identification.shape import COULOMB, DAMPING, GAIN, VISCOUS
from norton_bench.identification.signals import Signals, signals
from norton_bench.identification.statistics import LOOSE_BEYOND
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, Status
from norton_bench.models.terms import TERM_BY_NAME, TERMS, Factor, NetworkTerm
from norton_bench.records import Measured, SegmentInfo, join
from norton_bench.segments import Use

# Oil warms and wears, and magnets with it; a rotor does not grow heavier.
MAY_MOVE = (GAIN, VISCOUS, COULOMB, DAMPING)
# A trend of so many deviations is no accident: a chance of 1 in 15 000 for each that is looked at.
SIGNIFICANT_TREND = 4.0
# Random walks in question: a share of the value in the square root of a second.
RATES = (1e-3, 3e-3, 1e-2, 3e-2)
# What is known beforehand, in deviations of the fit: next to nothing.
VAGUE = 1e3
# Directions of a block with less information than this, relative to the fit's, say nothing.
SAYS_NOTHING = 1e-6
# The scatter of the scores about constants holds the drift too: once that is followed, the noise is what is left.
ROUNDS = 2


# Parameters that move while the record is taken: a Kalman filter over its blocks, about the fit of all of it.
#
# A fit takes every parameter for constant. Where one of them goes with time by more than the scatter of the blocks
# explains, it is given a random walk, at the rate with which the blocks are likeliest, and the filter follows it. All
# others are estimated along with it, as constants.
@dataclass(frozen=True)
class Drift:
    """What became of the unknowns at the end of the record: ``change`` (p,) from the solution's own, linear ones
    first, with its ``covariance`` (p, p); ``moved`` are those that walked.
    """

    moved: tuple[int, ...]
    change: FloatArray
    covariance: FloatArray


def drift_of(solution: Solution) -> Drift | None:
    """None where nothing moves, or the record is too short to tell."""
    blocks = Blocks.of(solution)
    moved = tuple(column for column in MAY_MOVE if _trends(blocks, column)) if blocks.time_s.size else ()
    if not moved:
        return None
    record = _Record.of(blocks)
    for _ in range(ROUNDS):
        end = _followed(record, moved, solution.linear)
        record = record.with_noise(end.surprise)
    unit = record.unit
    return Drift(moved, np.asarray(end.values * unit), np.asarray(end.covariance * np.outer(unit, unit)))


def _followed(record: "_Record", moved: tuple[int, ...], linear: FloatArray) -> "_End":
    """With the likeliest rates, found for one after the other."""
    walks = np.zeros(len(record.unit))
    for column in moved:
        size = abs(float(linear[column])) / record.unit[column]
        rates = [_with(walks, column, rate * size) for rate in RATES]
        walks = max(rates, key=lambda each: record.filtered(each).likelihood)
    return record.filtered(walks)


def _with(walks: FloatArray, column: int, rate: float) -> FloatArray:
    other = walks.copy()
    other[column] = rate
    return other


def _trends(blocks: Blocks, column: int) -> bool:
    time_s = blocks.time_s - np.mean(blocks.time_s)
    trend, deviation = blocks.change(column, time_s / max(float(np.ptp(time_s)), 1e-300), time_s.size // 2)
    return abs(trend) > SIGNIFICANT_TREND * deviation


@dataclass(frozen=True)
class _End:
    """A filter after the last block, values in the record's unit. ``surprise`` is the median over the blocks of the
    innovations' mean square, in their own variances."""

    values: FloatArray
    covariance: FloatArray
    likelihood: float
    surprise: float


@dataclass(frozen=True)
class _Record:
    """Blocks as measurements ``root · p = z`` with unit noise, p in ``unit`` (p,): deviations of the fit of all."""

    roots: tuple[FloatArray, ...]
    z: tuple[FloatArray, ...]
    steps_s: FloatArray  # from each block to the next
    unit: FloatArray

    @classmethod
    def of(cls, blocks: Blocks) -> "_Record":
        inverse = np.linalg.pinv(blocks.gram.sum(axis=0), rcond=1e-12, hermitian=True)
        # The scores' own scatter is the noise: colour within a block is in it.
        variance = float(np.einsum("bi,ij,bj->", blocks.score, inverse, blocks.score)) / len(inverse)
        own = np.sqrt(np.maximum(np.diag(inverse) * variance, 1e-300))
        roots, z = [], []
        for gram, score in zip(blocks.gram, blocks.score, strict=True):
            value, vector = np.linalg.eigh(gram * np.outer(own, own) / variance)
            says = value > SAYS_NOTHING
            root = np.sqrt(value[says])[:, None] * vector[:, says].T
            roots.append(root)
            z.append((root / value[says, None]) @ (score * own / variance))
        return cls(tuple(roots), tuple(z), np.diff(blocks.time_s, prepend=blocks.time_s[0]), own / blocks.scale)

    def with_noise(self, factor: float) -> "_Record":
        """As if the noise's variance were greater by this factor; in a unit that is then the same share of it."""
        return replace(
            self,
            roots=tuple(root / np.sqrt(factor) for root in self.roots),
            z=tuple(z / np.sqrt(factor) for z in self.z),
        )

    def filtered(self, walks: FloatArray) -> "_End":
        """The filter after the last block; ``walks`` (p,) in units a root second."""
        size, likelihood, surprises = len(self.unit), 0.0, list[float]()
        from filterpy.kalman import KalmanFilter  # noqa: PLC0415  (half a second, and most sessions need none)

        follower = KalmanFilter(dim_x=size, dim_z=size)
        follower.x, follower.P, follower.F = np.zeros(size), VAGUE**2 * np.eye(size), np.eye(size)
        for root, z, step_s in zip(self.roots, self.z, self.steps_s, strict=True):
            follower.predict(Q=np.diag(walks**2 * step_s))
            if z.size:
                follower.update(z, R=np.eye(z.size), H=root)
                surprise = float(follower.y @ np.linalg.solve(follower.S, follower.y))
                likelihood -= 0.5 * (surprise + float(np.linalg.slogdet(2 * np.pi * follower.S)[1]))
                surprises.append(surprise / z.size)
        return _End(follower.x, follower.P, likelihood, float(np.median(surprises)))


LEARNT_FROM = (Use.CALIBRATE, Use.IDENTIFY)
# The first fit. Half as much tells next to nothing of friction.
FIRST_S = 4.0
# The next one when there is so much more, and not sooner or later than this: all of them together then cost some five
# times the last one.
GROWTH = 0.3
SOONEST_S, LATEST_S = 2.0, 10.0
# What is older is forgotten: a fit of it takes some three seconds.
WINDOW_S = 180.0
# Simulated records for the deviations: half of the final fit's, which widens them by a tenth (Student's t).
DRAWS = 6
SIGNIFICANT_BIAS = 2.0  # deviations
# What changes with time is followed, not fitted. A joint takes longer to find than there is time between two fits.
LIVE_TERMS = frozenset(term.name for term in TERMS if not term.in_time and term.factor is not Factor.JOINT)


@dataclass(frozen=True)
class _Correction:
    """What the bootstrap made of one value and its deviation: the factor by which the residual's deviation is wider,
    the value's bias, and the deviation of that, both relative."""

    wider: float = 1.0
    bias: float = 0.0
    bias_std: float = 0.0

    @classmethod
    def of(cls, estimate: Estimate, simulated: Simulated) -> "_Correction":
        (value, std), bias_std = simulated.of_residual[estimate.name], simulated.repeated_std[estimate.name]
        size = max(abs(value), 1e-300)
        of_scatter = max(estimate.std**2 - bias_std**2, std**2)
        wider, bias = float(np.sqrt(of_scatter) / max(std, 1e-300)), value - estimate.value
        # A few draws alone make a bias of this size; to take that off would only shake the values.
        if abs(bias) < SIGNIFICANT_BIAS * np.sqrt(of_scatter / DRAWS):
            bias = 0.0
        return cls(wider, bias / size, bias_std / size)

    def of_estimate(self, estimate: Estimate) -> Estimate:
        """The same, of a later fit's."""
        size = abs(estimate.value)
        std = float(np.hypot(self.wider * estimate.std, self.bias_std * size))
        loose = estimate.status is Status.VALID and std > LOOSE_BEYOND * size
        status = Status.UNEXCITED if loose else estimate.status
        return replace(estimate, value=estimate.value - self.bias * size, std=std, status=status)


@dataclass
class LiveIdentifier:
    """Takes consecutive parts; returns the newest estimate each time."""

    command_unit: str
    tick_s: float
    _parts: list[Measured] = field(default_factory=list, init=False)
    _told_ticks: int = field(default=0, init=False)  # so many were meant for identification
    _next_ticks: int = field(default=0, init=False)
    _simulated_ticks: int = field(default=0, init=False)
    _coupling: Coupling | None = field(default=None, init=False)
    _calibrated_ticks: int = field(default=0, init=False)  # that the coupling is known from
    _corrections: dict[str, _Correction] = field(default_factory=dict, init=False)
    _terms: tuple[NetworkTerm, ...] = field(default=(), init=False)  # of the last fit that was simulated, relative
    _error: ModelError | None = field(default=None, init=False)  # what that model was wrong by
    _latest: LiveEstimate = field(default_factory=lambda: LiveEstimate(0), init=False)

    def __post_init__(self) -> None:
        self._next_ticks = round(FIRST_S / self.tick_s)

    def update(self, part: Measured) -> LiveEstimate:
        """Learn from the next part: of segments meant for LEARNT_FROM alone."""
        part = cleaning.clean_part(part.without_frames())
        if self._went_back(part):
            self._begin_anew()
        self._parts.append(part)
        told = [segment.index for segment in part.segments if segment.use in LEARNT_FROM]
        self._told_ticks += int(np.count_nonzero(np.isin(part.ticks["segment"], told)))
        if self._told_ticks >= self._next_ticks:
            more_s = np.clip(GROWTH * self._told_ticks * self.tick_s, SOONEST_S, LATEST_S)
            self._next_ticks = self._told_ticks + round(float(more_s) / self.tick_s)
            self._forget()
            self._latest = self._fitted()
        stamp_ns = int(part.ticks["tick_ns"][-1]) if len(part.ticks) else self._latest.stamp_ns
        self._latest = replace(self._latest, stamp_ns=stamp_ns)
        return self._latest

    def _went_back(self, part: Measured) -> bool:
        """Whether the clock was set back: what came before is then of another time."""
        before = next((each.ticks["tick_ns"][-1] for each in reversed(self._parts) if len(each.ticks)), None)
        return before is not None and len(part.ticks) > 0 and bool(part.ticks["tick_ns"][0] <= before)

    def _begin_anew(self) -> None:
        self._parts, self._corrections, self._coupling = [], {}, None
        self._terms, self._error = (), None
        self._told_ticks, self._simulated_ticks, self._calibrated_ticks = 0, 0, 0
        self._next_ticks = round(FIRST_S / self.tick_s)

    def _forget(self) -> None:
        newest_ns = next(int(each.ticks["tick_ns"][-1]) for each in reversed(self._parts) if len(each.ticks))
        while len(self._parts[0].ticks) and self._parts[0].ticks["tick_ns"][-1] < newest_ns - WINDOW_S * 1e9:
            self._parts.pop(0)

    def _fitted(self) -> LiveEstimate:
        """Of all parts; the estimate before where they tell nothing yet."""
        measured = join(self._parts)
        try:
            cleaned = cleaning.clean(replace(measured, segments=tuple(map(_learnt_from, measured.segments))))
            stretches = signals(cleaned.measured, self.tick_s, Use.IDENTIFY)
            solution = solution_of(stretches, findings=cleaned.findings)
        except ExperimentError:
            return self._latest
        if self._told_ticks >= 2 * self._simulated_ticks and not cleaned.findings.doubts:
            result = self._simulated(self._readings(measured, cleaned.measured), stretches, solution, cleaned)
        else:
            solution = self._with_terms(solution)
            result = result_of(stretches, solution, command_unit=self.command_unit, findings=cleaned.findings)
        estimates = _estimates(result)
        if simulated := result.simulated:
            solution = simulated.bench.solution
            self._simulated_ticks = self._told_ticks
            self._corrections = {each.name: _Correction.of(each, simulated) for each in estimates}
            stated = simulated.of_residual
            estimates = tuple(replace(each, value=stated[each.name][0], std=stated[each.name][1]) for each in estimates)
        if not result.ratios_only:
            estimates = self._corrected(estimates)
        drift = None if result.ratios_only or not result.converged else drift_of(solution)
        if drift is not None:
            estimates = self._moved(estimates, solution, drift)
        if self._error is not None and not result.ratios_only:
            estimates = judged_estimates(estimates, self._error)
        network = self._network(estimates, result)
        return LiveEstimate(self._latest.stamp_ns, estimates, network, result.samples)

    def _simulated(
        self, readings: Readings, stretches: tuple[Signals, ...], solution: Solution, cleaned: Cleaned
    ) -> FitResult:
        """As the final fit is. What ringing makes of the values counts as a bias, to be taken off later fits, too."""
        quiet, quiet_stretches, quiet_solution = without_ringing(readings, stretches, solution)
        result = self._composed(quiet_stretches, quiet_solution, quiet, cleaned)
        if quiet.ringing_nm is None or result.simulated is None:
            return result
        as_read = self._with_terms(solution)
        of_residual = stated_by_name(as_read, *physical(as_read))
        return replace(result, simulated=replace(result.simulated, of_residual=of_residual))

    def _composed(
        self, stretches: tuple[Signals, ...], solution: Solution, readings: Readings, cleaned: Cleaned
    ) -> FitResult:
        """With simulated deviations and with the terms that the residual asks for, as the final fit is."""
        self._terms, self._error = (), None
        unit, findings = self.command_unit, cleaned.findings
        result = result_of(stretches, solution, command_unit=unit, findings=findings, readings=readings)
        if result.simulated is None or result.doubtful:
            return result
        plain = looked_at(result, stretches, (), cleaned.measured)
        best = composed(plain, cleaned.measured, command_unit=unit, findings=findings, allowed=LIVE_TERMS)
        self._terms = best.fitted.network.relative_terms
        if best.error is not None and not any(_in_time(each.kind.name) for each in best.error.departures):
            self._error = best.error
        return best.fitted

    def _with_terms(self, plain: Solution) -> Solution:
        if not self._terms or plain.free_motion:
            return plain
        return solution_with(plain, self._terms, bias_of(plain))

    def _readings(self, measured: Measured, cleaned: Measured) -> Readings:
        calibrated = [segment.index for segment in measured.segments if segment.use is Use.CALIBRATE]
        ticks = int(np.count_nonzero(np.isin(measured.ticks["segment"], calibrated)))
        if ticks > self._calibrated_ticks:
            self._coupling, self._calibrated_ticks = coupling_of(measured, self.tick_s), ticks
        return Readings(cleaned, self.tick_s, Use.IDENTIFY, DRAWS, self._coupling)

    def _corrected(self, estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
        return tuple(self._corrections.get(each.name, _Correction()).of_estimate(each) for each in estimates)

    def _moved(self, estimates: Sequence[Estimate], solution: Solution, drift: Drift) -> tuple[Estimate, ...]:
        """As they are now: each by what the end of the record differs from all of it."""
        linear, shape = solution.linear + drift.change[: len(solution.linear)], solution.shape.as_array()
        shape[list(solution.free)] += drift.change[len(solution.linear) :]
        now = replace(solution, linear=linear, shape=solution.shape.at(shape))
        before = physical(solution)[0]
        after, covariance = physical(now, drift.covariance)
        moved = []
        names = names_of(solution)
        for estimate in estimates:
            at = names.index(estimate.name)
            known = self._corrections.get(estimate.name, _Correction())
            value = estimate.value + float(after[at] - before[at])
            std = float(np.hypot(known.wider * np.sqrt(covariance[at, at]), known.bias_std * abs(value)))
            moved.append(replace(estimate, value=value, std=std))
        return tuple(moved)

    def _network(self, estimates: Sequence[Estimate], result: FitResult) -> NortonNetwork | None:
        """Once every parameter is valid: correlated as in the fit, as uncertain as the estimates."""
        if any(estimate.status is not Status.VALID for estimate in estimates):
            return None
        covariance = np.asarray(result.network.covariance)
        std = np.array([estimate.std for estimate in estimates])
        wider = std / np.sqrt(np.diag(covariance))
        values = {each.name: each.value for each in estimates}
        return replace(
            NortonNetwork.of_parameters(values, self.command_unit, servo=result.network.servo),
            terms=tuple(each.with_values(values) for each in result.network.terms),
            covariance_names=tuple(values),
            covariance=tuple(map(tuple, (covariance * np.outer(wider, wider)).tolist())),
            provenance={"fit": "live"},
        )


def _estimates(result: FitResult) -> tuple[Estimate, ...]:
    """The motor's seven, then those of the terms: as the network's covariance has them."""
    return tuple(result.estimate(name) for name in result.network.covariance_names)


def _in_time(name: str) -> bool:
    return name in TERM_BY_NAME and TERM_BY_NAME[name].in_time


def _learnt_from(segment: SegmentInfo) -> SegmentInfo:
    return replace(segment, use=Use.IDENTIFY) if segment.use in LEARNT_FROM else segment
