"""Whether the bench kept time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.records import Table
from norton_bench.report.svg import MEASURED, figure

_AGES = (("port torque", "torque_age_ns"), ("actuator motion", "motion_age_ns"), ("load motion", "load_motion_age_ns"))


def timing_figure(ticks: Table) -> Figure:
    """Histograms, logarithmic in the count: how late ticks began, how long they worked, how old their signals were."""
    picture = figure(2.3)
    panels = picture.subplots(1, 3)
    _histogram(panels[0], ticks["lateness_ns"] * 1e-3, "lateness of a tick [µs]")
    _histogram(panels[1], ticks["work_ns"] * 1e-3, "work in a tick [µs]")
    ages = np.concatenate([ticks[column][ticks[column] >= 0] * 1e-3 for _, column in _AGES])
    _histogram(panels[2], ages, "age of a signal [µs]")
    panels[0].set_ylabel("ticks")
    return picture


def _histogram(axes: Axes, values: FloatArray, label: str) -> None:
    if values.size:
        top = max(float(values.max()), 1.0)
        edges = np.linspace(min(0.0, float(values.min())), top, 61)
        counts, _ = np.histogram(values, edges)
        axes.stairs(np.maximum(counts, 0.5), edges, baseline=0.5, fill=True, color=MEASURED, alpha=0.6)
        axes.set_yscale("log")
        axes.minorticks_off()
        axes.set_ylim(0.5, None)
    axes.set_xlabel(label)
