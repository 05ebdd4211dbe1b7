"""Identification while the experiment runs, without an initial guess.

Parts of about 100 ms become rows of a bank (live_bank); their Gram matrix answers, for any friction shape, bandwidth
and delays, what the best linear parameters are. Until everything is known, the best of all is sought in all data so far
(live_search). From then on a Kalman filter follows shape, delays and linear parameters together, block by block
(tracking), and what is older than that is forgotten.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from bench.identification.fit import LEAST_EVIDENCE, PHYSICAL, network_of
from bench.identification.live_bank import BANDWIDTH_NODES, S_NODES, WIDTH, LiveBank
from bench.identification.live_search import HIGH, LOW, Candidate, covariance, evaluate, evidence, improved, scan
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
# So long is everything sought in all data so far: as long as drift cannot matter, nothing beats that.
LEAST_SEARCH_BLOCKS = 40
# When there are so many, neighbours are put together: a long search needs no more memory or time than a short one.
MOST_BLOCKS = 64
SCAN_EVERY_BLOCKS = 4
# The search hands over to tracking once everything is valid and log β and log s are known this well.
HAND_OVER_WITHIN = 0.05
# So many blocks in a row that fit nothing known: the machine is another one, and all is sought anew.
MOST_DISBELIEVED = 10
# A block of which so many times more remains unexplained than of its like is garbage.
BEYOND_LIKE = 100.0
VARIANCE_MEMORY_BLOCKS = 20.0
VALID_WITHIN = {"amplifier_bandwidth": 0.15, "presliding_damping": 0.15}
VALID_WITHIN_ELSE = 0.05
LEARNING_WITHIN = 0.5
# What no residual shows: members between the nodes of the bank, smoothing with little room. Relative deviations, from
# errors on simulated benches with other true values (docs/identification.md).
FLOOR = {
    "torque_gain": 0.0008,
    "amplifier_bandwidth": 0.01,
    "inertia": 0.0025,
    "viscous_damping": 0.003,
    "coulomb_torque": 0.003,
    "presliding_stiffness": 0.008,
    "presliding_damping": 0.015,
}
# Of (log β, log s, d_c, d_m), then gain, inertia, damping, Coulomb torque, presliding damping and bias, the last six
# relative: what may change in a second, as a random walk. Oil warms and wears; a rotor does not grow heavier.
DRIFT_PER_S = np.array([1e-4, 5e-4, 1e-7, 1e-7, 2e-4, 1e-5, 2e-3, 1e-3, 1e-3, 1e-2])
DELAY_UNIT_S = 1e-4


@dataclass
class LiveIdentifier:
    """Digests consecutive parts; the newest estimate is returned each time, refreshed with every block of data."""

    command_unit: str
    tick_s: float
    _streams: LiveStreams = field(init=False)
    _bank: LiveBank = field(init=False)
    _samples: int = field(default=0, init=False)
    _unseen: tuple[tuple[int, int], ...] = field(default=(), init=False)
    _block: "_Block" = field(init=False)
    _state: "_Searching | _Tracking" = field(init=False)
    _latest: LiveEstimate = field(default_factory=lambda: LiveEstimate(0), init=False)

    def __post_init__(self) -> None:
        self._streams = LiveStreams(self.tick_s)
        self._bank = LiveBank(self.tick_s)
        self._block = _Block()
        self._state = _Searching(self.tick_s)

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
            told = self._seen(times_s) & np.all(np.isfinite(rows), axis=1)
            self._accumulate(rows[told], self._bank.noise(piece.count_variance_rad2))
        self._latest = replace(self._latest, stamp_ns=stamp_ns, samples=self._samples)
        return self._latest

    def _seen(self, times_s: FloatArray) -> npt.NDArray[np.bool_]:
        seen = np.ones(times_s.size, dtype=bool)
        origin_ns = self._streams.origin_ns or 0
        for start_ns, end_ns in self._unseen:
            seen &= (times_s < (start_ns - origin_ns) * 1e-9) | (times_s >= (end_ns - origin_ns) * 1e-9)
        return seen

    def _accumulate(self, rows: FloatArray, noise: FloatArray) -> None:
        if not len(rows):
            return
        self._samples += len(rows)
        self._block = self._block.with_rows(rows, noise)
        if self._block.samples < BLOCK_S / self.tick_s:
            return
        block, self._block = self._block, _Block()
        self._state = self._state.digest(block)
        values = self._state.values()
        if values is not None:
            self._latest = self._estimate(*values)

    def _estimate(self, shape: Shape, linear: FloatArray, deviation: FloatArray, scale_known: bool) -> LiveEstimate:
        """From the linear parameters and the deviations of all ten."""
        stiffness = linear[3] * shape.s_per_rad
        values = [linear[0], shape.bandwidth_rad_s, linear[1], linear[2], linear[3], stiffness, linear[4]]
        stds = [
            deviation[4],
            deviation[0] * shape.bandwidth_rad_s,
            *deviation[5:8],
            float(np.hypot(deviation[1] * stiffness, deviation[7] * shape.s_per_rad)),
            deviation[8],
        ]
        estimates = tuple(
            self._one(name, float(value), float(std), shape, scale_known)
            for name, value, std in zip(PHYSICAL, values, stds, strict=True)
        )
        return LiveEstimate(self._latest.stamp_ns, estimates, _network(estimates, self.command_unit), self._samples)

    def _one(self, name: str, value: float, std: float, shape: Shape, scale_known: bool) -> Estimate:
        std = float(np.hypot(std, FLOOR[name] * abs(value)))
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


@dataclass(frozen=True)
class _Block:
    """What half a second of data says: the Gram matrix of its rows, and the part of it that is noise in the columns."""

    gram: FloatArray = field(default_factory=lambda: np.zeros((WIDTH, WIDTH)))
    noise: FloatArray = field(default_factory=lambda: np.zeros((WIDTH, WIDTH)))
    samples: int = 0

    def with_rows(self, rows: FloatArray, noise: FloatArray) -> "_Block":
        """``noise`` is the covariance of a row."""
        return _Block(self.gram + rows.T @ rows, self.noise + len(rows) * noise, self.samples + len(rows))

    def __add__(self, other: "_Block") -> "_Block":
        return _Block(self.gram + other.gram, self.noise + other.noise, self.samples + other.samples)

    def without_noise(self) -> FloatArray:
        """The Gram matrix as it were without noise in the columns, where they hold enough else."""
        enough = np.diag(self.gram) > 2.0 * np.diag(self.noise)
        return np.asarray(self.gram - self.noise * np.outer(enough, enough))


@dataclass
class _Searching:
    """The best of all in all data so far."""

    tick_s: float
    blocks: list[_Block] = field(default_factory=list)
    digested: int = 0
    best: Candidate | None = None

    def digest(self, block: _Block) -> "_Searching | _Tracking":
        self.blocks.append(block)
        self.digested += 1
        self._leave_out_garbage()
        if len(self.blocks) >= MOST_BLOCKS:
            self.blocks = [one + other for one, other in zip(self.blocks[::2], self.blocks[1::2], strict=True)]
        if len(self.blocks) < LEAST_BLOCKS:
            return self
        gram = self._total().without_noise()
        if self.best is not None:
            self.best = improved(gram, evaluate(gram, self.best.shape, self.tick_s))
        if self.digested % SCAN_EVERY_BLOCKS == 0:
            found = scan(gram, self.tick_s)
            if self.best is None or found.cost(gram) < self.best.cost(gram):
                self.best = found
        return self._handed_over()

    def values(self) -> tuple[Shape, FloatArray, FloatArray, bool] | None:
        """Shape, linear parameters, the deviations of all, and whether the scale is known."""
        if self.best is None:
            return None
        known = evidence(self.best, self._total().without_noise()) > LEAST_EVIDENCE
        return self.best.shape, self.best.linear, np.sqrt(np.diag(self._covariance(self.best))), known

    def _total(self) -> _Block:
        return sum(self.blocks[1:], self.blocks[0])

    def _covariance(self, best: Candidate) -> FloatArray:
        grams = [block.without_noise() for block in self.blocks]
        return covariance(best, grams, self._total().samples, CORRELATED)

    def _leave_out_garbage(self) -> None:
        if self.best is None:
            return
        left = np.array([self.best.cost(block.gram) / block.samples for block in self.blocks])
        alike = left < BEYOND_LIKE * np.median(left)
        if not alike.all():
            self.blocks = [block for block, like in zip(self.blocks, alike, strict=True) if like]
            self.best = None

    def _handed_over(self) -> "_Searching | _Tracking":
        values = self.values()
        if values is None or self.best is None or not values[3] or self.digested < LEAST_SEARCH_BLOCKS:
            return self
        shape, linear, deviation, _ = values
        scale = np.concatenate([[1.0, 1.0, DELAY_UNIT_S, DELAY_UNIT_S], np.abs(linear)])
        variance = CORRELATED * self.best.cost(self._total().gram) / self._total().samples
        scale[9] = np.sqrt(variance)
        valid = np.array([VALID_WITHIN_ELSE] * 4 + [VALID_WITHIN["presliding_damping"]])
        if np.any(linear[:5] <= 0.0) or np.any(deviation[4:9] > valid * linear[:5]):
            return self
        if np.any(deviation[:2] > HAND_OVER_WITHIN):
            return self
        drift = np.concatenate([DRIFT_PER_S[:4] / scale[:4], DRIFT_PER_S[4:]])
        start = np.concatenate([shape.as_array(), linear]) / scale
        tracker = Tracker(start, self._covariance(self.best) / np.outer(scale, scale), drift)
        return _Tracking(self.tick_s, tracker, scale, variance)


@dataclass
class _Tracking:
    """Everything followed by a Kalman filter, linearised anew at every block."""

    tick_s: float
    tracker: Tracker
    scale: FloatArray
    variance: float
    disbelieved: int = 0

    def digest(self, block: _Block) -> "_Searching | _Tracking":
        here = self._here()
        every = here.gradient() * self.scale
        gram = block.without_noise()
        believed = self.tracker.update(
            every.T @ gram @ every / self.variance,
            every.T @ (gram @ here.residual) / self.variance,
            block.samples * self.tick_s,
            every.T @ block.noise @ every / self.variance,
        )
        self.disbelieved = 0 if believed else self.disbelieved + 1
        if self.disbelieved > MOST_DISBELIEVED:
            return _Searching(self.tick_s)
        if believed:
            unlimited = np.full(6, np.inf)
            self.tracker.hold(
                np.concatenate([LOW, -unlimited]) / self.scale, np.concatenate([HIGH, unlimited]) / self.scale
            )
            left = CORRELATED * self._here().cost(block.gram) / block.samples
            self.variance += (left - self.variance) / VARIANCE_MEMORY_BLOCKS
        return self

    def values(self) -> tuple[Shape, FloatArray, FloatArray, bool]:
        """As in _Searching."""
        here = self._here()
        return here.shape, here.linear, np.sqrt(np.diag(self.tracker.covariance)) * self.scale, True

    def _here(self) -> Candidate:
        values = self.tracker.values * self.scale
        return Candidate.of(Shape.of(values[:4]), values[4:], self.tick_s)


def _network(estimates: tuple[Estimate, ...], command_unit: str) -> NortonNetwork | None:
    if any(estimate.status is not Status.VALID for estimate in estimates):
        return None
    return network_of(estimates, command_unit).with_provenance({"fit": "live"})
