"""Identification while the experiment runs, without an initial guess.

Parts of about 100 ms become rows of a bank; their Gram matrix answers, for any friction shape, bandwidth and delays,
what the best linear parameters are. Until everything is known, the best of all is sought in all data so far (stages,
search). From then on a Kalman filter follows shape, delays and linear parameters together, block by block (tracking),
and what is older than that is forgotten.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from bench.identification.fit import PHYSICAL, network_of
from bench.identification.live.bank import BANDWIDTH_NODES, S_NODES, LiveBank
from bench.identification.live.stages import VALID_WITHIN, VALID_WITHIN_ELSE, Block, Searching, Tracking
from bench.identification.live.streams import LiveStreams
from bench.identification.regression import Shape
from bench.identification.results import LiveEstimate
from bench.models.network import NortonNetwork
from bench.models.parameters import BY_NAME, Estimate, Status
from bench.records import Measured
from bench.segments import Use

FloatArray = npt.NDArray[np.float64]

BLOCK_S = 0.5
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


@dataclass
class LiveIdentifier:
    """Digests consecutive parts; the newest estimate is returned each time, refreshed with every block of data."""

    command_unit: str
    tick_s: float
    _streams: LiveStreams = field(init=False)
    _bank: LiveBank = field(init=False)
    _samples: int = field(default=0, init=False)
    _unseen: tuple[tuple[int, int], ...] = field(default=(), init=False)
    _block: Block = field(init=False)
    _state: Searching | Tracking = field(init=False)
    _latest: LiveEstimate = field(default_factory=lambda: LiveEstimate(0), init=False)

    def __post_init__(self) -> None:
        self._streams = LiveStreams(self.tick_s)
        self._bank = LiveBank(self.tick_s)
        self._block = Block()
        self._state = Searching(self.tick_s)

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
        block, self._block = self._block, Block()
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


def _network(estimates: tuple[Estimate, ...], command_unit: str) -> NortonNetwork | None:
    if any(estimate.status is not Status.VALID for estimate in estimates):
        return None
    return network_of(estimates, command_unit).with_provenance({"fit": "live"})
