"""A repeated movement in a picture: the torque left at the port, trial by trial."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bench.identification.trials import TrialFigures
from bench.report.figures_network import legend
from bench.report.svg import MEASURED, MUTED, figure


def trials_figure(trials: Sequence[TrialFigures]) -> Figure:
    """Root mean square of the port torque in the taught band, and the noise in it."""
    picture = figure(2.8)
    axes = picture.subplots()
    numbers = [trial.number for trial in trials]
    axes.semilogy(
        numbers, [1e3 * trial.with_noise_nm for trial in trials], "o-", color=MEASURED, label="port torque, as read"
    )
    axes.semilogy(numbers, [1e3 * trial.noise_nm for trial in trials], "--", color=MUTED, label="noise alone")
    axes.set_xlabel("trial")
    axes.set_ylabel("torque, rms [mN·m]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend(axes)
    return picture
