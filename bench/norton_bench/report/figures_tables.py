"""Figures of steps that few sessions have: tables of source and impedance, and repeated movements."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from norton_bench.identification.averages import Setting
from norton_bench.identification.exertion_table import ExertionTable, Shaken
from norton_bench.identification.impedance_along import ImpedanceAlong
from norton_bench.identification.in_situ import SourceMotion
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.trials import TrialFigures
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import ACCENT, INK, MEASURED, MUTED, PREDICTED, envelope, figure
from norton_bench.report.words import number, pretty_unit
from norton_bench.units import Units

COLOURS = (MEASURED, PREDICTED, ACCENT, INK, MUTED)
MARKERS = ("o", "s", "^", "v", "D")


def source_table_figure(table: SourceTable, units: Units) -> Figure:
    """Where the port rests against command, at each port and modulation, from both sides."""
    picture = figure(3.6)
    axes = picture.subplots()
    for place, (port, modulation) in enumerate(product(table.ports, table.modulations)):
        at = "" if modulation is None else f", {number(modulation, 3)} {pretty_unit(units.modulation)}"
        colour = COLOURS[place % len(COLOURS)]
        for rising, fill in ((True, None), (False, "none")):
            levels = table.branch(port, rising, modulation)
            axes.errorbar(
                [level.setting.command for level in levels],
                [level.position.value for level in levels],
                [level.position.half_width for level in levels],
                color=colour,
                marker="^" if rising else "v",
                markersize=4.5,
                markerfacecolor=fill or colour,
                linewidth=0.7,
                capsize=2,
                label=f"{port} port{at}, command {'rising' if rising else 'falling'}",
            )
    axes.set_xlabel(f"command [{pretty_unit(units.command)}]")
    axes.set_ylabel("where the port rests [rad]")
    axes.legend(labelcolor=INK)
    return picture


@dataclass(frozen=True)
class _Shade:
    """The colour of a setting, and its name in the legend if it is the first with this colour."""

    place: int
    label: str | None

    @property
    def colour(self) -> str:
        return COLOURS[self.place % len(COLOURS)]


def _shades(table: ExertionTable, units: Units) -> tuple[str, dict[Setting, _Shade]]:
    """What the colours distinguish: modulations where there are several, else commands; and the shade of each
    setting."""
    title, unit, key = "command", units.command, 0
    if len(table.modulations) > 1:
        title, unit, key = "modulation", units.modulation, 1
    values = sorted({setting[key] or 0.0 for setting in table.settings})
    shades, named = {}, set[float]()
    for setting in table.settings:
        value = setting[key] or 0.0
        label = None if value in named else f"{number(value, 3)} {pretty_unit(unit)}"
        named.add(value)
        shades[setting] = _Shade(values.index(value), label)
    return title, shades


def exertion_figure(table: ExertionTable, units: Units) -> Figure:
    """Torque against displacement from the source, in both directions; a colour for each command, or modulation."""
    picture = figure(3.8)
    axes = picture.subplots()
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    title, shades = _shades(table, units)
    for setting, shade in shades.items():
        for rising in (True, False):
            displacement, torque, half = table.branch(setting, rising)
            axes.errorbar(
                displacement,
                torque,
                half,
                color=shade.colour,
                marker="^" if rising else "v",
                markersize=4,
                markerfacecolor=shade.colour if rising else "none",
                linewidth=0.8,
                capsize=2,
                label=shade.label if rising else None,
            )
    for way in table.swept:
        axes.plot(*way.branch[:2], color=shades[way.setting].colour, linewidth=0.6, alpha=0.7)
    axes.set_xlabel("displacement from the source, θ − θ_N [rad]")
    axes.set_ylabel("port torque [N·m]")
    axes.legend(labelcolor=INK, title=title, title_fontsize=8.5)
    return picture


def shaken_figure(table: ExertionTable, units: Units) -> Figure:
    """Both parts of the dynamic stiffness at the source against frequency, coloured as the exertion is."""
    picture = figure(3.4)
    real, imaginary = picture.subplots(1, 2)
    title, shades = _shades(table, units)
    for setting, shade in shades.items():
        rows = at_the_source(table, setting)
        _points(real, rows, [row.stiffness_nm_rad.real for row in rows], shade)
        _points(imaginary, rows, [row.stiffness_nm_rad.imag for row in rows], shade)
    real.set_title("In phase with the displacement")
    imaginary.set_title("In phase with its velocity")
    real.set_ylabel("stiffness [N·m/rad]")
    for axes in (real, imaginary):
        axes.set_xscale("log")
        lines_hz = sorted({row.frequency_hz for row in table.shaken})
        axes.set_xticks(lines_hz, [number(line, 2) for line in lines_hz])
        axes.minorticks_off()
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_xlabel("frequency [Hz]")
        axes.axhline(0.0, color=MUTED, linewidth=0.6)
    real.legend(labelcolor=INK, title=title, title_fontsize=8.5)
    return picture


def at_the_source(table: ExertionTable, setting: Setting) -> tuple[Shaken, ...]:
    """What was measured by shaking nearest to the source of a setting, by frequency."""
    own = [row for row in table.shaken if row.setting == setting]
    if not own:
        return ()
    nearest = min(abs(row.displacement_rad) for row in own)
    chosen = [row for row in own if abs(row.displacement_rad) == nearest]
    return tuple(sorted(chosen, key=lambda row: row.frequency_hz))


def _points(axes: Axes, rows: Sequence[Shaken], values: Sequence[float], shade: _Shade) -> None:
    axes.errorbar(
        [row.frequency_hz for row in rows],
        np.array(values),
        [row.half_width_nm_rad for row in rows],
        color=shade.colour,
        marker=MARKERS[shade.place % len(MARKERS)],
        markersize=4,
        linewidth=0.8,
        capsize=2,
        label=shade.label,
    )


# Repeated movements in pictures: the torque left at the port, trial by trial, and the motion source.
def source_motion_figure(source: SourceMotion, command_unit: str) -> Figure:
    """The velocity of the motion source under its command, against time."""
    picture = figure(3.6)
    top, bottom = picture.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    time_s = np.asarray(np.arange(len(source.command)) * source.tick_s, dtype=np.float64)
    top.plot(*envelope(time_s, source.command), color=MUTED)
    top.set_ylabel(f"command [{command_unit or 'N·m'}]")
    bottom.plot(*envelope(time_s, source.velocity_rad_s), color=MEASURED)
    bottom.set_ylabel("source velocity [rad/s]")
    bottom.set_xlabel("time [s]")
    return picture


def impedance_along_figure(along: ImpedanceAlong) -> Figure:
    """Stiffness and damping along the movement, with their 95 % intervals, against time."""
    picture = figure(4.0)
    parts = (
        ("stiffness [N·m/rad]", along.stiffness_nm_rad, along.stiffness_half_nm_rad),
        ("damping [N·m·s/rad]", along.damping_nms_rad, along.damping_half_nms_rad),
    )
    both = picture.subplots(2, 1, sharex=True, height_ratios=(4, 3))
    for axes, (label, values, half) in zip(both, parts, strict=True):
        axes.fill_between(along.time_s, values - half, values + half, color=MEASURED, alpha=0.2, linewidth=0)
        axes.plot(along.time_s, values, color=MEASURED)
        axes.set_ylabel(label)
        axes.set_ylim(min(0.0, float(np.min(values - half))), max(0.0, 1.1 * float(np.max(values + half))))
    both[-1].set_xlabel("time [s]")
    return picture


def trials_figure(trials: Sequence[TrialFigures]) -> Figure:
    """Rms of the port torque in the corrected band for each trial, and its noise."""
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
