"""The picture of the variable spring's claim."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, PREDICTED, figure

if TYPE_CHECKING:
    from norton_bench.gallery.spring_claims import VariableSpring


def one_source_many_springs(spring: "VariableSpring", modulations: Sequence[float]) -> Figure:
    picture = figure(3.6)
    axes = picture.subplots()
    for place, modulation in enumerate(modulations):
        table = spring.of(modulation)[0]
        away, torque_nm, _ = table.curve(table.settings[0])
        reach = np.array([away[0], away[-1]])
        closed = -spring.stiffness_nm_rad(modulation) * reach
        axes.plot(reach, closed, color=PREDICTED, label="closed form" if place == 0 else None)
        label = "measured, mean of both directions" if place == 0 else None
        axes.plot(away, torque_nm, linestyle="none", marker="o", markersize=4, color=MEASURED, label=label)
        axes.annotate(f"π = {modulation:g} N·m/rad", (reach[0], closed[0]), color=MUTED, va="bottom")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    axes.margins(y=0.12)  # room for the highest label
    axes.set_xlabel("displacement from the source, θ − θ_N [rad]")
    axes.set_ylabel("exertion [N·m]")
    legend(axes)
    return picture
