"""Amplitudes of sines of known frequencies in readings that come at any times."""

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray


def line_amplitudes(time_s: FloatArray, values: FloatArray, omega_rad_s: FloatArray) -> tuple[ComplexArray, float]:
    """Complex amplitudes (lines,) of the real parts A exp(jωt) in ``values``, and the deviation of either part of each.

    Least squares together with a constant and a slope. The deviation is that of what is left, taken as white.
    """
    angle = np.outer(omega_rad_s, time_s)
    columns = np.vstack([np.cos(angle), -np.sin(angle), np.ones_like(time_s), time_s - np.mean(time_s)])
    solution, *_ = np.linalg.lstsq(columns.T, values, rcond=None)
    rest = values - solution @ columns
    lines = len(omega_rad_s)
    free = max(len(values) - len(solution), 1)
    deviation = float(np.sqrt(2 * np.sum(rest**2) / free / len(values)))
    return solution[:lines] + 1j * solution[lines : 2 * lines], deviation
