"""How far a network's predictions are off, of torque and free motion, on motion that its values were not fitted to.

Two errors add up: that of the network's values, as their covariance has it, and that of its equations. The second is
what is left of segments that were not fitted, beyond what the readings' own errors leave there. How much these leave is
seen in simulated records; how much such records differ tells what of the rest is chance.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.distributions import normal_quantile
from norton_bench.identification.bootstrap import Simulation
from norton_bench.identification.expansion import Expansion, Linearised, Sums
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import Signals, signals, validation_stretches
from norton_bench.identification.statistics import shrunk
from norton_bench.identification.validation import FreeRun, free_runs
from norton_bench.models.drawn_motor import drawn_networks
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import NAN, PredictionError
from norton_bench.records import Measured
from norton_bench.segments import Use

# Predictions are judged over stretches of this length, and over what is left of a segment down to the shorter one.
PIECE_S, SHORTEST_PIECE_S = 2.0, 0.5
LEVEL = 0.95
# Noise is no greater than what this share of the segments is left with: knocks make readings' differences look noisy.
QUIETEST = 0.25
# Simulated records, each of some fifty stretches of torque and a dozen of free motion: what readings leave there is
# known to within 5 and 10 %.
RECORDS = 4
# Networks as the covariance has them: which share of them is beyond some error is known to within 3 % (binomial, over
# stretches that differ).
NETWORKS = 12
SEED = 0

# Mean squares by segment, and the number of the piece in it.
_ByPiece = dict[tuple[int, int], float]


@dataclass(frozen=True)
class Pieces:
    """Mean squares over n stretches, of torque [N² m²] or velocity [rad²/s²].

    ``seen`` (n,) is what the network leaves of what was measured; ``repeated`` (records, n) is what it leaves where
    only readings err, of which the size is known to ``known_to``, relative, as their noise is. ``drawn`` (networks, n)
    is by how much other networks differ from it, as the covariance has them. ``changed`` (n,) is what the fit tells of
    changes in time, which the network does not foresee; it is not in the others.
    """

    seen: FloatArray
    repeated: FloatArray
    drawn: FloatArray
    known_to: float = 0.0
    changed: FloatArray = field(default_factory=lambda: np.zeros(1))

    def bound(self) -> tuple[float, float]:
        """What the rms error over the next stretch stays below, and how often."""
        mean_square, level = bound(self._of_equations + self.changed + self.drawn)
        return float(np.sqrt(mean_square)), level

    @property
    def _of_equations(self) -> FloatArray:
        """What is the error neither of readings nor of values, (n,); nothing where chance may have made it."""
        usual, records = np.mean(self.repeated, axis=0), len(self.repeated)
        left = self.seen - usual
        own = np.var(self.repeated, axis=0)
        if own.any():
            # A variance out of so few is hardly known. Those of all stretches tell what it is at least, relative; and
            # what is more than that is as likely chance as not. Relative to the mean of all, which no difference moves.
            own = own * records / (records - 1)
            least = float(np.mean(own / usual**2)) * ((self.seen + records * usual) / (records + 1)) ** 2
            variances = (least + 0.5 * np.maximum(own - least, 0.0)) * (1.0 + 1.0 / records)
            weights = 1.0 / variances
            # What the stretches of a record have in common, as its fit's errors, makes their sum scatter more.
            alike = np.var(self.repeated @ weights, ddof=1) * (1.0 + 1.0 / records)
            by_chance = np.hypot(np.sqrt(max(np.sum(weights), alike)), self.known_to * np.sum(weights * usual))
            if np.sum(weights * left) < normal_quantile(LEVEL) * by_chance:
                return np.zeros(left.size)
            left = shrunk(left, variances)
        return np.asarray(np.maximum(left, 0.0))


def prediction_error(
    result: FitResult,
    at: Expansion,
    standing_nm: float,
    fitted: Sequence[Signals],
    unseen: Sequence[Signals],
    measured: Measured,
) -> PredictionError:
    """Of the fit ``result`` to stretches ``fitted``, expanded ``at`` its values; ``unseen`` are those kept for
    validation, ``standing_nm`` is a torque that stands in the fitted zero and is no zero."""
    stretches = (*fitted, *unseen)
    networks = drawn_networks(result.network, NETWORKS, SEED) or (result.network,)
    bench = None if result.simulated is None else result.simulated.bench.over(tuple(unseen))
    records = [] if bench is None else list(islice(of_simulated(result, bench), RECORDS))
    known_to = 0.0 if bench is None else bench.torque_errors.known_to
    torque = _torque(at, standing_nm, [each for _, each in records], _differences(result, stretches, networks))
    used = [each for each in measured.segments if each.use in (Use.IDENTIFY, Use.VALIDATE)]
    runs = free_runs(result, stretches, used, at.zero.moved(-standing_nm))
    # The records change with time as the fit does, which the network does not foresee.
    lasting = [] if at.drifted_nm.any() else records
    put_in = _put_in(result)
    velocity = _velocity(runs, [free_runs(put_in, own, used, each.zero) for own, each in lasting], networks)
    torque_nm, level = replace(torque, known_to=known_to).bound()
    velocity_rad_s = NAN if velocity is None else replace(velocity, known_to=known_to).bound()[0]
    seen = {"velocity": at.velocity_rad_s, "acceleration": at.acceleration_rad_s2, "command": at.command}
    ranges = {name: (float(np.min(values)), float(np.max(values))) for name, values in seen.items()}
    return PredictionError(torque_nm, velocity_rad_s, level, ranges)


def bound(mean_squares: FloatArray) -> tuple[float, float]:
    """What the next of exchangeable values stays below, and how often: at LEVEL, or as near as n values can tell.

    ``mean_squares`` (n,), or (draws, n) where each value is known by draws only. The k-th smallest of n exceeds the
    next with a chance of k/(n + 1), whatever their distribution (conformal prediction: Vovk, Gammerman, Shafer 2005).
    """
    count = mean_squares.shape[-1]
    rank = min(count, int(np.ceil(LEVEL * (count + 1))))
    at = float(np.quantile(mean_squares, rank / count, method="inverted_cdf"))
    return at, min(LEVEL, rank / (count + 1))


def of_simulated(result: FitResult, simulation: Simulation) -> Iterator[tuple[tuple[Signals, ...], Expansion]]:
    """The stretches of records that were simulated with the fit for the truth, and the equation about its values."""
    tick_s = simulation.readings.tick_s
    for record in simulation.records():
        fitted, unseen = signals(record, tick_s, Use.IDENTIFY), validation_stretches(record, tick_s)
        yield (*fitted, *unseen), Expansion.of(result, fitted, unseen)


def _put_in(result: FitResult) -> FitResult:
    """With the network that the records were simulated with: that of the values before any bias was taken off."""
    if result.simulated is None:
        return result
    values = {name: value for name, (value, _) in result.simulated.of_residual.items()}
    return replace(result, network=result.network.with_values(values))


def mean_squares(at: Expansion, standing_nm: float) -> tuple[FloatArray, float]:
    """Of the network's error over pieces (pieces,), each predicted without itself; and the noise's share of each.

    ``standing_nm`` is a torque that stands in the fitted zero and is no zero."""
    squares = np.array(list(_left(at, standing_nm).values())) + _changed(at)
    return squares, min(at.noise_nm2, float(np.quantile(squares, QUIETEST)))


def _torque(
    at: Expansion, standing_nm: float, records: Iterable[Expansion], differences: Iterable[FloatArray]
) -> Pieces:
    seen = _left(at, standing_nm)
    repeated = [_left_by_readings(each) for each in records]
    if not repeated:
        repeated = [dict.fromkeys(seen, mean_squares(at, standing_nm)[1])]
    pieces = _over(seen, repeated, [_by_piece(at, at.memory.taken_off(each)) for each in differences])
    return replace(pieces, changed=_changed(at))


def _changed(at: Expansion) -> FloatArray:
    """Mean squares over pieces of what the fit tells of changes in time, (pieces,)."""
    return np.array(list(_by_piece(at, at.drifted_nm).values()))


def _over(seen: _ByPiece, repeated: Sequence[_ByPiece], drawn: Sequence[_ByPiece]) -> Pieces:
    """Of the pieces ``seen``. Which samples are used depends on the readings' errors, too: a record that lacks a piece
    has its others' mean there."""
    repeated = [each for each in repeated if each]
    usual = [float(np.mean(list(each.values()))) for each in repeated]
    return Pieces(
        np.array(list(seen.values())),
        np.array([[each.get(piece, mean) for piece in seen] for each, mean in zip(repeated, usual, strict=True)]),
        np.array([[each[piece] for piece in seen] for each in drawn]),
    )


def _left(at: Expansion, standing_nm: float) -> _ByPiece:
    """Of the fit's error, each fitted segment predicted by a fit without it."""
    sums = at.sums
    whole = sums.solved(np.arange(len(sums.scale)))
    error_nm = at.without(at.zero.moved(-standing_nm))
    for part in np.unique(at.part[at.fitted]).tolist():
        error_nm[at.part == part] -= _torque_of(at, part, (_by_others(sums, part) - whole) / sums.scale)
    return _by_piece(at, error_nm)


def _left_by_readings(at: Expansion) -> _ByPiece:
    """Of a simulated record, where the equations are true: each segment predicted by a fit to the others."""
    sums = at.sums
    error_nm = at.without(at.zero)
    for part in np.unique(at.part).tolist():
        error_nm[at.part == part] -= _torque_of(at, part, _by_others(sums, part) / sums.scale)
    return _by_piece(at, error_nm)


def _by_others(sums: Sums, part: int) -> FloatArray:
    return sums.solved(np.arange(len(sums.scale)), part)


def _torque_of(at: Expansion, part: int, change: FloatArray) -> FloatArray:
    """In one segment, of a change of the unknowns (unknowns,); the sensor's zero stays."""
    lasting = change.copy()
    lasting[at.basis] = 0.0
    return np.asarray(lasting @ at.jacobian[:, at.part == part])


def _by_piece(at: Expansion, error_nm: FloatArray) -> _ByPiece:
    squares: _ByPiece = {}
    for segment in np.unique(at.segment).tolist():
        inside = np.flatnonzero(at.segment == segment)
        for number, piece in _pieces(at.time_s[inside]):
            squares[segment, number] = float(np.mean(error_nm[inside[piece]] ** 2))
    return squares


def _pieces(time_s: FloatArray) -> Iterator[tuple[int, IntArray]]:
    """Numbers and indices of stretches of PIECE_S each; the last may be as short as SHORTEST_PIECE_S."""
    number = np.floor((time_s - time_s[0]) / PIECE_S).astype(np.int64)
    tick_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else 0.0
    for each in range(int(number[-1]) + 1):
        piece = np.flatnonzero(number == each)
        if piece.size * tick_s >= SHORTEST_PIECE_S:
            yield each, piece


def _differences(
    result: FitResult, stretches: Sequence[Signals], networks: Sequence[NortonNetwork]
) -> Iterator[FloatArray]:
    """By how much each of ``networks`` predicts another torque than the fit's own, (n,)."""

    def predicted(network: NortonNetwork) -> FloatArray:
        at = Linearised.at(replace(result, network=network))
        known = np.concatenate([at.linear, at.waves])
        return np.asarray(known @ at.regression(stretches).columns(at.shape)[0][: known.size])

    usual = predicted(result.network)
    return (predicted(each) - usual for each in networks)


def _velocity(
    runs: Sequence[FreeRun], records: Iterable[Sequence[FreeRun]], networks: Sequence[NortonNetwork]
) -> Pieces | None:
    """None where no motion was free."""
    seen = _by_run((run, run.measured) for run in runs)
    if not seen:
        return None
    repeated = [_by_run((run, run.measured) for run in record) for record in records]
    if not repeated:
        noise = {run.segment: run.noise_rad2_s2 for run in runs}
        repeated = [{(segment, number): noise[segment] for segment, number in seen}]
    return _over(seen, repeated, [_by_run((run, run.motion.predicted(each)) for run in runs) for each in networks])


def _by_run(runs: Iterable[tuple[FreeRun, FloatArray]]) -> _ByPiece:
    """Of what a velocity (n,) differs by from the network's prediction. A segment with a gap has several runs."""
    by_segment = dict[int, list[tuple[FloatArray, FloatArray]]]()
    for run, velocity_rad_s in runs:
        by_segment.setdefault(run.segment, []).append((run.time_s, velocity_rad_s - run.predicted))
    squares: _ByPiece = {}
    for segment, parts in by_segment.items():
        time_s, error = (np.concatenate(each) for each in zip(*parts, strict=True))
        squares |= {(segment, number): float(np.mean(error[piece] ** 2)) for number, piece in _pieces(time_s)}
    return squares
