"""The picture of the muscle's claim."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from norton_bench.report.figures_network import legend
from norton_bench.report.svg import ACCENT, MEASURED, MUTED, PREDICTED, figure

if TYPE_CHECKING:
    from norton_bench.gallery.muscle_claims import Muscle


def nonlinear_connection(muscle: "Muscle", reach_rad: float) -> Figure:
    picture = figure(3.6)
    axes = picture.subplots()
    for place, share in enumerate(muscle.shares):
        curve, first = muscle.of(share)[0], place == 0
        source = muscle.source_rad(curve.command)
        reach = source + np.linspace(-reach_rad, reach_rad, 61)
        linear = -muscle.stiffness_nm_rad(curve.command) * (reach - source)
        axes.plot(reach, linear, color=MUTED, linestyle=(0, (4, 3)), label="a linear connection" if first else None)
        axes.plot(
            curve.place_rad[::12], curve.exertion_nm[::12], linestyle="none", marker="o", markersize=3.5,
            color=MEASURED, label="measured" if first else None,
        )  # fmt: skip
        label = "K (θ_N (π − θ)²/(π − θ_N)² − θ)" if first else None
        axes.plot(reach, muscle.exertion_nm(curve.command, reach), color=PREDICTED, label=label)
        free = muscle.free_rad(share)
        label = "the free port's place" if first else None
        axes.plot(free, 0.0 * free, linestyle="none", marker="x", markersize=7, color=ACCENT, label=label, zorder=4)
        axes.annotate(f"c = {curve.command:.3g} N·m/rad", (reach[-1], linear[-1]), color=MUTED, ha="right", va="top")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_xlabel("place of the port θ [rad]")
    axes.set_ylabel("exertion [N·m]")
    legend(axes)
    return picture
