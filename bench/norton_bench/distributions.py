"""Quantiles and tails of the normal, Student's t, chi-squared and F distributions.

The same numbers as scipy.stats gives, without importing it, which takes as long as the rest of a start.
"""

from math import log, pi, sqrt

import numpy as np
import numpy.typing as npt
import scipy


def normal_quantile(p: float) -> float:
    """The value that a standard normal variable stays below with probability ``p``."""
    return float(scipy.special.ndtri(p))


def normal_tail(value: float) -> float:
    """The probability that a standard normal variable is above ``value``."""
    return float(scipy.special.ndtr(-value))


def normal_hazard(value: float) -> float:
    """Density at ``value`` over the probability beyond it: finite however far out, where both vanish."""
    return float(np.exp(-0.5 * value**2 - log(sqrt(2.0 * pi)) - scipy.special.log_ndtr(-value)))


def t_quantile(p: float, freedom: float) -> float:
    """The value that Student's t with ``freedom`` degrees of freedom stays below with probability ``p``."""
    return float(scipy.special.stdtrit(freedom, p))


def chi2_quantile(p: float, freedom: float) -> float:
    """The value that chi-squared with ``freedom`` degrees of freedom stays below with probability ``p``."""
    return 2.0 * float(scipy.special.gammaincinv(0.5 * freedom, p))


def chi2_tail(value: float, freedom: float) -> float:
    """The probability that chi-squared with ``freedom`` degrees of freedom is above ``value``."""
    return float(scipy.special.chdtrc(freedom, value))


def f_tail(value: npt.ArrayLike, above: float, below: float) -> npt.NDArray[np.float64]:
    """The probability that F with so many degrees of freedom, of the numerator and of the denominator, is above
    ``value``, of any shape: 1 where that is negative."""
    return np.asarray(scipy.special.fdtrc(above, below, np.maximum(value, 0.0)))
