"""The picture of the claim about two ports."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, PREDICTED, figure

if TYPE_CHECKING:
    from norton_bench.gallery.gravity_claims import Arms

NAMES = {"actuator": "θ̂_N, actuator's port", "external": "θ_N, external port"}


def two_ports(arms: "Arms") -> Figure:
    picture = figure(3.4)
    axes = picture.subplots()
    for place, (port, name) in enumerate(NAMES.items()):
        style = "-" if place == 0 else (0, (4, 3))
        axes.axhline(arms.source_rad(port), color=PREDICTED, linestyle=style, label=name)
        for side, marker in (("above", "v"), ("below", "^")):
            rests = arms.rests_rad(port, side)
            rounds = np.arange(1, rests.size + 1)
            label = f"let go from {side}" if place == 0 else None
            axes.plot(
                rounds, rests, linestyle="none", marker=marker, color=MEASURED, markersize=4.5, label=label,
                markerfacecolor="none" if side == "above" else MEASURED,
            )  # fmt: skip
    axes.set_xticks(rounds)
    axes.set_xlabel("round")
    axes.set_ylabel("place of rest [rad]")
    legend(axes)
    return picture
