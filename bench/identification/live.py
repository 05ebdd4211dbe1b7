"""Identification while the experiment runs, without an initial guess.

Parts of about 100 ms become rows of a bank (live_bank); their Gram matrix answers, for any friction shape, bandwidth
and delays, what the best linear parameters are. A scan, later Gauss-Newton, finds the best of them; a Kalman filter
follows the linear parameters from there (tracking).
"""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from bench.identification.fit import FLOOR, LEAST_EVIDENCE, PHYSICAL, network_of
from bench.identification.live_bank import BANDWIDTH_NODES, COMMAND_NODES, S_NODES, WIDTH, LiveBank, combination
from bench.identification.live_streams import LiveStreams
from bench.identification.regression import Shape
from bench.identification.results import LiveEstimate
from bench.identification.tracking import Tracker
from bench.models.network import NortonNetwork
from bench.models.parameters import BY_NAME, Estimate, Status
from bench.records import Measured
from bench.segments import Use

FloatArray = npt.NDArray[np.float64]

BLOCK_S = 0.5
# Of white noise in the band, one sample in this many is independent.
CORRELATED = 3.0
LEAST_BLOCKS = 4
# When there are so many, neighbours are put together: a long experiment needs no more memory or time than a short one.
MOST_BLOCKS = 64
SCAN_EVERY_BLOCKS = 4
STEPS_AN_UPDATE = 3
LONGEST_STEP = np.array([0.5, 0.5, 3e-4, 3e-4])
DIFFERENCE = np.array([0.02, 0.02, 2e-5, 2e-5])
# A member has changed, so that tracking starts anew from everything, when it moved this far.
MOVED = np.array([0.03, 0.01, 2e-5, 2e-5])
VALID_WITHIN = {"amplifier_bandwidth": 0.15, "presliding_damping": 0.15}
VALID_WITHIN_ELSE = 0.05
LEARNING_WITHIN = 0.5
SCAN_BANDWIDTHS = (150.0, 600.0, 2000.0)
SCAN_TORQUE_DELAYS = (-1.0, 0.0)
LOW = np.array([np.log(BANDWIDTH_NODES[0]), np.log(S_NODES[0]), -2e-3, -3e-3])
HIGH = np.array([np.log(BANDWIDTH_NODES[-1]), np.log(S_NODES[-1]), 4e-3, 3e-3])


@dataclass(frozen=True)
class Candidate:
    """One shape with its best linear parameters, from a Gram matrix."""

    shape: Shape
    linear: FloatArray
    cost: float
    columns: FloatArray
    residual: FloatArray  # how the residual is combined from a row


@dataclass
class LiveIdentifier:
    """Digests consecutive parts; the newest estimate is returned each time, refreshed with every block of data."""

    command_unit: str
    tick_s: float
    _streams: LiveStreams = field(init=False)
    _bank: LiveBank = field(init=False)
    _total: FloatArray = field(default_factory=lambda: np.zeros((WIDTH, WIDTH)), init=False)
    _block: FloatArray = field(default_factory=lambda: np.zeros((WIDTH, WIDTH)), init=False)
    _block_rows: int = field(default=0, init=False)
    _blocks: list[FloatArray] = field(default_factory=list, init=False)
    _digested: int = field(default=0, init=False)  # blocks so far
    _samples: int = field(default=0, init=False)
    _unseen: tuple[tuple[int, int], ...] = field(default=(), init=False)
    _best: Candidate | None = field(default=None, init=False)
    _tracker: Tracker | None = field(default=None, init=False)
    _tracked: Shape | None = field(default=None, init=False)
    _latest: LiveEstimate = field(default_factory=lambda: LiveEstimate(0), init=False)

    def __post_init__(self) -> None:
        self._streams = LiveStreams(self.tick_s)
        self._bank = LiveBank(self.tick_s)

    def update(self, part: Measured) -> LiveEstimate:
        """Learn from the next part; segments meant for validation are followed, but not learned from."""
        stamp_ns = int(part.ticks["tick_ns"][-1]) if len(part.ticks) else self._latest.stamp_ns
        for segment in part.segments:
            if segment.use is Use.VALIDATE:
                others = tuple(span for span in self._unseen if span[0] != segment.start_ns)
                self._unseen = (*others[-8:], (segment.start_ns, segment.end_ns))
        piece = self._streams.add(part)
        if piece is not None:
            times_s, rows = self._bank.rows(piece)
            self._accumulate(rows[self._seen(times_s)])
        self._latest = replace(self._latest, stamp_ns=stamp_ns, samples=self._samples)
        return self._latest

    def _seen(self, times_s: FloatArray) -> npt.NDArray[np.bool_]:
        seen = np.ones(times_s.size, dtype=bool)
        origin_ns = self._streams.origin_ns or 0
        for start_ns, end_ns in self._unseen:
            seen &= (times_s < (start_ns - origin_ns) * 1e-9) | (times_s >= (end_ns - origin_ns) * 1e-9)
        return seen

    def _accumulate(self, rows: FloatArray) -> None:
        if not len(rows):
            return
        self._block += rows.T @ rows
        self._block_rows += len(rows)
        self._samples += len(rows)
        if self._block_rows < BLOCK_S / self.tick_s:
            return
        self._total += self._block
        self._blocks.append(self._block)
        self._digested += 1
        if len(self._blocks) == MOST_BLOCKS:
            self._blocks = [one + other for one, other in zip(self._blocks[::2], self._blocks[1::2], strict=True)]
        block, self._block = self._block, np.zeros((WIDTH, WIDTH))
        duration_s, self._block_rows = self._block_rows * self.tick_s, 0
        if len(self._blocks) >= LEAST_BLOCKS:
            self._search()
            self._track(block, duration_s)
            self._latest = self._estimate()

    def _evaluate(self, shape: Shape) -> Candidate:
        columns, target = combination(shape, self.tick_s)
        gram = columns.T @ self._total @ columns
        right = columns.T @ (self._total @ target)
        linear = _solve(gram, right)
        residual = target - columns @ linear
        return Candidate(shape, linear, float(residual @ self._total @ residual), columns, residual)

    def _search(self) -> None:
        """Improve the best member; scan all of them anew until one is settled on."""
        settled = self._latest.network is not None
        if self._best is not None:
            self._best = self._improved(self._evaluate(self._best.shape))
        if not settled and self._digested % SCAN_EVERY_BLOCKS == 0:
            starts = [self._scan(bandwidth) for bandwidth in SCAN_BANDWIDTHS]
            others = [self._improved(start) for start in starts]
            self._best = min([*others, *([self._best] if self._best else [])], key=lambda candidate: candidate.cost)

    def _scan(self, bandwidth: float) -> Candidate:
        candidates = (
            self._evaluate(Shape(bandwidth, s, command * self.tick_s, torque * self.tick_s))
            for s in S_NODES[1:-1:2]
            for command in COMMAND_NODES[1:-1:2]
            for torque in SCAN_TORQUE_DELAYS
        )
        return min(candidates, key=lambda candidate: candidate.cost)

    def _improved(self, candidate: Candidate) -> Candidate:
        """A few steps of Gauss-Newton, all of it on the Gram matrix."""
        for _ in range(STEPS_AN_UPDATE):
            slopes = self._slopes(candidate)
            every = np.concatenate([slopes, candidate.columns], axis=1)
            step = _solve(every.T @ self._total @ every, every.T @ (self._total @ candidate.residual))[:4]
            at = candidate.shape.as_array()
            for share in (1.0, 0.3):
                moved = np.clip(at + share * np.clip(step, -LONGEST_STEP, LONGEST_STEP), LOW, HIGH)
                trial = self._evaluate(Shape.of(moved))
                if trial.cost < candidate.cost:
                    break
            else:
                break
            candidate = trial
        return candidate

    def _slopes(self, candidate: Candidate) -> FloatArray:
        """How the prediction's combination changes with each unknown of the shape, shape (WIDTH, 4)."""
        at = candidate.shape.as_array()
        slopes = np.empty((WIDTH, 4))
        for k in range(4):
            side = np.zeros(4)
            side[k] = DIFFERENCE[k] if at[k] + DIFFERENCE[k] < HIGH[k] else -DIFFERENCE[k]
            columns, target = combination(Shape.of(at + side), self.tick_s)
            slopes[:, k] = (candidate.residual - (target - columns @ candidate.linear)) / side[k]
        return slopes

    def _track(self, block: FloatArray, duration_s: float) -> None:
        """Give the new block to the Kalman filter; a member that moved is told everything from the beginning."""
        best = self._best
        if best is None:
            return
        variance = max(CORRELATED * best.cost / self._samples, 1e-300)
        tracked = None if self._tracked is None else self._tracked.as_array()
        if self._tracker is None or tracked is None or np.any(np.abs(best.shape.as_array() - tracked) > MOVED):
            self._tracker = Tracker(np.where(best.linear == 0.0, 1e-12, np.abs(best.linear)))
            self._tracked = best.shape
            block, duration_s = self._total, 0.0
        columns, target = combination(self._tracked or best.shape, self.tick_s)
        information = columns.T @ block @ columns / variance
        self._tracker.update(information, columns.T @ (block @ target) / variance, duration_s)

    def _estimate(self) -> LiveEstimate:
        best, tracker = self._best, self._tracker
        if best is None or tracker is None:
            return self._latest
        linear = tracker.values
        deviation = self._deviations(best)
        tracked = np.sqrt(np.diag(tracker.covariance))
        linear_std = np.maximum(deviation[4:9], tracked[:5])
        stiffness = linear[3] * best.shape.s_per_rad
        values = [linear[0], best.shape.bandwidth_rad_s, linear[1], linear[2], linear[3], stiffness, linear[4]]
        stds = [
            linear_std[0],
            deviation[0] * best.shape.bandwidth_rad_s,
            *linear_std[1:4],
            float(np.hypot(deviation[1] * stiffness, linear_std[3] * best.shape.s_per_rad)),
            linear_std[4],
        ]
        known = self._evidence(best) > LEAST_EVIDENCE
        estimates = tuple(
            self._one(name, float(value), float(std), best.shape, known)
            for name, value, std in zip(PHYSICAL, values, stds, strict=True)
        )
        return LiveEstimate(self._latest.stamp_ns, estimates, _network(estimates, self.command_unit), self._samples)

    def _deviations(self, best: Candidate) -> FloatArray:
        """Of the shape's four unknowns, then the six linear ones: a sandwich over blocks."""
        every = np.concatenate([self._slopes(best), best.columns], axis=1)
        information = every.T @ self._total @ every
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        bread = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True)
        scores = np.stack([every.T @ (block @ best.residual) for block in self._blocks]) / scale
        covariance = bread @ (scores.T @ scores) @ bread
        white = np.diag(bread) * CORRELATED * best.cost / self._samples
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), white)) / scale)

    def _evidence(self, best: Candidate) -> float:
        """As fit.scale_evidence."""
        others = best.columns[:, 1:]
        lag = best.columns[:, 0]
        part = _solve(others.T @ self._total @ others, others.T @ (self._total @ lag))
        alone = lag - others @ part
        return float(np.abs(best.linear[0]) * np.sqrt((alone @ self._total @ alone) / max(best.cost, 1e-300)))

    def _one(self, name: str, value: float, std: float, shape: Shape, scale_known: bool) -> Estimate:
        std = float(np.hypot(std, 2 * FLOOR[name] * abs(value)))
        relative = std / max(abs(value), 1e-300)
        held = {
            "amplifier_bandwidth": not BANDWIDTH_NODES[1] < shape.bandwidth_rad_s < BANDWIDTH_NODES[-2],
            "presliding_stiffness": not S_NODES[1] < shape.s_per_rad < S_NODES[-2],
        }
        if held.get(name, False):
            status = Status.AT_BOUND
        elif relative < VALID_WITHIN.get(name, VALID_WITHIN_ELSE) and value > 0 and scale_known:
            status = Status.VALID
        elif relative < LEARNING_WITHIN:
            status = Status.LEARNING
        else:
            status = Status.UNEXCITED
        return Estimate(name, value, std, BY_NAME[name].unit_for(self.command_unit), status)


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """A symmetric system, scaled; directions that nothing excites get zero."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    return np.asarray(np.linalg.lstsq(scaled, right / scale, rcond=1e-11)[0] / scale)


def _network(estimates: tuple[Estimate, ...], command_unit: str) -> NortonNetwork | None:
    if any(estimate.status is not Status.VALID for estimate in estimates):
        return None
    return network_of(estimates, command_unit).with_provenance({"fit": "live"})
