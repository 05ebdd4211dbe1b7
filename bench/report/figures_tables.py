"""Tables of an actuator without a model, in pictures: its source, its exertion, its answer to being shaken."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.identification.tables.exertion_table import ExertionTable, Shaken
from bench.identification.tables.source_table import SourceTable
from bench.report.svg import ACCENT, INK, MEASURED, MUTED, PREDICTED, figure
from bench.report.words import number, pretty_unit

COLOURS = (MEASURED, PREDICTED, ACCENT, INK, MUTED)
MARKERS = ("o", "s", "^", "v", "D")


def source_table_figure(table: SourceTable, command_unit: str) -> Figure:
    """Where the port rests against command, at each port, from both sides."""
    picture = figure(3.6)
    axes = picture.subplots()
    for place, port in enumerate(table.ports):
        for rising, fill in ((True, None), (False, "none")):
            levels = table.branch(port, rising)
            axes.errorbar(
                [level.command for level in levels],
                [level.position.value for level in levels],
                [level.position.half_width for level in levels],
                color=COLOURS[place],
                marker="^" if rising else "v",
                markersize=4.5,
                markerfacecolor=fill or COLOURS[place],
                linewidth=0.7,
                capsize=2,
                label=f"{port} port, command {'rising' if rising else 'falling'}",
            )
    axes.set_xlabel(f"command [{pretty_unit(command_unit)}]")
    axes.set_ylabel("where the port rests [rad]")
    axes.legend(labelcolor=INK)
    return picture


def exertion_figure(table: ExertionTable, command_unit: str) -> Figure:
    """Torque against displacement from the source, a colour for each command, in both directions."""
    picture = figure(3.8)
    axes = picture.subplots()
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    for place, command in enumerate(table.commands):
        colour, label = COLOURS[place % len(COLOURS)], f"{number(command, 3)} {pretty_unit(command_unit)}"
        for rising in (True, False):
            displacement, torque, half = table.branch(command, rising)
            axes.errorbar(
                displacement,
                torque,
                half,
                color=colour,
                marker="^" if rising else "v",
                markersize=4,
                markerfacecolor=colour if rising else "none",
                linewidth=0.8,
                capsize=2,
                label=label if rising else None,
            )
    axes.set_xlabel("displacement from the source, θ − θ_N [rad]")
    axes.set_ylabel("port torque [N·m]")
    axes.legend(labelcolor=INK, title="command", title_fontsize=8.5)
    return picture


def shaken_figure(table: ExertionTable, command_unit: str) -> Figure:
    """Both parts of the dynamic stiffness at the source against frequency, a colour for each command."""
    picture = figure(3.4)
    real, imaginary = picture.subplots(1, 2)
    for place, command in enumerate(table.commands):
        rows = at_the_source(table, command)
        label = f"{number(command, 3)} {pretty_unit(command_unit)}"
        _points(real, rows, [row.stiffness_nm_rad.real for row in rows], place, label)
        _points(imaginary, rows, [row.stiffness_nm_rad.imag for row in rows], place, label)
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
    real.legend(labelcolor=INK, title="command", title_fontsize=8.5)
    return picture


def at_the_source(table: ExertionTable, command: float) -> tuple[Shaken, ...]:
    """What was measured by shaking nearest to the source of a command, by frequency."""
    own = [row for row in table.shaken if row.command == command]
    if not own:
        return ()
    nearest = min(abs(row.displacement_rad) for row in own)
    chosen = [row for row in own if abs(row.displacement_rad) == nearest]
    return tuple(sorted(chosen, key=lambda row: row.frequency_hz))


def _points(axes: Axes, rows: Sequence[Shaken], values: Sequence[float], place: int, label: str) -> None:
    axes.errorbar(
        [row.frequency_hz for row in rows],
        np.array(values),
        [row.half_width_nm_rad for row in rows],
        color=COLOURS[place % len(COLOURS)],
        marker=MARKERS[place % len(MARKERS)],
        markersize=4,
        linewidth=0.8,
        capsize=2,
        label=label,
    )
