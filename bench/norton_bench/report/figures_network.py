"""Figures of the network: motion source, impedance, and the Thévenin experiment."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.identification.branches import TAILS
from norton_bench.identification.results import BlockedMap, SourceMap, Trace
from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import command_shown, drive_nm, held_nm
from norton_bench.records import Measured, SegmentInfo
from norton_bench.report.svg import ACCENT, INK, MEASURED, MUTED, PREDICTED, figure, thinned
from norton_bench.report.words import pretty_unit

_LOOP = "loop"  # names of the imposed procedure's segments
_GRID = "grid"
_WIDEST_LOOP = 12.0  # in units of the friction contact's deflection: beyond this the loop is mostly sliding
_DRAWN = 400  # samples of a loop
_GAP_STEPS = 3.0  # usual distances of two samples: more is a gap
_STEADY_SHARE = 1e-6  # greatest change of the reference velocity in a tick, as a share of its greatest value


# The impedance's samples: measured and predicted torque beside the motion that was imposed.
@dataclass(frozen=True)
class ImpedanceLoop:
    """The impedance's samples: measured and predicted torque beside the motion that was imposed.

    Arrays of shape (n,); position about its middle.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    measured_nm: FloatArray
    predicted_nm: FloatArray


def presliding_loops(measured: Measured, trace: Trace, deflection_rad: float) -> list[ImpedanceLoop]:
    """The small loops, widest first, as far as they were fitted; ``deflection_rad`` is the contact's, τc/σ0.

    Where samples are missing, one without torques stands between the others, so that no line joins them.
    """
    loops = [_loop(measured, trace, segment, parted=True) for segment in _segments(measured, _LOOP)]
    small = [loop for loop in loops if len(loop.position_rad) and _width(loop) <= _WIDEST_LOOP * deflection_rad]
    return sorted(small, key=_width, reverse=True)


def sliding_samples(measured: Measured, trace: Trace) -> ImpedanceLoop | None:
    """The steady parts of the velocity grid; None without one."""
    loops = [_steady(measured, trace, segment) for segment in _segments(measured, _GRID)]
    if not any(len(loop.velocity_rad_s) for loop in loops):
        return None
    return ImpedanceLoop(
        *(
            np.concatenate([getattr(loop, name) for loop in loops])
            for name in ("position_rad", "velocity_rad_s", "measured_nm", "predicted_nm")
        )
    )


def bench_time_s(measured: Measured, stamp_ns: npt.ArrayLike) -> FloatArray:
    """Seconds since the first tick, the time axis of every trace."""
    origin_ns = measured.ticks["tick_ns"][0] if len(measured.ticks) else 0
    return np.asarray((np.asarray(stamp_ns, dtype=np.int64) - origin_ns) * 1e-9, dtype=np.float64)


def _segments(measured: Measured, kind: str) -> list[SegmentInfo]:
    return [
        segment for segment in measured.segments if segment.procedure == "imposed" and segment.name.startswith(kind)
    ]


def _width(loop: ImpedanceLoop) -> float:
    return float(np.ptp(loop.position_rad))


def drawn_samples(loop: ImpedanceLoop) -> npt.NDArray[np.intp]:
    """Few enough for a picture, and every one that parts a line."""
    return np.union1d(thinned(len(loop.position_rad), _DRAWN), np.flatnonzero(np.isnan(loop.measured_nm)))


def _loop(measured: Measured, trace: Trace, segment: SegmentInfo, *, parted: bool = False) -> ImpedanceLoop:
    start_s, end_s = bench_time_s(measured, [segment.start_ns, segment.end_ns])
    known = np.isfinite(trace.measured) & np.isfinite(trace.predicted)
    chosen = np.flatnonzero(known & (trace.time_s >= start_s) & (trace.time_s < end_s))
    time_s = trace.time_s[chosen]
    if not len(chosen) or not len(measured.motion):
        return ImpedanceLoop(*(np.empty(0),) * 4)
    motion_s = bench_time_s(measured, measured.motion["arrival_ns"])
    position = np.interp(time_s, motion_s, measured.motion["position_rad"])
    gaps = _gaps(time_s) if parted else np.empty(0, np.intp)
    return ImpedanceLoop(
        position_rad=_with(position - (position.max() + position.min()) / 2, gaps),
        velocity_rad_s=_with(np.interp(time_s, motion_s, measured.motion["velocity_rad_s"]), gaps),
        measured_nm=np.insert(trace.measured[chosen], gaps, np.nan),
        predicted_nm=np.insert(trace.predicted[chosen], gaps, np.nan),
    )


def _gaps(time_s: FloatArray) -> npt.NDArray[np.intp]:
    """Before which samples others are missing."""
    steps_s = np.diff(time_s)
    return np.flatnonzero(steps_s > _GAP_STEPS * np.median(steps_s)) + 1 if steps_s.size else np.empty(0, np.intp)


def _with(values: FloatArray, gaps: npt.NDArray[np.intp]) -> FloatArray:
    return np.insert(values, gaps, values[gaps])


def _steady(measured: Measured, trace: Trace, segment: SegmentInfo) -> ImpedanceLoop:
    """The samples of a segment with constant reference velocity."""
    start_s, end_s = bench_time_s(measured, [segment.start_ns, segment.end_ns])
    ticks_s = bench_time_s(measured, measured.ticks["tick_ns"])
    chosen = (ticks_s >= start_s) & (ticks_s < end_s)
    wanted = measured.ticks["reference_velocity_rad_s"][chosen]
    if len(wanted) < 3 or not np.isfinite(wanted).any():
        return _loop(measured, trace, segment)
    still = np.abs(np.diff(wanted, append=wanted[-1])) <= _STEADY_SHARE * np.nanmax(np.abs(wanted))
    known = np.isfinite(trace.measured) & np.isfinite(trace.predicted)
    within = known & (trace.time_s >= start_s) & (trace.time_s < end_s)
    places = np.clip(np.searchsorted(ticks_s[chosen], trace.time_s), 0, len(still) - 1)
    masked = Trace(trace.time_s, np.where(within & still[places], trace.measured, np.nan), trace.predicted, trace.unit)
    return _loop(measured, masked, segment)


_SIDES = (("▲ rising", "^", True), ("▼ falling", "v", False))


def source_map_figure(measured: SourceMap | None, network: NortonNetwork | None, command_unit: str) -> Figure:
    """Steady free velocity against command: measured from both sides, and the identified three branches.

    Below, their difference, where both are known; there the bands are visible.
    """
    compared = measured is not None and network is not None and bool(np.isfinite(measured.velocity_rad_s).any())
    picture = figure(5.0 if compared else 3.6)
    panels = picture.subplots(1 + compared, 1, squeeze=False, sharex=True, height_ratios=(1.7, 1)[: 1 + compared])[:, 0]
    _source(panels[0], measured, network)
    if measured is not None and network is not None and compared:
        _source_difference(panels[1], measured, network)
    panels[-1].set_xlabel(f"command [{pretty_unit(command_unit) or 'N·m'}]")
    return picture


def _source(axes: Axes, measured: SourceMap | None, network: NortonNetwork | None) -> None:
    if network is not None:
        span = _span(measured, network)
        thresholds = [each for each in network.thresholds if np.isfinite(each)]
        command = np.unique(np.concatenate([np.linspace(-span, span, 201), thresholds]))
        axes.plot(command, network.source_velocity(command), color=PREDICTED, label="model", zorder=2)
        for place, threshold in enumerate(thresholds):
            label = "breaks away" if place == 0 else None
            axes.axvline(threshold, color=ACCENT, linestyle=(0, (4, 3)), linewidth=0.9, label=label)
    if measured is not None:
        for label, marker, rising in _SIDES:
            chosen = measured.rising == rising
            _points(
                axes,
                measured.command[chosen],
                measured.velocity_rad_s[chosen],
                measured.velocity_std_rad_s[chosen],
                marker,
                f"measured, {label[2:]}",
            )
    axes.set_ylabel("steady free velocity [rad/s]")
    legend(axes)


def _source_difference(axes: Axes, measured: SourceMap, network: NortonNetwork) -> None:
    """Measured less identified, with the 95 % band of each branch."""
    axes.axhline(0.0, color=PREDICTED, linewidth=0.9)
    for _, marker, rising in _SIDES:
        levels, velocity, draws = measured.branch(rising)
        order = np.argsort(levels)
        left = (velocity - network.source_velocity(levels))[order]
        colour = MEASURED if rising else MUTED
        if len(draws):
            low, high = np.quantile(draws - network.source_velocity(levels), TAILS, axis=0)[:, order]
            axes.fill_between(levels[order], low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(
            levels[order],
            left,
            color=colour,
            linewidth=0.8,
            marker=marker,
            markersize=4,
            markerfacecolor=MEASURED if rising else "none",
        )
    axes.set_ylabel("difference [rad/s]")


def blocked_figure(blocked: BlockedMap, network: NortonNetwork | None, command_unit: str) -> Figure:
    """Torque at standstill against command, by the way standstill was reached; friction allows the whole band."""
    picture = figure(3.2)
    axes = picture.subplots()
    if network is not None:
        command = np.linspace(np.nanmin(blocked.command), np.nanmax(blocked.command), 51)
        drive = drive_nm(network, command)
        backwards, forwards = held_nm(network, -1.0), held_nm(network, 1.0)
        axes.fill_between(command, drive - forwards, drive + backwards, color=PREDICTED, alpha=0.15, linewidth=0)
        axes.plot(
            command,
            drive,
            color=PREDICTED,
            linewidth=0.9,
            label="Km·Ka·c, and ± τc about it" if not network.terms else "motor's torque, and ± friction about it",
        )
    for label, marker, chosen in _histories(blocked):
        _points(
            axes,
            blocked.command[chosen],
            blocked.torque_nm[chosen],
            blocked.torque_std_nm[chosen],
            marker,
            f"measured, {label}",
        )
    axes.set_xlabel(f"command [{pretty_unit(command_unit) or 'N·m'}]")
    axes.set_ylabel("blocked torque [N·m]")
    legend(axes)
    return picture


def _histories(blocked: BlockedMap) -> list[tuple[str, str, npt.NDArray[np.bool_]]]:
    """For each way to standstill: its name, its marker, and its levels."""
    above, below = blocked.from_above, ~blocked.from_above
    every = [
        ("came to rest from above", "v", blocked.chosen("slow") & above),
        ("came to rest from below", "^", blocked.chosen("slow") & below),
        ("from above, fast", "1", blocked.chosen("fast") & above),
        ("from below, fast", "2", blocked.chosen("fast") & below),
        ("never moved", "o", blocked.chosen("rest")),
    ]
    return [each for each in every if each[2].any()]


def impedance_figure(presliding: list[ImpedanceLoop], sliding: ImpedanceLoop | None) -> Figure:
    """Torque against position before sliding, and against velocity in sliding."""
    picture = figure(3.5)
    columns = int(bool(presliding)) + int(sliding is not None)
    panels = list(picture.subplots(1, columns, squeeze=False)[0])
    if presliding:
        _presliding(panels.pop(0), presliding)
    if sliding is not None:
        _sliding(panels.pop(0), sliding)
    return picture


def _presliding(axes: Axes, loops: list[ImpedanceLoop]) -> None:
    for place, loop in enumerate(loops):
        chosen = drawn_samples(loop)
        position_mrad = 1e3 * loop.position_rad[chosen]
        first = place == 0
        axes.plot(
            position_mrad,
            loop.measured_nm[chosen],
            color=MEASURED,
            linewidth=0.8,
            alpha=0.8,
            label="measured" if first else None,
        )
        predicted_nm = loop.predicted_nm[chosen]
        axes.plot(position_mrad, predicted_nm, color=PREDICTED, label="predicted" if first else None)
    axes.set_title("Small loops")
    axes.set_xlabel("position [mrad]")
    axes.set_ylabel("port torque [N·m]")
    legend(axes)


def _sliding(axes: Axes, loop: ImpedanceLoop) -> None:
    chosen = thinned(len(loop.velocity_rad_s), 500)
    for torque_nm, colour, label, marker, size in (
        (loop.measured_nm, MEASURED, "measured", "o", 3.0),
        (loop.predicted_nm, PREDICTED, "predicted", "_", 9.0),
    ):
        axes.plot(
            loop.velocity_rad_s[chosen],
            torque_nm[chosen],
            linestyle="none",
            marker=marker,
            markersize=size,
            markeredgewidth=0.0 if marker == "o" else 1.2,
            color=colour,
            alpha=0.7,
            label=label,
        )
    axes.set_title("Steady velocities")
    axes.set_xlabel("velocity [rad/s]")
    axes.set_ylabel("port torque [N·m]")
    legend(axes)


def _points(axes: Axes, x: FloatArray, y: FloatArray, std: FloatArray, marker: str, label: str) -> None:
    axes.errorbar(
        x,
        y,
        yerr=1.96 * np.nan_to_num(std),
        fmt=marker,
        markersize=4.5,
        markerfacecolor="none" if marker == "v" else MEASURED,
        markeredgecolor=MEASURED,
        ecolor=MUTED,
        elinewidth=0.9,
        capsize=2,
        linestyle="none",
        label=label,
        zorder=3,
    )


def _span(measured: SourceMap | None, network: NortonNetwork) -> float:
    """The greatest command to draw."""
    if measured is not None and np.isfinite(measured.command).any():
        return float(np.nanmax(np.abs(measured.command)))
    return 4 / 3 * command_shown(network)


def legend(axes: Axes) -> None:
    """A legend above the panel, on its right, if there is anything to explain."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(labelcolor=INK, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
