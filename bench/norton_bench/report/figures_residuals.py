"""What the residual remembers and follows, in pictures."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.identification.residuals.dependence import Dependence, Memory
from norton_bench.identification.residuals.diagnosis import ResidualTests
from norton_bench.report.svg import ACCENT, INK, MEASURED, MUTED, PREDICTED, figure
from norton_bench.report.words import in_prefixed_unit


def residual_tests_figure(tests: ResidualTests, unit: str = "N·m") -> Figure:
    """Memory and position above; below, the correlation with each input, each with the band of chance."""
    picture = figure(4.6 if tests.dependences else 2.5)
    parts = picture.subfigures(
        1 + bool(tests.dependences), 1, squeeze=False, height_ratios=(1.15, 1)[-1 - bool(tests.dependences) :]
    )[:, 0]
    for part in parts:
        part.patch.set_visible(False)
    above = list(parts[0].subplots(1, 1 + (tests.memory is not None), squeeze=False)[0])
    if tests.memory is not None:
        _memory(above[0], tests.memory)
    _position(above[-1], tests, unit)
    if tests.dependences:
        below = parts[1].subplots(1, len(tests.dependences), squeeze=False, sharey=True)[0]
        for axes, each in zip(below, tests.dependences, strict=True):
            _dependence(axes, each)
        below[0].set_ylabel("correlation")
    return picture


def _memory(axes: Axes, memory: Memory) -> None:
    """Autocorrelation within the band, and where a white residual stays 95 times in 100."""
    lags_ms = 1e3 * memory.lags_s
    axes.fill_between(lags_ms, -memory.band, memory.band, color=ACCENT, alpha=0.25, linewidth=0, label="noise, 95 %")
    axes.vlines(lags_ms, 0.0, memory.correlation, color=MEASURED, linewidth=1.4)
    axes.plot(lags_ms, memory.correlation, color=MEASURED, linestyle="none", marker="o", markersize=2.5)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    reach = 1.5 * max(memory.greatest, float(np.max(memory.band)))
    axes.set_ylim(-reach, reach)
    axes.set_title("Correlation with itself")
    axes.set_xlabel("later by [ms]")
    axes.set_ylabel("autocorrelation")
    axes.legend(labelcolor=INK, loc="upper right")


def _position(axes: Axes, tests: ResidualTests, unit: str) -> None:
    finite = tests.spectrum_nm[np.isfinite(tests.spectrum_nm)]
    factor, unit = in_prefixed_unit(float(np.max(finite, initial=0.0)), unit)
    periods = np.arange(1, tests.spectrum_nm.size + 1)
    axes.plot(periods, factor * tests.spectrum_nm, color=MEASURED, linewidth=0.9)
    for each in (each for each in tests.harmonics if each.periods_per_turn <= tests.spectrum_nm.size):
        axes.annotate(
            f"{each.periods_per_turn:g}",
            (each.periods_per_turn, factor * each.amplitude_nm),
            (5, -3),
            textcoords="offset points",
            color=PREDICTED,
            fontsize=8.5,
        )
    axes.set_ylim(bottom=0.0)
    axes.set_title("By position of the shaft")
    axes.set_xlabel("periods a turn")
    axes.set_ylabel(f"amplitude [{unit}]")


def _dependence(axes: Axes, dependence: Dependence) -> None:
    lags_ms = 1e3 * dependence.lags_s
    axes.fill_between(lags_ms, -dependence.band, dependence.band, color=ACCENT, alpha=0.25, linewidth=0)
    axes.plot(lags_ms, dependence.correlation, color=MEASURED, marker="o", markersize=2.5, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_title(dependence.name.capitalize())
    axes.set_xlabel("earlier by [ms]")
