"""The pictures of the motor's claims: what was measured, and the closed form beside it."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.report.figures_network import legend
from norton_bench.report.svg import ACCENT, MEASURED, MUTED, PREDICTED, figure
from norton_bench.report.words import pretty_unit

if TYPE_CHECKING:
    from norton_bench.gallery.motor_claims import Motor

SIDES = (("from above", "v", True), ("from below", "^", False))


def one_source(motor: "Motor", command: float) -> Figure:
    """Blocked torque and free velocity, each from either side."""
    picture = figure(3.3)
    blocked, free = picture.subplots(1, 2)
    for label, marker, above in SIDES:
        table = motor.stops[above]
        torque = table[:, 0] if above else -table[:, 0]
        _points(blocked, 1e3 * table[:, 1], torque, marker, label)
        expected = motor.gain * command + (-motor.coulomb if above else motor.coulomb)
        blocked.axhline(expected, color=PREDICTED, label="Km·Ka·c ∓ τc" if above else None)
    blocked.set_xlabel("load eased by [mN·m]")
    blocked.set_ylabel("torque at rest [N·m]")
    table, from_below = motor.free
    for label, marker, above in SIDES:
        chosen = from_below != above
        _points(free, table[chosen, 2], table[chosen, 0], marker, label)
    _source(free, motor, float(table[:, 2].max()), 0.0)
    blocked.set_title("Blocked")
    free.set_title("Free")
    blocked.legend(loc="center right")
    free.legend(loc="upper left")
    return picture


def three_branches(motor: "Motor") -> Figure:
    picture = figure(3.4)
    axes = picture.subplots()
    table, _ = motor.free
    greatest = 1.05 * float(table[:, 2].max())
    _source(axes, motor, greatest, -greatest)
    for sign in (1.0, -1.0):
        _points(axes, sign * table[:, 2], sign * table[:, 0], "o", "measured" if sign > 0 else None)
        label = "τc / (Km·Ka)" if sign > 0 else None
        axes.axvline(sign * motor.coulomb / motor.gain, color=ACCENT, linestyle=(0, (4, 3)), linewidth=0.9, label=label)
    legend(axes)
    return picture


def steady_torque(motor: "Motor") -> Figure:
    picture = figure(3.2)
    axes = picture.subplots()
    speed, torque, command = motor.steady.T
    source = motor.source_rad_s(float(np.mean(command)))
    reach = np.array([0.0, 1.05 * float(speed.max())])
    axes.plot(reach, motor.damping * (source - reach), color=PREDICTED, label="B (ω_N − ω)")
    axes.axvline(source, color=ACCENT, linestyle=(0, (4, 3)), linewidth=0.9, label="ω_N")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    _points(axes, speed, torque, "o", "measured")
    axes.set_xlabel("imposed velocity [rad/s]")
    axes.set_ylabel("torque at the port [N·m]")
    legend(axes)
    return picture


def slow_approach(motor: "Motor") -> Figure:
    picture = figure(3.2)
    source_nm = motor.damping * motor.source_rad_s(motor.stop_command)
    panels = picture.subplots(1, 2)
    forms = ((True, "B ω_N", source_nm), (False, "B ω_N − 2 τc", -source_nm - 2 * motor.coulomb))
    for axes, (with_command, name, expected) in zip(panels, forms, strict=True):
        table = motor.stops[with_command]
        reach = np.array([0.0, 1.05 * float(table[:, 1].max())])
        axes.plot(1e3 * reach, motor.stopped(with_command).at(reach), color=MUTED, label="line through all")
        axes.plot([0.0], [expected], marker="s", linestyle="none", color=PREDICTED, label=name)
        _points(axes, 1e3 * table[:, 1], table[:, 0], "o", "measured")
        axes.set_title("command above +τc" if with_command else "command below −τc")
        axes.set_xlabel("load eased by [mN·m]")
        axes.set_ylabel("torque at rest [N·m]")
        axes.legend(loc="lower right")
    return picture


def _source(axes: Axes, motor: "Motor", greatest: float, least: float) -> None:
    edge = motor.coulomb / motor.gain
    command = np.array(sorted({least, greatest, edge, *((-edge, 0.0) if least < 0.0 else (0.0,))}))
    axes.plot(command, [motor.source_rad_s(each) for each in command], color=PREDICTED, label="ω_N(c)")
    axes.set_xlabel(f"command [{pretty_unit(motor.experiment.rig.command.unit)}]")
    axes.set_ylabel("steady free velocity [rad/s]")


def _points(axes: Axes, x: np.ndarray, y: np.ndarray, marker: str, label: str | None) -> None:
    hollow = "none" if marker == "v" else MEASURED
    axes.plot(
        x, y, linestyle="none", marker=marker, markersize=4.5, markerfacecolor=hollow, markeredgecolor=MEASURED,
        label=label, zorder=3,
    )  # fmt: skip
