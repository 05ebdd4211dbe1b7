"""What fits of simulated records scatter by: the deviations and biases of a real one (``bootstrap``)."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.statistics import LOOSE_BEYOND, moderated_std_of_next


@dataclass(frozen=True)
class Scatter:
    """What fits of simulated records gave, beside what was put in.

    ``drawn`` (draws, p) are the values, ``put_in`` (p,); ``stated`` (draws, p) are the variances that such fits state
    of themselves, from their residuals alone. ``left`` (draws,) is the mean square that least squares left of each,
    over what it left of the real record.
    """

    drawn: FloatArray
    put_in: FloatArray
    stated: FloatArray
    left: FloatArray

    @property
    def stated_std(self) -> FloatArray:
        """What such fits say of themselves, rms over the draws, (p,)."""
        return np.asarray(np.sqrt(np.mean(self.stated, axis=0)))

    @property
    def bias(self) -> FloatArray:
        """Mean of what comes out less what was put in, (p,)."""
        return np.asarray(np.mean(self.drawn, axis=0) - self.put_in)

    @property
    def std(self) -> FloatArray:
        """Of one fit, (p,), as wide as few draws make it; what such fits state of themselves helps out."""
        return moderated_std_of_next(self.drawn, self.stated_std)

    @property
    def bias_std(self) -> FloatArray:
        """Of the bias that is taken off, (p,). The smoothed motion is not the true one: anything between no bias and
        twice the one seen is held to be as likely, which deviates by the bias over the square root of 3; less what
        chance makes of the mean of so few draws."""
        chance = np.var(self.drawn, axis=0, ddof=1) / len(self.drawn)
        return np.asarray(np.sqrt(np.maximum(self.bias**2 - chance, 0.0) / 3.0))

    def excess(self, covariance: FloatArray) -> FloatArray:
        """How many times the residual's deviations, of ``covariance`` (p, p), are those that simulated fits state."""
        return np.asarray(np.sqrt(np.diag(covariance)) / self.stated_std)

    def applied(self, values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values without their bias, and their covariance, from those that the residual alone gives: (p,), (p, p).

        Where the real residual gives a greater deviation than simulated ones do, the model or the noise is not as was
        simulated: the difference of the squares is added.
        """
        stated = np.sqrt(np.diag(covariance))
        std = np.sqrt(self.std**2 + self._unexplained(stated**2) + self.bias_std**2)
        # A bias of such a share of the value says only that nothing is known: it widens, and is not taken off.
        credible = np.abs(self.bias) < LOOSE_BEYOND * np.abs(values)
        corrected = values - np.where(credible, self.bias, 0.0)
        return corrected, covariance * np.outer(std / stated, std / stated)

    def _unexplained(self, stated: FloatArray) -> FloatArray:
        """By how much variances that a real fit states, (p,), are greater than those of simulated ones, less what
        chance makes of the difference (the positive part of the estimator of James and Stein, 1961)."""
        more = np.maximum(stated - np.mean(self.stated, axis=0), 0.0)
        chance = np.var(self.stated, axis=0, ddof=1) * (1.0 + 1.0 / len(self.stated))
        return np.asarray(np.maximum(more - chance / np.where(more > 0.0, more, np.inf), 0.0))
