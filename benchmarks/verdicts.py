"""Whether a figure of merit is reached, as far as so many sessions can tell: yes, no, or None for neither.

From enough sessions the figure itself decides. From fewer its interval does: where that lies on one side, chance cannot
have put it there.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import beta, chi2

ENOUGH = 30  # sessions
CHANCE = 0.05  # of an interval that does not hold what it is for
NOT_TOLD = "too few sessions to tell"
WORDS = {True: "reached", False: "not reached", None: NOT_TOLD}


@dataclass(frozen=True)
class Figure:
    """What was found, and the interval in which it would lie in a great many sessions."""

    value: float
    interval: tuple[float, float]

    def within(self, low: float, high: float, sessions: int) -> bool | None:
        """Whether it lies from ``low`` to ``high``."""
        if not np.isfinite(self.value):
            return None
        least, most = (self.value, self.value) if sessions >= ENOUGH else self.interval
        if low <= least and most <= high:
            return True
        return False if most < low or least > high else None


def rms(ratios: npt.NDArray[np.float64], among: int = 1) -> Figure:
    """Root mean square of ``ratios``, shape (n,), which are normal about zero; its interval by chi-square.

    ``among`` figures are looked at together: chance is shared between them (Bonferroni).
    """
    count = ratios.size
    if not count:
        return Figure(np.nan, (np.nan, np.nan))
    squares, tail = float(np.sum(ratios**2)), CHANCE / among / 2
    low, high = (float(np.sqrt(squares / chi2.ppf(p, count))) for p in (1.0 - tail, tail))
    return Figure(float(np.sqrt(squares / count)), (low, high))


def share(held: npt.NDArray[np.bool_]) -> Figure:
    """How many of ``held``, shape (n,), are true; its interval by the binomial distribution (Clopper and Pearson)."""
    count, hits = held.size, int(np.count_nonzero(held))
    if not count:
        return Figure(np.nan, (np.nan, np.nan))
    low = float(beta.ppf(CHANCE / 2, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - CHANCE / 2, hits + 1, count - hits)) if hits < count else 1.0
    return Figure(hits / count, (low, high))


def every(told: list[bool | None]) -> bool | None:
    """Yes where all are, no where one is not."""
    if False in told:
        return False
    return None if None in told else True
