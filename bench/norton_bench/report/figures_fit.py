"""Figures of the fit: residuals, predictions, live estimates, and the same data without a motor model."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.residual_tests import Dependence, Memory, ResidualTests
from norton_bench.identification.results import FitResult, LiveEstimate, Trace
from norton_bench.identification.without_model import StopOperator
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME, Estimate, Status
from norton_bench.models.sliding import port_torque_nm
from norton_bench.models.terms import TERM_PARAMETERS
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.records import Table
from norton_bench.report.figures_network import ImpedanceLoop, drawn_samples, legend
from norton_bench.report.svg import ACCENT, INK, MEASURED, MUTED, PREDICTED, envelope, figure
from norton_bench.report.words import in_prefixed_unit, number, power, pretty_unit, scale_of, symbol

ZOOM_SAMPLES = 600
_COLUMNS = 4


def residual_figure(trace: Trace) -> Figure:
    """The residual over time, and its distribution."""
    picture = figure(2.3)
    over_time, spread = picture.subplots(1, 2, width_ratios=(2.4, 1))
    factor, unit = in_prefixed_unit(greatest(trace.measured - trace.predicted), trace.unit)
    residual = factor * (trace.measured - trace.predicted)
    over_time.plot(*envelope(trace.time_s, residual), color=MEASURED, linewidth=0.7)
    over_time.set_xlabel("bench time [s]")
    over_time.set_ylabel(f"residual [{unit}]")
    over_time.set_title("Over time")
    _histogram(spread, residual[np.isfinite(residual)], unit)
    return picture


def greatest(values: FloatArray) -> float:
    """The greatest magnitude, 0 where none is known."""
    finite = values[np.isfinite(values)]
    return float(np.max(np.abs(finite))) if finite.size else 0.0


def _histogram(axes: Axes, residual: FloatArray, unit: str) -> None:
    """Beside the normal distribution of the same deviation."""
    std = float(np.std(residual)) if residual.size else 0.0
    if std > 0.0:
        edges = np.linspace(-5 * std, 5 * std, 81)
        density, _ = np.histogram(residual, edges, density=True)
        axes.stairs(density, edges, color=MEASURED, fill=True, alpha=0.35)
        axes.plot(
            edges,
            np.exp(-0.5 * (edges / std) ** 2) / (std * np.sqrt(2 * np.pi)),
            color=PREDICTED,
            label="normal, same deviation",
        )
        axes.legend(labelcolor=INK, loc="upper right")
    axes.set_title("Distribution")
    axes.set_xlabel(f"residual [{unit}]")
    axes.set_yticks([])
    axes.tick_params(labelleft=False)
    axes.margins(y=0.25)


def validation_figure(trace: Trace, what: str) -> Figure:
    """Measured and predicted values: all of them, their difference, and a close-up."""
    picture = figure(5.6)
    whole, left, close = picture.subplots(3, 1, height_ratios=(1.25, 1, 1.25))
    unit = pretty_unit(trace.unit)
    _pair(whole, trace, np.arange(len(trace.time_s)))
    whole.legend(labelcolor=INK, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    residual = trace.measured - trace.predicted
    factor, small_unit = in_prefixed_unit(greatest(residual), trace.unit)
    left.plot(*envelope(trace.time_s, factor * residual), color=ACCENT, linewidth=0.7)
    left.sharex(whole)
    near = close_up(trace)
    _pair(close, trace, near)
    whole.set_ylabel(f"{what} [{unit}]")
    left.set_ylabel(f"residual [{small_unit}]")
    left.set_xlabel("bench time [s]")
    close.set_title(f"Close-up of {len(near)} samples")
    close.set_ylabel(f"{what} [{unit}]")
    close.set_xlabel("bench time [s]")
    return picture


def close_up(trace: Trace) -> npt.NDArray[np.intp]:
    """Indices of the stretch with the largest changes."""
    size = min(ZOOM_SAMPLES, len(trace.time_s))
    if not size:
        return np.empty(0, np.intp)
    power = np.concatenate([[0.0], np.cumsum(np.nan_to_num(trace.measured) ** 2)])
    start = int(np.argmax(power[size:] - power[:-size]))
    return np.arange(start, start + size)


def _pair(axes: Axes, trace: Trace, chosen: npt.NDArray[np.intp]) -> None:
    time_s = trace.time_s[chosen]
    axes.plot(*envelope(time_s, trace.measured[chosen]), color=MEASURED, linewidth=1.0, label="measured")
    axes.plot(*envelope(time_s, trace.predicted[chosen]), color=PREDICTED, linewidth=0.9, label="predicted")


def live_figure(live: Sequence[LiveEstimate | RecordedEstimates], time_s: FloatArray, fit: FitResult | None) -> Figure:
    """Each live estimate over time with its 95 % band, and the final value."""
    names = [name for name in (*BY_NAME, *TERM_PARAMETERS) if _history(live, name)]
    rows = max(1, -(-len(names) // _COLUMNS))
    picture = figure(1.7 * rows)
    panels = picture.subplots(rows, _COLUMNS, squeeze=False, sharex=True).ravel()
    final = {estimate.name: estimate for estimate in fit.estimates} if fit is not None else {}
    for axes, name in zip(panels, names, strict=False):
        _settling(axes, _history(live, name), time_s, final.get(name))
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    for axes in panels[max(0, len(names) - _COLUMNS) : len(names)]:
        axes.set_xlabel("bench time [s]")
        axes.tick_params(labelbottom=True)
    return picture


def _history(live: Sequence[LiveEstimate | RecordedEstimates], name: str) -> list[tuple[int, Estimate]]:
    """The part of the history where an estimate has a value."""
    return [
        (place, estimate)
        for place, state in enumerate(live)
        for estimate in state.estimates
        if estimate.name == name and estimate.status is not Status.UNEXCITED and np.isfinite(estimate.value)
    ]


def _settling(axes: Axes, history: list[tuple[int, Estimate]], time_s: FloatArray, final: Estimate | None) -> None:
    known = final is not None and np.isfinite(final.value)
    last = final if final is not None and known else history[-1][1]
    exponent = scale_of(last.value)
    times = time_s[[place for place, _ in history]]
    values = np.array([estimate.value for _, estimate in history]) / 10.0**exponent
    half = 1.96 * np.nan_to_num([estimate.std for _, estimate in history]) / 10.0**exponent
    axes.fill_between(times, values - half, values + half, color=MEASURED, alpha=0.2, linewidth=0)
    axes.plot(times, values, color=MEASURED)
    end = last.value / 10.0**exponent
    if known:
        axes.axhline(end, color=PREDICTED, linewidth=0.9)
    late = slice(len(values) // 3, None)
    reach = 1.3 * max(float(np.max(np.abs(values[late] - end))), float(np.max(half[late])), 0.02 * abs(end))
    axes.set_ylim(end - reach, end + reach)
    unit = f"{power(exponent)[1:]} {pretty_unit(last.unit)}".strip()
    axes.set_title(f"{symbol(last)}  [{unit or '1'}]")


def residual_tests_figure(tests: ResidualTests, unit: str = "N·m") -> Figure:
    """The tests of the residual.

    Above, autocorrelation and dependence on position; below, the correlation with each input; with the bands of noise.
    """
    picture = figure(4.6 if tests.dependences else 2.5)
    parts = picture.subfigures(
        1 + bool(tests.dependences), 1, squeeze=False, height_ratios=(1.15, 1)[-1 - bool(tests.dependences) :]
    )[:, 0]
    for part in parts:
        part.patch.set_visible(False)
    above = list(parts[0].subplots(1, 1 + (tests.memory is not None), squeeze=False)[0])
    if tests.memory is not None:
        _memory(above[0], tests.memory)
    _position(above[-1], tests, unit)
    if tests.dependences:
        below = parts[1].subplots(1, len(tests.dependences), squeeze=False, sharey=True)[0]
        for axes, each in zip(below, tests.dependences, strict=True):
            _dependence(axes, each)
        below[0].set_ylabel("correlation")
    return picture


def _memory(axes: Axes, memory: Memory) -> None:
    """Autocorrelation, and the band in which that of white noise lies with 95 %."""
    lags_ms = 1e3 * memory.lags_s
    axes.fill_between(lags_ms, -memory.band, memory.band, color=ACCENT, alpha=0.25, linewidth=0, label="noise, 95 %")
    axes.vlines(lags_ms, 0.0, memory.correlation, color=MEASURED, linewidth=1.4)
    axes.plot(lags_ms, memory.correlation, color=MEASURED, linestyle="none", marker="o", markersize=2.5)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    reach = 1.5 * max(memory.greatest, float(np.max(memory.band)))
    axes.set_ylim(-reach, reach)
    axes.set_title("Correlation with itself")
    axes.set_xlabel("later by [ms]")
    axes.set_ylabel("autocorrelation")
    axes.legend(labelcolor=INK, loc="upper right")


def _position(axes: Axes, tests: ResidualTests, unit: str) -> None:
    finite = tests.spectrum_nm[np.isfinite(tests.spectrum_nm)]
    factor, unit = in_prefixed_unit(float(np.max(finite, initial=0.0)), unit)
    periods = np.arange(1, tests.spectrum_nm.size + 1)
    axes.plot(periods, factor * tests.spectrum_nm, color=MEASURED, linewidth=0.9)
    for each in (each for each in tests.harmonics if each.periods_per_turn <= tests.spectrum_nm.size):
        axes.annotate(
            f"{each.periods_per_turn:g}",
            (each.periods_per_turn, factor * each.amplitude_nm),
            (5, -3),
            textcoords="offset points",
            color=PREDICTED,
            fontsize=8.5,
        )
    axes.set_ylim(bottom=0.0)
    axes.set_title("By position of the shaft")
    axes.set_xlabel("periods a turn")
    axes.set_ylabel(f"amplitude [{unit}]")


def _dependence(axes: Axes, dependence: Dependence) -> None:
    lags_ms = 1e3 * dependence.lags_s
    axes.fill_between(lags_ms, -dependence.band, dependence.band, color=ACCENT, alpha=0.25, linewidth=0)
    axes.plot(lags_ms, dependence.correlation, color=MEASURED, marker="o", markersize=2.5, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_title(dependence.name.capitalize())
    axes.set_xlabel("earlier by [ms]")


_AGES = (("port torque", "torque_age_ns"), ("actuator motion", "motion_age_ns"), ("load motion", "load_motion_age_ns"))


def timing_figure(ticks: Table) -> Figure:
    """The timing of the loop.

    Histograms, logarithmic in the count: how late ticks began, how long they worked, how old their signals were.
    """
    picture = figure(2.3)
    panels = picture.subplots(1, 3)
    _duration_histogram(panels[0], ticks["lateness_ns"] * 1e-3, "lateness of a tick [µs]")
    _duration_histogram(panels[1], ticks["work_ns"] * 1e-3, "work in a tick [µs]")
    ages = np.concatenate([ticks[column][ticks[column] >= 0] * 1e-3 for _, column in _AGES])
    _duration_histogram(panels[2], ages, "age of a signal [µs]")
    panels[0].set_ylabel("ticks")
    return picture


def _duration_histogram(axes: Axes, values: FloatArray, label: str) -> None:
    if values.size:
        top = max(float(values.max()), 1.0)
        edges = np.linspace(min(0.0, float(values.min())), top, 61)
        counts, _ = np.histogram(values, edges)
        axes.stairs(np.maximum(counts, 0.5), edges, baseline=0.5, fill=True, color=MEASURED, alpha=0.6)
        axes.set_yscale("log")
        axes.minorticks_off()
        axes.set_ylim(0.5, None)
    axes.set_xlabel(label)


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
            expected = port_torque_nm(network, float(command), velocity)
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
            chosen = drawn_samples(loop)
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
