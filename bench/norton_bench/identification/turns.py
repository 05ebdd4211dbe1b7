"""What turning does to a residual: counts that hide where a shaft turned round, torques that go with its angle."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification import loops
from norton_bench.identification.signals import FINE, Signals

# How far within its counts a turn may lie from where the smoothed path has it; the likeliest is taken.
UNKNOWN_COUNTS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
# After so many presliding lengths a contact is within a thousandth of sliding.
SLIDES_AFTER = 7.0
# Fewer rows do not tell how wide their errors are to a tenth.
FEWEST_ROWS = 50


# What an encoder's counts leave unknown of the friction after every turn, and rows whitened by it.
#
# Where within its counts the shaft turned round nobody reads, and an error there stays with the friction until the
# shaft has gone on by some presliding lengths: what is left of the torque remembers it. A Kalman filter of that one
# error, kicked at every turn, predicts each row; rows less what was predicted are white again, and least squares of
# them is the prediction-error estimate (Ljung, System Identification, ch. 7). All terms pass the same filter, so it
# cancels.
@dataclass(frozen=True)
class Turns:
    """Along some rows, (rows,) each: ``way_rad`` since the row before, ``kicks``, the variance that turns since then
    give the friction's share of the Coulomb torque, if each is known to within 1 rad, and ``near``, whether a turn is
    so near that the friction depends on where it was.
    """

    way_rad: FloatArray
    kicks: FloatArray
    near: BoolArray

    @classmethod
    def of(cls, signals: Signals, s_per_rad: float, reach_ticks: float) -> "Turns":
        """At every tick of one stretch, of which filters see ``reach_ticks`` to either side."""
        path = np.ascontiguousarray(signals.path_rad[::FINE])
        share = loops.friction_path(path, s_per_rad, np.empty(0, dtype=np.int64))[0]
        way = np.diff(path, prepend=path[0])
        # dh = s (1 - h sgn ω) dθ: an error of θ that lasts leaves what this slope changes by.
        slope = s_per_rad * (1.0 - share * np.sign(way))
        hidden_rad = UNKNOWN_COUNTS[-1] * signals.counts.width
        near = _near_turns(way, hidden_rad + SLIDES_AFTER / s_per_rad, hidden_rad, reach_ticks)
        return cls(np.abs(way), np.diff(slope, prepend=slope[0]) ** 2, near)

    def at(self, rows: npt.NDArray[np.int64]) -> "Turns":
        """At some of the ticks; what lies between counts for the next of them."""
        way, kicks = np.cumsum(self.way_rad)[rows], np.cumsum(self.kicks)[rows]
        return Turns(np.diff(way, prepend=way[:1]), np.diff(kicks, prepend=kicks[:1]), self.near[rows])

    @classmethod
    def joined(cls, parts: "Sequence[Turns]") -> "Turns":
        """One behind the other."""
        columns = zip(*((part.way_rad, part.kicks, part.near) for part in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))


def _near_turns(way_rad: FloatArray, after_rad: float, before_rad: float, reach_ticks: float) -> BoolArray:
    """At which ticks the shaft has gone less than ``after_rad`` since it turned, or will turn within ``before_rad``,
    or turns within ``reach_ticks``; (ticks,). The first and the last tick count as turns."""
    ticks, at_rad = np.arange(way_rad.size), np.cumsum(np.abs(way_rad))
    side = np.sign(way_rad)
    moving = np.flatnonzero(side)
    turns = moving[1:][np.diff(side[moving]) != 0]
    turns = np.concatenate([[0], turns, [way_rad.size - 1]])
    last, following = turns[np.searchsorted(turns, ticks, side="right") - 1], turns[np.searchsorted(turns, ticks)]
    near_in_time = np.minimum(ticks - last, following - ticks) < reach_ticks
    near_in_way = (at_rad - at_rad[last] < after_rad) | (at_rad[following] - at_rad < before_rad)
    return np.asarray(near_in_time | near_in_way)


@dataclass(frozen=True)
class Whitening:
    """The filter: what is ``kept`` of the error since the row before, its ``gain``, and the ``scale`` that makes every
    innovation as wide as the next; (rows,) each. Near turns innovations are ``wider`` by this factor. ``width`` is how
    well turns are known, see ``of_known``."""

    kept: FloatArray
    gain: FloatArray
    scale: FloatArray
    width: float
    wider: float = 1.0

    @classmethod
    def of_known(cls, turns: Turns, known_again: npt.NDArray[np.int64], s_per_rad: float, width: float) -> "Whitening":
        """By turns that are known to within a deviation of ``width``: the Coulomb torque over that of a row's noise,
        times radians. At the rows ``known_again`` the error begins anew."""
        retained = np.exp(-s_per_rad * turns.way_rad)
        retained[known_again] = 0.0
        return cls(retained, *loops.kalman_gains(retained, turns.kicks * width**2), width)

    @classmethod
    def likeliest(
        cls, turns: Turns, known_again: npt.NDArray[np.int64], s_per_rad: float, residual: FloatArray, width: float
    ) -> "Whitening":
        """That with which ``residual`` (rows,) is likeliest; here ``width`` is that of one count."""
        every = (cls.of_known(turns, known_again, s_per_rad, share * width) for share in UNKNOWN_COUNTS)
        return min(every, key=lambda each: each._unlikelihood(residual))

    def weighed(self, near: BoolArray, residual: FloatArray) -> "Whitening":
        """The same with innovations of ``residual`` as wide ``near`` turns (rows,) as elsewhere, where they are wider.

        Groupwise heteroscedasticity (Greene, Econometric Analysis, ch. 9): the path that counts leave is wrong about
        turns by more than one unknown place, and steady sliding tells damping and Coulomb friction as well.
        """
        if min(np.count_nonzero(near), np.count_nonzero(~near)) < FEWEST_ROWS:
            return self
        left = self.of(residual[None, :])[0] ** 2
        return self.weighed_by(near, max(1.0, float(np.sqrt(np.mean(left[near]) / np.mean(left[~near])))))

    def weighed_by(self, near: BoolArray, wider: float) -> "Whitening":
        """The same where they are known to be ``wider``."""
        return replace(self, scale=np.where(near, self.scale / wider, self.scale), wider=wider)

    def _unlikelihood(self, residual: FloatArray) -> float:
        power = np.mean(self.of(residual[None, :]) ** 2)
        return float(residual.size * np.log(power) - 2.0 * np.sum(np.log(self.scale)))

    def of(self, values: FloatArray) -> FloatArray:
        """The innovations of each row of ``values``, shape (k, rows)."""
        return np.asarray(loops.innovations(values, self.kept, self.gain, self.scale))

    @property
    def energy(self) -> float:
        """What is left of the squares of something quick."""
        return float(np.mean(self.scale**2))


BINS_A_TURN = 2048
FINER = 8  # than the way resolves periods
SEARCHED_PERIODS = 400.0
# A wave that returns fewer times on the way looks like what slow friction does.
FEWEST_PERIODS = 3.0
# Power over that of noise: noise alone passes it in one search of thousands, so long as residuals are nearly white.
EVIDENCE = 25.0
# A wave smaller than this share of the residual is not worth its two unknowns, however sure it is.
LEAST_SHARE = 0.1
# Nearer to an integer than the turns can resolve is that integer.
RESOLVED = 0.5


def strongest_period(
    position_rad: FloatArray, residual: FloatArray, correlated: float, weight: FloatArray | None = None
) -> float | None:
    """Torque that goes with the shaft's position: found in what nothing else explains, by its periods in a turn.

    Magnets and teeth give integers; a gear train gives any number, so the search is over all of them.

    Periods a turn of the strongest line of ``residual`` over position, both (n,); None where none stands out.

    ``correlated`` is how many neighbouring residuals count as one, ``weight`` (n,) one over their variances, relative:
    near turns an unknown place within counts may leave far more than a wave does.
    """
    first = float(np.min(position_rad))
    turns = (float(np.max(position_rad)) - first) / (2 * np.pi)
    if turns * SEARCHED_PERIODS < FEWEST_PERIODS:
        return None
    bins = ((position_rad - first) / (2 * np.pi) * BINS_A_TURN).astype(np.int64)
    weight = np.ones(residual.size) if weight is None else weight
    sums = np.bincount(bins, weight * (residual - np.average(residual, weights=weight)))
    length = 2 ** int(np.ceil(np.log2(FINER * sums.size)))
    spectrum = np.abs(np.fft.rfft(sums, length)) ** 2
    rms, amplitude = np.sqrt(np.average(residual**2, weights=weight)), 2.0 * np.sqrt(spectrum) / np.sum(weight)
    spectrum /= correlated * np.sum((weight * residual) ** 2)
    periods = np.arange(spectrum.size) * (BINS_A_TURN / length)
    slowest = max(1.0, FEWEST_PERIODS / turns)
    slower = periods < slowest - RESOLVED / turns
    searched = ~slower & (periods <= SEARCHED_PERIODS)
    best = int(np.argmax(np.where(searched, spectrum, 0.0)))
    if spectrum[best] < EVIDENCE or amplitude[best] < LEAST_SHARE * rms:
        return None
    if slowest > 1.0 and spectrum[best] < np.max(spectrum[slower]):
        return None  # a side lobe of something slower
    whole = float(np.round(periods[best]))
    return whole if abs(whole - periods[best]) < RESOLVED / turns else float(periods[best])


def is_new(periods: float, waves: Sequence[float], position_rad: FloatArray) -> bool:
    """Whether the way (n,) tells a wave of so many periods a turn from all of these."""
    turns = float(np.ptp(position_rad)) / (2 * np.pi)
    return all(abs(periods - each) * turns >= RESOLVED for each in waves)
