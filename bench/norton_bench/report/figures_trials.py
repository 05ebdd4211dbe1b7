"""Repeated movements in pictures: the torque left at the port, trial by trial, and the motion source."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from norton_bench.identification.in_situ import SourceMotion
from norton_bench.identification.trials import TrialFigures
from norton_bench.report.decimate import envelope
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, figure


def source_motion_figure(source: SourceMotion, command_unit: str) -> Figure:
    """The source's velocity under its command, against time."""
    picture = figure(3.6)
    top, bottom = picture.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    time_s = np.asarray(np.arange(len(source.command)) * source.tick_s, dtype=np.float64)
    top.plot(*envelope(time_s, source.command), color=MUTED)
    top.set_ylabel(f"command [{command_unit or 'N·m'}]")
    bottom.plot(*envelope(time_s, source.velocity_rad_s), color=MEASURED)
    bottom.set_ylabel("source velocity [rad/s]")
    bottom.set_xlabel("time [s]")
    return picture


def trials_figure(trials: Sequence[TrialFigures]) -> Figure:
    """Root mean square of the port torque in the taught band, and the noise in it."""
    picture = figure(2.8)
    axes = picture.subplots()
    numbers = [trial.number for trial in trials]
    axes.semilogy(numbers, [1e3 * trial.with_noise_nm for trial in trials], "o-", color=MEASURED, label="port torque")
    axes.semilogy(numbers, [1e3 * trial.noise_nm for trial in trials], "--", color=MUTED, label="noise floor")
    axes.set_xlabel("trial")
    axes.set_ylabel("torque, rms [mN·m]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend(axes)
    return picture
