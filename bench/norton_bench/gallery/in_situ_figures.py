"""The picture of the claim about actuators that stay assembled."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, PREDICTED, figure

if TYPE_CHECKING:
    from norton_bench.gallery.in_situ_claims import Assembled

SIDES = {True: "load given what it needs", False: "load left alone"}


def in_situ(assembled: "Assembled") -> Figure:
    picture = figure(3.4)
    trials, motion = picture.subplots(1, 2)
    numbers = np.arange(1, len(assembled.movements) + 1)
    rms_mnm = np.array([1e3 * np.sqrt(np.mean(each.torque_nm**2)) for each in assembled.movements])
    driven = np.array([each.driven for each in assembled.movements])
    for side, name in SIDES.items():
        chosen, face = driven == side, MEASURED if side else "none"
        trials.semilogy(
            numbers[chosen], rms_mnm[chosen], "o", color=MEASURED, markerfacecolor=face, markersize=4.5, label=name
        )
    trials.set_xlabel("trial")
    trials.set_ylabel("port torque, rms [mN·m]")
    legend(trials)
    time_s = np.arange(len(assembled.command)) * assembled.experiment.rig.tick_s
    motion.plot(time_s, assembled.alone.velocity_rad_s, color=MUTED, linewidth=0.8, label="load left alone")
    motion.plot(time_s, assembled.learnt[-1].velocity_rad_s, color=MEASURED, linewidth=1.4, label="last driven trial")
    motion.plot(time_s, assembled.source_rad_s, color=PREDICTED, linewidth=0.8, label="actuator alone")
    motion.set_xlabel("time [s]")
    motion.set_ylabel("velocity [rad/s]")
    legend(motion)
    return picture
