"""The sheet in pictures, on the page and on paper: the same drawing in other colours."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import NullFormatter

from norton_bench.arrays import FloatArray
from norton_bench.datasheet.sheet import Sheet
from norton_bench.datasheet.spectra import Transfer, contact_line, impedance_line, torque_line
from norton_bench.models.derived import backdriving_nm, interval_of, seen_to, torque_at
from norton_bench.models.drawn_motor import Motor, drawn, estimate_of
from norton_bench.report.figures_network import drawn_samples
from norton_bench.report.svg import Palette, thinned
from norton_bench.report.words import pretty_unit

Part = Figure | SubFigure

POINTS = 161
MARKERS = ("o", "^")


@dataclass(frozen=True)
class DrawnSheet:
    """One sheet in a picture: its colours, its marker and its name, which is empty where it is the only one."""

    sheet: Sheet
    line: str
    points: str
    marker: str
    name: str

    def label(self, text: str) -> str:
        return f"{text}, {self.name}" if self.name else text

    @cached_property
    def draws(self) -> Motor:
        return drawn(self.sheet.network, self.sheet.seed)

    @cached_property
    def motor(self) -> Motor:
        return estimate_of(self.sheet.network)


@dataclass(frozen=True)
class Picture:
    """``draw`` fills a figure of ``height_in`` and the page's width."""

    name: str
    title: str
    caption: str
    height_in: float
    draw: Callable[[Part, Sequence[DrawnSheet], Palette], None]


def drawings(sheets: Sequence[Sheet], palette: Palette) -> list[DrawnSheet]:
    """Alone, what was measured has a colour of its own; of two sheets each has one."""
    if len(sheets) == 1:
        return [DrawnSheet(sheets[0], palette.predicted, palette.measured, MARKERS[0], "")]
    colours = (palette.predicted, palette.measured)
    return [
        DrawnSheet(sheet, colour, colour, marker, name)
        for sheet, colour, marker, name in zip(sheets, colours, MARKERS, ("A", "B"), strict=True)
    ]


def pictures(sheets: Sequence[Sheet]) -> Iterator[Picture]:
    """Those for which the sheets have something."""
    if any(sheet.points for sheet in sheets) and not any("scale" in sheet.network.provenance for sheet in sheets):
        yield ENVELOPE
        yield BACKDRIVING
    if not any("scale" in sheet.network.provenance for sheet in sheets):
        yield BODE
        if any(sheet.evidence.loops for sheet in sheets):
            yield HYSTERESIS
        if any(sheet.points for sheet in sheets):
            yield EFFICIENCY
    if any(sheet.evidence.folded is not None for sheet in sheets):
        yield COGGING


def draw_envelope(part: Part, drawn_sheets: Sequence[DrawnSheet], palette: Palette) -> None:
    points = max((each.sheet.points for each in drawn_sheets), key=len)
    panels = np.ravel(part.subplots(1, len(points), squeeze=False))
    for place, (axes, point) in enumerate(zip(panels, points, strict=True)):
        for each in drawn_sheets:
            own = next((own for own in each.sheet.points if own.name == point.name), None)
            if own is None:
                continue
            edge = (
                own.velocity_rad_s if np.isfinite(own.velocity_rad_s) else 2 * seen_to(each.sheet.network, "velocity")
            )
            _characteristic(axes, each, own.command, edge)
            if place == 0:
                _sliding_points(axes, each, own.command)
        axes.axhline(0.0, color=palette.muted, linewidth=0.6)
        axes.set_title(point.name)
        axes.set_xlabel("velocity [rad/s]")
    panels[0].set_ylabel("torque at the port [N·m]")
    lines = panels[0].get_legend_handles_labels()
    # Above the titles: within a panel it would cover what is drawn there.
    panels[-1].legend(
        *lines, labelcolor=palette.ink, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=2.2
    )


def _characteristic(axes: Axes, each: DrawnSheet, command: float, edge_rad_s: float) -> None:
    """Torque against velocity at one command, and its 95 % band; at rest friction leaves 2·τc open."""
    seen_command, seen_velocity = (seen_to(each.sheet.network, name) for name in ("command", "velocity"))
    label: str | None = each.label(f"at {command:.3g} {pretty_unit(each.sheet.network.command_unit) or 'N·m'}")
    for side in (-1.0, 1.0):
        velocity = side * np.linspace(0.0, edge_rad_s, POINTS)
        middle = _steady(each.motor, command, velocity)[0]
        low, high = _band(_steady(each.draws, command, velocity))
        within = (np.abs(velocity) <= seen_velocity) & (command <= seen_command)
        axes.fill_between(velocity, low, high, color=each.line, alpha=0.25, linewidth=0)
        axes.plot(velocity, np.where(within, middle, np.nan), color=each.line, label=label if within.any() else None)
        label = None if within.any() else label
        axes.plot(velocity, np.where(within, np.nan, middle), color=each.line, linestyle=(0, (4, 3)), label=label)
        label = None


def _steady(motor: Motor, command: float, velocity_rad_s: FloatArray) -> FloatArray:
    """Torque at the port (draws, velocities), sliding to the side that the velocity has."""
    side = np.where(velocity_rad_s < 0.0, -1.0, 1.0)
    if np.all(velocity_rad_s <= 0.0):
        side = -np.ones_like(velocity_rad_s)
    drive, coulomb, damping = (x[:, None] for x in (motor.drive_nm(command), motor.coulomb_nm, motor.damping_nms_rad))
    return np.asarray(drive - side * coulomb - damping * velocity_rad_s)


def _sliding_points(axes: Axes, each: DrawnSheet, command: float) -> None:
    """What was measured at commands near that one; either sign, for the figure is the same turned over."""
    label: str | None = each.label("measured")
    for sliding in each.sheet.evidence.sliding:
        if abs(abs(sliding.command) - command) < 0.1 * command:
            side = np.sign(sliding.command)
            some = thinned(len(sliding.samples.velocity_rad_s), 120)
            velocity, torque = sliding.samples.velocity_rad_s[some], sliding.samples.measured_nm[some]
            _scatter(axes, side * velocity, side * torque, each, label)
            label = None


def draw_backdriving(part: Part, drawn_sheets: Sequence[DrawnSheet], palette: Palette) -> None:
    axes = part.subplots()
    for each in drawn_sheets:
        prediction = each.sheet.network.prediction
        velocity = np.linspace(0.0, seen_to(each.sheet.network, "velocity"), POINTS)
        middle = backdriving_nm(each.motor, 0.0) + each.motor.damping_nms_rad * velocity
        low, high = _band(each.draws.coulomb_nm[:, None] + each.draws.damping_nms_rad[:, None] * velocity)
        if prediction is not None and np.isfinite(prediction.torque_nm):
            off = prediction.torque_nm
            label = each.label("± prediction error")
            axes.fill_between(
                velocity, middle - off, middle + off, color=each.line, alpha=0.1, linewidth=0, label=label
            )
        axes.fill_between(velocity, low, high, color=each.line, alpha=0.3, linewidth=0)
        axes.plot(velocity, middle, color=each.line, label=each.label("τc + B·ω"))
        _idle_points(axes, each)
    axes.set_xlabel("velocity [rad/s]")
    axes.set_ylabel("backdriving torque [N·m]")
    axes.set_ylim(bottom=0.0)
    _legend(axes, palette)


def _idle_points(axes: Axes, each: DrawnSheet) -> None:
    idle = min(each.sheet.evidence.sliding, key=lambda sliding: abs(sliding.command), default=None)
    # A command that is not nearly none would have to be taken off by the network itself.
    if idle is None or abs(idle.command) > 0.05 * each.sheet.network.thresholds[1]:
        return
    some = thinned(len(idle.samples.velocity_rad_s), 250)
    velocity = idle.samples.velocity_rad_s[some]
    _scatter(axes, np.abs(velocity), -np.sign(velocity) * idle.samples.measured_nm[some], each, each.label("measured"))


def draw_bode(part: Part, drawn_sheets: Sequence[DrawnSheet], palette: Palette) -> None:
    panels = part.subplots(3, 2, sharex="col", height_ratios=(2.0, 1.2, 0.8))
    units = {pretty_unit(each.sheet.network.command_unit) or "N·m" for each in drawn_sheets}
    static: list[float] = []
    for each in drawn_sheets:
        # Commands of different units are compared by what becomes of each at rest.
        gain = 1.0 if len(units) == 1 else abs(each.sheet.network.torque_gain)
        _torque_path(panels[:, 0], each, gain)
        _impedance(panels[:, 1], each)
        static.append(abs(each.sheet.network.torque_gain) / gain)
    unit = f" [N·m/({units.pop()})]" if len(units) == 1 else ",\nover that at rest"
    panels[0, 0].set_ylabel("torque/command" + ("" if unit == " [N·m/(N·m)]" else unit))
    panels[0, 1].set_ylabel("torque/velocity\n[N·m·s/rad]")
    for axes in panels[1]:
        axes.set_ylabel("phase [°]")
    for axes in panels[2]:
        axes.set_ylabel("coherence")
        axes.set_ylim(0.0, 1.05)
        axes.set_xlabel("frequency [Hz]")
    for axes in np.ravel(panels):
        axes.set_xscale("log")
    for axes in panels[0]:
        axes.set_yscale("log")
        axes.yaxis.set_minor_formatter(NullFormatter())
        _legend(axes, palette)
    # As far down as is of interest; noisy points do not stretch the picture.
    panels[0, 0].set_ylim(min(static) / 12, 3 * max(static))


def _torque_path(panels: npt.NDArray[Any], each: DrawnSheet, gain: float) -> None:
    network, spectra = each.sheet.network, each.sheet.evidence.spectra
    frequency = _frequencies(each.sheet)
    if _knows_bandwidth(each.sheet):
        _bode_line(panels, frequency, torque_line(network, frequency) / gain, each, each.label("network"))
    if spectra is not None:
        path = spectra.torque
        scaled = replace(path, response=path.response / gain, half_width=path.half_width / gain)
        _bode_points(panels, scaled, each)


def _impedance(panels: npt.NDArray[Any], each: DrawnSheet) -> None:
    network, spectra = each.sheet.network, each.sheet.evidence.spectra
    frequency = _frequencies(each.sheet)
    if spectra is not None:
        sliding = impedance_line(network, frequency, spectra.velocity_rms_rad_s)
        label = each.label(f"sliding, {spectra.velocity_rms_rad_s:.2g} rad/s rms")
        _bode_line(panels, frequency, sliding, each, label)
        _bode_points(panels, spectra.impedance, each)
    contact = contact_line(network, frequency)
    _bode_line(panels, frequency, contact, each, each.label("not sliding"), linestyle=(0, (1, 1.5)))


def _frequencies(sheet: Sheet) -> FloatArray:
    """Up to three times the amplifier's bandwidth, where that is known."""
    bandwidth_hz = sheet.network.amplifier_bandwidth_rad_s / (2 * np.pi) if _knows_bandwidth(sheet) else 0.0
    return np.geomspace(1.0, max(100.0, 3 * bandwidth_hz), POINTS)


def _knows_bandwidth(sheet: Sheet) -> bool:
    return all(each.settled for each in sheet.parameters if each.name == "amplifier_bandwidth")


def _bode_line(
    panels: npt.NDArray[Any],
    frequency_hz: FloatArray,
    response: npt.NDArray[np.complex128],
    each: DrawnSheet,
    label: str,
    **how: Any,
) -> None:
    panels[0].plot(frequency_hz, np.abs(response), color=each.line, label=label, **how)
    panels[1].plot(frequency_hz, np.degrees(np.angle(response)), color=each.line, **how)


def _bode_points(panels: npt.NDArray[Any], path: Transfer, each: DrawnSheet) -> None:
    magnitude = np.abs(path.response)
    looks: Any = {"color": each.points, "marker": each.marker, "markersize": 2.6, "linestyle": "none"}
    lower = np.minimum(path.half_width, 0.95 * magnitude)  # a logarithmic axis has no zero
    panels[0].errorbar(
        path.frequency_hz,
        magnitude,
        yerr=(lower, path.half_width),
        elinewidth=0.6,
        label=each.label("measured"),
        **looks,
    )
    panels[1].plot(path.frequency_hz, np.degrees(np.angle(path.response)), **looks)
    panels[2].plot(path.frequency_hz, path.coherence, **looks)


def draw_hysteresis(part: Part, drawn_sheets: Sequence[DrawnSheet], palette: Palette) -> None:
    axes = part.subplots()
    for each in drawn_sheets:
        for place, loop in enumerate(each.sheet.evidence.loops):
            some = drawn_samples(loop)
            x_mrad = 1e3 * loop.position_rad[some]
            measured, network = (each.label(text) if not place else None for text in ("measured", "network"))
            axes.plot(x_mrad, loop.measured_nm[some], color=each.points, linewidth=0.7, alpha=0.7, label=measured)
            if not each.name:
                axes.plot(x_mrad, loop.predicted_nm[some], color=each.line, linewidth=0.9, label=network)
    axes.set_xlabel("position about the middle [mrad]")
    axes.set_ylabel("torque at the port [N·m]")
    _legend(axes, palette)


def draw_efficiency(part: Part, drawn_sheets: Sequence[DrawnSheet], palette: Palette) -> None:
    axes, highest = part.subplots(), 0.0
    for each, dashes in zip(drawn_sheets, ("solid", "dashed"), strict=False):
        if not each.sheet.points:
            continue
        network, point = each.sheet.network, each.sheet.points[0]
        velocity = np.linspace(0.0, point.velocity_rad_s, 81)[1:]
        motor = estimate_of(network)
        driven = float(motor.drive_nm(point.command)[0])
        torque = np.linspace(0.0, driven, 81)[1:]
        across, up = np.meshgrid(velocity, torque)
        lost = motor.resistance_nm(across) + motor.load_friction * up
        reached = up + lost <= driven
        percent = np.where(reached, 100 * up / (up + lost), np.nan)
        lines = axes.contour(across, up, percent, levels=np.arange(10, 100, 10), colors=each.line, linestyles=dashes)
        axes.clabel(lines, fmt=lambda level: f"{level:.0f} %", fontsize=7.5, colors=palette.ink)
        limit = torque_at(motor, point.command, velocity)
        edge = float(torque_at(motor, point.command, np.zeros(1))[0])
        axes.plot(velocity, np.where(limit > 0, limit, np.nan), color=palette.muted, linestyle=dashes, linewidth=1.0)
        highest = max(highest, 1.05 * edge)
    axes.set_xlabel("velocity [rad/s]")
    axes.set_ylabel("torque at the port [N·m]")
    axes.set_ylim(0.0, highest if highest > 0.0 else None)
    axes.set_xlim(left=0.0)


def draw_cogging(part: Part, drawn_sheets: Sequence[DrawnSheet], palette: Palette) -> None:
    left, right = part.subplots(1, 2)
    for each in drawn_sheets:
        evidence = each.sheet.evidence
        if evidence.folded is None:
            continue
        order = np.arange(1, evidence.order_nm.size + 1)
        left.plot(order, 1e3 * evidence.order_nm, color=palette.muted, linewidth=0.8)
        for place, line in enumerate(line for line in evidence.orders if line.is_torque):
            wave = line.cogging_nm
            left.errorbar(
                [line.periods_per_turn], [1e3 * wave.amplitude], yerr=[1e3 * wave.half_width], color=each.points,
                marker=each.marker, markersize=4.5, label=None if place else each.label("stands out"), linestyle="none",
            )  # fmt: skip
        angle = np.degrees(evidence.folded.angle_rad)
        label = each.label(f"order {evidence.orders[0].periods_per_turn:g}")
        right.errorbar(
            angle, 1e3 * evidence.folded.mean_nm, yerr=1e3 * evidence.folded.half_width_nm, color=each.points,
            elinewidth=0.6, marker=each.marker, markersize=2.6, linewidth=0.6, label=label,
        )  # fmt: skip
    left.set_xlabel("periods a turn")
    left.set_ylabel("amplitude [mN·m]")
    right.set_xlabel("angle within one period [°]")
    right.set_ylabel("torque [mN·m]")
    _legend(left, palette)
    _legend(right, palette)


def _band(draws: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The 95 % band of draws (draws, n)."""
    ends = np.array([interval_of(column) for column in draws.T])
    return ends[:, 0], ends[:, 1]


def _scatter(axes: Axes, x: FloatArray, y: FloatArray, each: DrawnSheet, label: str | None) -> None:
    axes.plot(
        x, y, linestyle="none", marker=each.marker, markersize=2.6, markeredgewidth=0, color=each.points, alpha=0.6,
        label=label, zorder=1.5,
    )  # fmt: skip


def _legend(axes: Axes, palette: Palette) -> None:
    if axes.get_legend_handles_labels()[1]:
        axes.legend(labelcolor=palette.ink, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


ENVELOPE = Picture(
    "envelope", "Torque and speed",
    "Steady torque at the port against velocity at the greatest command, driven (right of 0) and turned back against "
    "it (left): at rest friction leaves 2·τc open. Bands are 95 % intervals; dashed where the network was not seen to "
    "hold. The same, mirrored, holds for the opposite command.", 3.3, draw_envelope,
)  # fmt: skip
BACKDRIVING = Picture(
    "backdriving", "Backdriving torque",
    "What turns the shaft steadily from outside, without a command, as far as velocity was seen. Dark: 95 % interval "
    "of the network's friction; light: error of a torque predicted for one instant, cogging included.", 3.0,
    draw_backdriving,
)  # fmt: skip
BODE = Picture(
    "bode", "Torque bandwidth and impedance",
    "Left: torque over command, the port held. Right: torque that a motion of the port takes, over its velocity, "
    "without a command. Points are estimated from the imposed multisines without a model, with their 95 % intervals, "
    "where they stand out from chance; coherence is the share of the torque at that frequency that goes with this "
    "input. While sliding, friction acts as a damping that depends on the speed.", 5.6, draw_bode,
)  # fmt: skip
HYSTERESIS = Picture(
    "hysteresis", "Hysteresis at the port",
    "Torque while the port is moved to and fro a little, without a command: first the friction contact gives way as a "
    "spring, then it slides.", 3.2, draw_hysteresis,
)  # fmt: skip
EFFICIENCY = Picture(
    "efficiency", "Mechanical efficiency",
    "Power at the port over the power of the motor's torque, while it drives: friction's losses alone, from the "
    "network. The outer line is the greatest command that was given.", 3.2, draw_efficiency,
)  # fmt: skip
COGGING = Picture(
    "cogging", "Cogging and ripple",
    "What goes with the shaft's angle, of the torque that the network leaves. Left: amplitude by order; what stands "
    "out has its 95 % interval. Right: over one period of the strongest order.", 3.0, draw_cogging,
)  # fmt: skip
