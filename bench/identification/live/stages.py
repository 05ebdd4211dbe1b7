"""The two stages of live identification: seeking in all data so far, then following what drifts.

Both digest blocks of data and name shape, linear parameters, the deviations of all and whether the scale is known; each
returns the stage that goes on.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from bench.identification.fit import LEAST_EVIDENCE
from bench.identification.live.bank import WIDTH
from bench.identification.live.search import HIGH, LOW, Candidate, covariance, evaluate, evidence, improved, scan
from bench.identification.live.tracking import Tracker
from bench.identification.regression import Shape

FloatArray = npt.NDArray[np.float64]

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
# Of (log β, log s, d_c, d_m), then gain, inertia, damping, Coulomb torque, presliding damping and bias, the last six
# relative: what may change in a second, as a random walk. Oil warms and wears; a rotor does not grow heavier.
DRIFT_PER_S = np.array([1e-4, 5e-4, 1e-7, 1e-7, 2e-4, 1e-5, 2e-3, 1e-3, 1e-3, 1e-2])
DELAY_UNIT_S = 1e-4


@dataclass(frozen=True)
class Block:
    """What half a second of data says: the Gram matrix of its rows, and the part of it that is noise in the columns."""

    gram: FloatArray = field(default_factory=lambda: np.zeros((WIDTH, WIDTH)))
    noise: FloatArray = field(default_factory=lambda: np.zeros((WIDTH, WIDTH)))
    samples: int = 0

    def with_rows(self, rows: FloatArray, noise: FloatArray) -> "Block":
        """``noise`` is the covariance of a row."""
        return Block(self.gram + rows.T @ rows, self.noise + len(rows) * noise, self.samples + len(rows))

    def __add__(self, other: "Block") -> "Block":
        return Block(self.gram + other.gram, self.noise + other.noise, self.samples + other.samples)

    def without_noise(self) -> FloatArray:
        """The Gram matrix as it were without noise in the columns, where they hold enough else."""
        enough = np.diag(self.gram) > 2.0 * np.diag(self.noise)
        return np.asarray(self.gram - self.noise * np.outer(enough, enough))


@dataclass
class Searching:
    """The best of all in all data so far."""

    tick_s: float
    blocks: list[Block] = field(default_factory=list)
    digested: int = 0
    best: Candidate | None = None

    def digest(self, block: Block) -> "Searching | Tracking":
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

    def _total(self) -> Block:
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

    def _handed_over(self) -> "Searching | Tracking":
        values = self.values() if self.digested >= LEAST_SEARCH_BLOCKS else None
        if values is None or self.best is None or not values[3]:
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
        return Tracking(self.tick_s, tracker, scale, variance)


@dataclass
class Tracking:
    """Everything followed by a Kalman filter, linearised anew at every block."""

    tick_s: float
    tracker: Tracker
    scale: FloatArray
    variance: float
    disbelieved: int = 0

    def digest(self, block: Block) -> "Searching | Tracking":
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
            return Searching(self.tick_s)
        if believed:
            unlimited = np.full(6, np.inf)
            self.tracker.hold(
                np.concatenate([LOW, -unlimited]) / self.scale, np.concatenate([HIGH, unlimited]) / self.scale
            )
            left = CORRELATED * self._here().cost(block.gram) / block.samples
            self.variance += (left - self.variance) / VARIANCE_MEMORY_BLOCKS
        return self

    def values(self) -> tuple[Shape, FloatArray, FloatArray, bool]:
        """As in Searching."""
        here = self._here()
        return here.shape, here.linear, np.sqrt(np.diag(self.tracker.covariance)) * self.scale, True

    def _here(self) -> Candidate:
        values = self.tracker.values * self.scale
        return Candidate.of(Shape.of(values[:4]), values[4:], self.tick_s)
