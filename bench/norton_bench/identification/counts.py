"""What an encoder's counts do to the friction: on average, and what they leave unknown after every turn."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.readings import REACH, unquantised
from norton_bench.identification.signals import FINE, Signals, Stream

DRAWS = 2
# The zero of such an encoder wanders at about this rate, now faster, now slower, so that what is slow meets all phases
# of the counts, and no motion that repeats itself always the same; for friction that is no motion.
WANDERS_COUNTS_S = 10.0
SWAYS_COUNTS = 3.0
NO_RESTS = np.empty(0, dtype=np.int64)


def friction_error(signals: Signals, s_per_rad: float) -> FloatArray | None:
    """What an encoder's counts do to the friction on average, found by counting the motion again.

    Friction follows every turning back, so errors of its path do not cancel: counts that are left in it make the
    shaft travel too far, smoothing that takes them out cuts its turns. One reading of the motion tells neither. But
    the smoothed path is a motion too, and known: counted once more by encoders whose counts lie elsewhere, and
    smoothed as before, it gives a friction that differs from its own about as its own, on average, differs from the
    true one (a bootstrap of the bias: of the right sign, and mostly within half of its size).

    How much too great the friction's share h is along ``path_rad``, shape (n · FINE,); None without counts.
    """
    if signals.smoothed is None or signals.count_rad == 0.0 or signals.smoothed.value.size <= 2 * REACH:
        return None
    smoothed = signals.smoothed
    own, *again = (
        loops.friction_path(path, s_per_rad, NO_RESTS)[0]
        for path in (smoothed.value, *_counted_again(smoothed, signals.count_rad))
    )
    fine_s = signals.time_s[0] + np.arange(signals.path_rad.size) * (signals.tick_s / FINE)
    return np.asarray(np.interp(fine_s, smoothed.time_s, np.mean(again, axis=0) - own))


def _counted_again(smoothed: Stream, count_rad: float) -> Iterator[FloatArray]:
    wander = WANDERS_COUNTS_S * smoothed.time_s + SWAYS_COUNTS * np.sin(smoothed.time_s)
    for draw in range(DRAWS):
        zero_rad = count_rad * (wander + draw / DRAWS)
        read_rad = np.round((smoothed.value + zero_rad) / count_rad) * count_rad
        yield unquantised(read_rad, count_rad) - zero_rad


# How far within its counts a turn may lie from where the smoothed path has it; the likeliest is taken.
UNKNOWN_COUNTS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)


@dataclass(frozen=True)
class Turns:
    """What an encoder's counts leave unknown of the friction after every turn, and rows whitened by it.

    Where within its counts the shaft turned round nobody reads, and an error there stays with the friction until
    the shaft has gone on by some presliding lengths: what is left of the torque remembers it. A Kalman filter of
    that one error, kicked at every turn, foretells each row; rows less what was foretold are white again, and least
    squares of them is the prediction-error estimate (Ljung, System Identification, ch. 7). All terms pass the same
    filter, so it cancels.

    Along some rows, (rows,) each: ``way_rad`` since the row before, and ``kicks``, the variance that turns since
    then give the friction's share of the Coulomb torque, if each is known to within 1 rad.
    """

    way_rad: FloatArray
    kicks: FloatArray

    @classmethod
    def of(cls, signals: Signals, s_per_rad: float) -> "Turns":
        """At every tick of one stretch."""
        path = np.ascontiguousarray(signals.path_rad[::FINE])
        share = loops.friction_path(path, s_per_rad, np.empty(0, dtype=np.int64))[0]
        way = np.diff(path, prepend=path[0])
        # dh = s (1 - h sgn ω) dθ: an error of θ that lasts leaves what this slope changes by.
        slope = s_per_rad * (1.0 - share * np.sign(way))
        return cls(np.abs(way), np.diff(slope, prepend=slope[0]) ** 2)

    def at(self, rows: npt.NDArray[np.int64]) -> "Turns":
        """At some of the ticks; what lies between counts for the next of them."""
        way, kicks = np.cumsum(self.way_rad)[rows], np.cumsum(self.kicks)[rows]
        return Turns(np.diff(way, prepend=way[:1]), np.diff(kicks, prepend=kicks[:1]))


@dataclass(frozen=True)
class Whitening:
    """The filter: what is ``kept`` of the error since the row before, its ``gain``, and the ``scale`` that makes every
    innovation as wide as the next; (rows,) each."""

    kept: FloatArray
    gain: FloatArray
    scale: FloatArray

    @classmethod
    def of_known(cls, turns: Turns, known_again: npt.NDArray[np.int64], s_per_rad: float, width: float) -> "Whitening":
        """By turns that are known to within a deviation of ``width``: the Coulomb torque over that of a row's noise,
        times radians. At the rows ``known_again`` the error begins anew."""
        kept = np.exp(-s_per_rad * turns.way_rad)
        kept[known_again] = 0.0
        return cls(kept, *loops.kalman_gains(kept, turns.kicks * width**2))

    @classmethod
    def likeliest(
        cls, turns: Turns, known_again: npt.NDArray[np.int64], s_per_rad: float, residual: FloatArray, width: float
    ) -> "Whitening":
        """That with which ``residual`` (rows,) is likeliest; here ``width`` is that of one count."""
        every = (cls.of_known(turns, known_again, s_per_rad, share * width) for share in UNKNOWN_COUNTS)
        return min(every, key=lambda each: each._unlikelihood(residual))

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
