"""Known departures from the paper's motor that may explain a residual, each as a few columns of the equation.

Every kind is judged by blocks, so that neither colour nor bursts of noise alarm, and by how much better segments are
predicted that were left out. The best is named, joins the equation, and the rest is judged anew.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import hermite_e

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.identification.expansion import Expansion, Sums
from norton_bench.identification.residual_tests import chance_of_sum
from norton_bench.identification.sanity_checks import SPLITS
from norton_bench.identification.search_box import SLOW_SHARES
from norton_bench.identification.shape import GAIN, INERTIA
from norton_bench.identification.statistics import LEAST_GAIN

# Chance of naming anything where nothing is wrong; shared out among all kinds and periods that are looked at.
FALSE_ALARM = 0.05
MOST_NAMED = 3
# As many unknowns, and instants, may have changed at once (sanity.checks looks at the same).
CHANGED = 4
BINS_A_TURN = 2048
MOST_PERIODS = 400
# A reversal of the torque is smeared over what the band itself smears: two ticks either side, differentiated.
REACH_TICKS = 6
WIDTH_TICKS = 2.0
# Around its reversal the torque is looked at within these shares of its rms.
REVERSED_SHARES = (0.1, 0.3)


@dataclass(frozen=True)
class Kind:
    """``goes_with`` completes "goes with"; ``cause`` says what does so; ``term`` what to add to the model."""

    name: str
    goes_with: str
    cause: str
    term: str


@dataclass(frozen=True)
class Departure:
    """One that was found: ``rms_nm`` of the torque, ``share`` of what the network left before it was named.

    ``left_nm`` is the rms of what is left with it, segments left out predicted from the others. ``change`` (7,) is what
    its term, and those of all named before, do to each of motor_values.PHYSICAL, relative. ``periods_per_turn`` is 0
    where the position plays no part.
    """

    kind: Kind
    rms_nm: float
    share: float
    left_nm: float
    p_value: float
    change: FloatArray
    periods_per_turn: int = 0


STRIBECK = Kind("stribeck", "the speed of slow sliding", "friction differs between slow and fast sliding", "Stribeck")
ASYMMETRY = Kind("asymmetry", "the direction of motion", "friction is not the same both ways", "asymmetric")
LOAD = Kind("load", "the load", "friction grows with the torque at the port", "load-dependent")
SATURATION = Kind("saturation", "the size of the command", "torque is not proportional to the command", "saturation")
DRAG = Kind("drag", "the speed", "damping torque is not proportional to the velocity", "quadratic drag")
GAIN_DRIFT = Kind("gain_drift", "command and time", "the torque gain changed during the session", "gain over time")
DAMPING_DRIFT = Kind("damping_drift", "speed and time", "damping changed during the session", "damping over time")
FRICTION_DRIFT = Kind(
    "friction_drift", "sliding and time", "Coulomb friction changed during the session", "friction over time"
)
COMPLIANCE = Kind("compliance", "fast changes of the torque", "something gives between motor and port", "elastic joint")
BACKLASH = Kind("backlash", "reversals of the torque", "there is play between motor and port", "backlash")
RIPPLE = Kind("ripple", "command and position", "the torque gain ripples with the position", "torque ripple")
FRICTION_BY_POSITION = Kind(
    "friction_by_position", "sliding and position", "friction changes with the position", "friction by position"
)
CHANGE = Kind("change", "an instant", "something changed during the session at once", "two sets of values")
POSITION = Kind("position", "the position", "a torque acts that depends on the position", "cogging or weight")


# Periods a turn (0: none) and columns (terms, n), over an expansion's rows.
Candidate = tuple[Kind, int, FloatArray]


def departures(
    expansion: Expansion, usual_share: float = 0.0, others: Sequence[Candidate] = ()
) -> tuple[Departure, ...]:
    """All that are no chance and matter, the one that explains the most first; ``others`` are tried beside the kinds.

    What matters makes the error on segments left out smaller by more than held_out.LEAST_GAIN, and explains more of the
    mean square than ``usual_share``: what errors of readings alone make of some kind (:func:`greatest_share`).
    """
    known, result = expansion.jacobian, list[Departure]()
    at_first = _values(Sums.of(expansion, known))
    for _ in range(MOST_NAMED):
        named = {*expansion.terms, *(each.kind.name for each in result)}
        before, trials = _tried(expansion, known, named, others)
        best = _best(before, usual_share, trials)
        if best is None:
            break
        (kind, periods, columns), p_value, after = best.candidate, best.p_value, best.after
        known = np.concatenate([known, columns])
        change = expansion.physical(_values(Sums.of(expansion, known))[: len(at_first)] - at_first)
        explained = float(np.sqrt(max(before - after, 0.0)))
        result.append(Departure(kind, explained, 1 - after / before, float(np.sqrt(after)), p_value, change, periods))
    return tuple(result)


def greatest_share(expansion: Expansion) -> float:
    """Of the mean square on segments left out, the share that the best of all kinds explains, chance or not."""
    before, trials = _tried(expansion, expansion.jacobian, set(expansion.terms), ())
    return max(1 - trial.after / before for trial in trials)


def _values(sums: Sums) -> FloatArray:
    """Of all columns, in their own units."""
    return sums.solved(np.arange(sums.scale.size)) / sums.scale


@dataclass(frozen=True)
class _Trial:
    """``after`` is the mean square on segments left out with the candidate's columns."""

    candidate: Candidate
    after: float
    p_value: float


def _tried(
    at: Expansion, known: FloatArray, named: set[str], others: Sequence[Candidate]
) -> tuple[float, list[_Trial]]:
    """The mean square on segments left out with the ``known`` columns, and every candidate not yet ``named``."""
    left = at.residual - _values(Sums.of(at, known)) @ known
    candidates = [each for each in (*_candidates(at, left), *_freed(at, others)) if each[0].name not in named]
    sums = Sums.of(at, np.concatenate([known, *(columns for _, _, columns in candidates)]))
    base, first, trials = np.arange(len(known)), len(known), list[_Trial]()
    looks = len(candidates) + sum(MOST_PERIODS - 1 for _, periods, _ in candidates if periods) + CHANGED * SPLITS
    for candidate in candidates:
        own = np.arange(first, first + len(candidate[2]))
        first += len(own)
        after = sums.held_out(np.concatenate([base, own]))
        trials.append(_Trial(candidate, after, min(1.0, looks * _chance(sums, base, own))))
    return sums.held_out(base), trials


def _best(before: float, usual_share: float, trials: list[_Trial]) -> _Trial | None:
    """The one that helps the most on segments left out, among those that are no chance; None: none matters."""
    least = before * min(1 / (1 + LEAST_GAIN) ** 2, 1 - usual_share)
    matter = [trial for trial in trials if trial.after < least and trial.p_value < FALSE_ALARM]
    return min(matter, key=lambda trial: trial.after, default=None)


def _chance(sums: Sums, base: IntArray, own: IntArray) -> float:
    """Of such a correlation of ``own`` columns with the residual, both freed of the ``base``, where there is none."""
    values = sums.solved(base)
    gram = sums.gram.sum(axis=0)
    explained = np.linalg.lstsq(gram[np.ix_(base, base)], gram[np.ix_(base, own)], rcond=1e-12)[0]
    left = sums.score - sums.gram[:, :, base] @ values
    return chance_of_sum((left[:, own] - left[:, base] @ explained).T)


def _candidates(at: Expansion, left: FloatArray) -> list[Candidate]:
    """Every kind with its columns (terms, n); ``left`` (n,) tells which periods a turn are worth a try."""
    kinds = (*_smooth(at), *_by_position(at, left), (CHANGE, 0, [_changed(at, left)]))
    return _freed(at, [(kind, periods, np.stack(list(columns))) for kind, periods, columns in kinds])


def _freed(at: Expansion, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Of what frictions' states after rests may have made of them."""
    return [(kind, periods, at.memory.taken_off(columns)) for kind, periods, columns in candidates]


def _smooth(at: Expansion) -> Iterator[tuple[Kind, int, list[FloatArray]]]:
    motor, velocity, friction, port = at.motor_nm, at.velocity_rad_s, at.friction, at.predicted_nm
    fast = max(_rms(velocity), 1e-300)
    time = (at.time_s - np.mean(at.time_s)) / max(float(np.ptp(at.time_s)), 1e-300)
    yield STRIBECK, 0, [friction * np.exp(-((velocity / (share * fast)) ** 2)) for share in SLOW_SHARES]
    yield ASYMMETRY, 0, [friction**2, np.abs(velocity)]
    yield LOAD, 0, [friction * np.abs(port)]
    yield SATURATION, 0, [motor * np.abs(motor), motor**3]
    yield DRAG, 0, [velocity * np.abs(velocity), velocity**3]
    for kind, signal in ((GAIN_DRIFT, motor), (DAMPING_DRIFT, velocity), (FRICTION_DRIFT, friction)):
        yield kind, 0, [signal * time, signal * time**2]
    # A motor behind a spring answers the command through a filter of more than one lag: derivatives of the torque
    # commanded. (Those of the port's torque would hold the encoder's noise, which the residual holds too.) A motor
    # behind play leaves the port without torque for a while, wherever the torque should change its sign, then jumps.
    size = max(_rms(port), 1e-300)
    yield COMPLIANCE, 0, _rates(motor, 4)
    missing = [port * np.exp(-((port / (share * size)) ** 2)) for share in REVERSED_SHARES]
    jumps = [wave for share in REVERSED_SHARES for wave in _rates(np.tanh(port / (share * size)), 2)]
    yield BACKLASH, 0, [*missing, *jumps]


def _by_position(at: Expansion, left: FloatArray) -> Iterator[tuple[Kind, int, list[FloatArray]]]:
    """The strongest whole number of periods a turn of each kind."""
    for kind, weight in (
        (RIPPLE, at.motor_nm),
        (FRICTION_BY_POSITION, at.friction),
        (POSITION, np.ones_like(at.friction)),
    ):
        periods = _strongest(at.position_rad, left * weight)
        angle = periods * at.position_rad
        yield kind, periods, [weight * np.cos(angle), weight * np.sin(angle)]


def _changed(at: Expansion, left: FloatArray) -> FloatArray:
    """Gain, inertia or a delay, other than before from some instant on: the one that ``left`` (n,) likes the best."""
    delays = range(at.basis.stop + 2, at.basis.stop + 4)
    instants = np.quantile(at.time_s, np.linspace(0.0, 1.0, SPLITS + 2)[1:-1])
    rows, order = [GAIN, INERTIA, *delays], np.argsort(at.time_s, kind="stable")
    after = np.searchsorted(at.time_s[order], instants, side="right")
    waves = at.jacobian[np.ix_(rows, order)]
    product, power = (
        np.add.reduceat(each, after, axis=1)[:, ::-1].cumsum(axis=1)[:, ::-1]
        for each in (waves * left[order], waves**2)
    )
    row, split = np.unravel_index(np.argmax(product**2 / np.maximum(power, 1e-300)), product.shape)
    return np.asarray(at.jacobian[rows[int(row)]] * (at.time_s > instants[int(split)]))


def _strongest(position_rad: FloatArray, values: FloatArray) -> int:
    """Periods a turn at which ``values`` (n,) go most with the position."""
    bins = np.floor(np.mod(position_rad / (2 * np.pi), 1.0) * BINS_A_TURN).astype(np.int64) % BINS_A_TURN
    sums = np.bincount(bins, values, BINS_A_TURN)
    return 1 + int(np.argmax(np.abs(np.fft.rfft(sums))[1 : MOST_PERIODS + 1]))


def _rates(values: FloatArray, highest: int) -> list[FloatArray]:
    """Derivatives up to the ``highest``, per tick, all smoothed alike."""
    at = np.arange(-REACH_TICKS, REACH_TICKS + 1) / WIDTH_TICKS
    window = np.exp(-0.5 * at**2)
    waves = [hermite_e.hermeval(at, [0.0] * order + [1.0]) * window for order in range(1, highest + 1)]
    return [np.convolve(values, wave - np.mean(wave), "same") for wave in waves]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
