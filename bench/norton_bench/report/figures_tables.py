"""Figures of an actuator without a model: source, torque away from it, response to small vibrations."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.identification.averages import Setting
from norton_bench.identification.exertion_table import ExertionTable, Shaken
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.without_model import StopOperator
from norton_bench.models.network import NortonNetwork
from norton_bench.report.figures_network import ImpedanceLoop, legend
from norton_bench.report.svg import ACCENT, INK, MEASURED, MUTED, PREDICTED, figure, thinned
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


_MARKERS = ("o", "s", "^", "v", "D")
# Of the widest span of velocities, between the bars of neighbouring commands.
_APART = 0.015


# The impedance without a model, in pictures: the table's curves, the operator's loops and what it is made of.
def impedance_table_figure(table: ImpedanceTable, network: NortonNetwork, command_unit: str) -> Figure:
    """Torque against steady velocity, a line for each command; beside it, the difference from the network."""
    picture = figure(3.6)
    curves, left = picture.subplots(1, 2, width_ratios=(1.35, 1))
    for row, command in enumerate(table.command):
        # Side by side, or the bars of one command hide those of the next.
        shift = (row - (len(table.command) - 1) / 2) * _APART * float(np.ptp(table.velocity_rad_s))
        for side in (-1, 1):
            chosen = np.isfinite(table.torque_nm[row]) & (side * table.velocity_rad_s > 0)
            velocity, torque = table.velocity_rad_s[chosen], table.torque_nm[row, chosen]
            expected = _sliding_torque(network, float(command), velocity)
            first = row == 0 and side < 0
            curves.plot(velocity, expected, color=PREDICTED, linewidth=0.9, label="model" if first else None)
            mark = {"color": MEASURED, "marker": _MARKERS[row % len(_MARKERS)], "linestyle": "none", "markersize": 4}
            curves.plot(velocity, torque, **mark, label="measured" if first else None)
            half = np.nan_to_num(table.half_width_nm[row, chosen])
            label = _command_text(table, row, command_unit) if side < 0 else None
            difference = 1e3 * (torque - expected)
            left.errorbar(
                velocity + shift, difference, 1e3 * half, **mark, ecolor=MUTED, elinewidth=0.9, capsize=2, label=label
            )
        _name_curve(curves, table, row, _command_text(table, row, command_unit))
    left.axhline(0.0, color=PREDICTED, linewidth=0.9)
    curves.set_title("Torque at steady velocity")
    curves.set_ylabel("port torque [N·m]")
    left.set_title("Measured minus model")
    left.set_ylabel("difference [mN·m]")
    for axes in (curves, left):
        axes.set_xlabel("velocity [rad/s]")
        axes.axvline(0.0, color=MUTED, linewidth=0.6)
    curves.legend(labelcolor=INK, loc="lower left")
    left.legend(labelcolor=INK, loc="upper center", title="command", title_fontsize=8.5)
    left.margins(y=0.35)
    return picture


def _command_text(table: ImpedanceTable, row: int, command_unit: str) -> str:
    """A command as text; one that is negligible beside the others is written as 0."""
    command = float(table.command[row])
    small = abs(command) < 5e-3 * float(np.max(np.abs(table.command)))
    return f"{number(0.0 if small else command, 2)} {pretty_unit(command_unit) or 'N·m'}"


def _sliding_torque(network: NortonNetwork, command: float, velocity: FloatArray) -> FloatArray:
    """The network's torque once friction has settled."""
    return np.asarray(
        network.torque_gain * command
        - network.viscous_damping_nms_rad * velocity
        - network.coulomb_torque_nm * np.sign(velocity)
    )


def _name_curve(axes: Axes, table: ImpedanceTable, row: int, text: str) -> None:
    known = np.flatnonzero(np.isfinite(table.torque_nm[row]))
    if known.size:
        place = (table.velocity_rad_s[known[0]], table.torque_nm[row, known[0]])
        axes.annotate(text, place, (7, 3), textcoords="offset points", fontsize=8.5, color=MUTED)


def operator_figure(
    loops: list[tuple[ImpedanceLoop, ImpedanceLoop]], operator: StopOperator, deflection_rad: float
) -> Figure:
    """Small loops as measured, by the network and by the operator; and at which displacements its elements yield."""
    picture = figure(3.5)
    panels = list(picture.subplots(1, 1 + bool(loops), squeeze=False, width_ratios=(1.35, 1)[-1 - bool(loops) :])[0])
    if loops:
        _loops(panels[0], loops)
    _elements(panels[-1], operator, deflection_rad)
    return picture


def _loops(axes: Axes, loops: list[tuple[ImpedanceLoop, ImpedanceLoop]]) -> None:
    for place, (network, operator) in enumerate(loops):
        first = place == 0
        for loop, torque, colour, width, alpha, style, label in (
            (network, network.measured_nm, MEASURED, 0.8, 0.7, "-", "measured"),
            (network, network.predicted_nm, PREDICTED, 1.1, 1.0, "-", "model"),
            (operator, operator.predicted_nm, INK, 1.0, 1.0, (0, (3, 2)), "operator"),
        ):
            chosen = thinned(len(torque), 400)
            axes.plot(
                1e3 * loop.position_rad[chosen],
                torque[chosen],
                color=colour,
                linewidth=width,
                alpha=alpha,
                linestyle=style,
                label=label if first else None,
            )
    axes.set_title("Small loops")
    axes.set_xlabel("position [mrad]")
    axes.set_ylabel("port torque [N·m]")
    legend(axes)


def _elements(axes: Axes, operator: StopOperator, deflection_rad: float) -> None:
    """How much friction yields at which displacement."""
    places = np.log10(1e3 * operator.yield_rad)
    width = 0.38 * float(np.min(np.diff(places)))
    for offset, strength, colour, label in (
        (-0.5, operator.strength_nm[0], MEASURED, "all at once"),
        (0.5, operator.strength_nm[1], PREDICTED, "gradually"),
    ):
        axes.bar(places + offset * width, 1e3 * strength, width, color=colour, alpha=0.75, label=label)
    axes.axvline(np.log10(1e3 * deflection_rad), color=ACCENT, linestyle=(0, (4, 3)), linewidth=0.9, label="τc/σ0")
    decades = np.arange(np.ceil(places[0]), np.floor(places[-1]) + 1)
    axes.set_xticks(decades, [number(10.0**decade, 1) for decade in decades])
    axes.set_title("What friction is made of")
    axes.set_xlabel("yields at [mrad]")
    axes.set_ylabel("strength [mN·m]")
    axes.legend(labelcolor=INK, loc="best", title="yields", title_fontsize=8.5)
