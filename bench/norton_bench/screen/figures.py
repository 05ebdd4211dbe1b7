"""The plots of an experiment, from its present state."""

from dataclasses import replace
from math import isfinite

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.records import NO_SEGMENT, Table
from norton_bench.report.words import number, pretty_unit
from norton_bench.screen.picture.parts import EXTERNAL
from norton_bench.screen.picture.picture import Picture
from norton_bench.screen.plots import NOTHING_YET, Markers, PlotAxis, PlotFigure, PlotTrace, prefixed

TIME = "time"
PHASE_S, FRESH_S = 20.0, 0.5
PHASE_POINTS = 4000
SOURCE_POINTS = 200
# Smaller ranges would show only noise and encoder counts.
LEAST = {"N*m": 2e-3, "rad/s": 0.2, "rad": 2e-4}
RISING, FALLING = "▴", "▾"
NEEDED_FOR_SOURCE = ("torque_gain", "viscous_damping", "coulomb_torque")


def torque(picture: Picture, window_s: float) -> PlotFigure:
    """The torque at the port."""
    figure = _over_time(picture, window_s, "Torque", "N*m", ("torque_nm",), feet=False)
    return replace(figure, empty=_why_no_torque(picture))


def velocity(picture: Picture, window_s: float, *, imposed: bool = True) -> PlotFigure:
    """The velocity of the actuator; with ``imposed`` also, dashed, the velocity that the load should follow."""
    columns = ("velocity_rad_s", "reference_velocity_rad_s") if imposed else ("velocity_rad_s",)
    return _over_time(picture, window_s, "Velocity", "rad/s", columns, feet=False)


def command(picture: Picture, window_s: float) -> PlotFigure:
    """The actuator's command as it was sent."""
    return _over_time(picture, window_s, "Command", picture.rig.command.unit, ("command",))


def torque_velocity(picture: Picture) -> PlotFigure:
    """Torque against velocity, since the segment began."""
    rows, fresh = _of_segment(picture)
    x = PlotAxis("velocity", "rad/s", LEAST["rad/s"])
    figure = _phase("Torque – velocity", x, rows["velocity_rad_s"], rows["torque_nm"], fresh)
    return replace(figure, empty=_why_no_torque(picture))


def torque_position(picture: Picture) -> PlotFigure:
    """Torque against position about its middle, since the segment began: the hysteresis."""
    rows, fresh = _of_segment(picture)
    position = rows["position_rad"]
    middle = (position.max() + position.min()) / 2 if len(position) else 0.0
    x = PlotAxis("position", "rad", LEAST["rad"])
    figure = _phase("Torque – position", x, position - middle, rows["torque_nm"], fresh)
    return replace(figure, empty=_why_no_torque(picture))


def source(picture: Picture) -> PlotFigure:
    """The motion source: a velocity for a motor, else a position."""
    return _velocities(picture) if picture.rig.modelled and not picture.tabulated.sources else _places(picture)


def _places(picture: Picture) -> PlotFigure:
    """The rest position under each command, for rising and falling commands."""
    unit, readings = picture.rig.command.unit, picture.tabulated.sources
    markers = []
    for style, sign in enumerate((RISING, FALLING)):
        chosen = [each for each in readings if each.rising is (sign == RISING)]
        command, position_rad = (
            np.array([getattr(each, column) for each in chosen]) for column in ("command", "position_rad")
        )
        markers.append(Markers(command, position_rad, sign, style))
    return PlotFigure(
        "Motion source" + (f", {readings[-1].what} port" if readings and readings[-1].what == EXTERNAL else ""),
        PlotAxis("command", unit, LEAST.get(unit, 1e-3)),
        PlotAxis("position", "rad", LEAST["rad"]),
        markers=tuple(each for each in markers if len(each.x)),
        latest=f"{RISING}{FALLING} {len(readings)} levels" if readings else "",
        empty="fills in while 'tabulate_source' runs",
    )


def _velocities(picture: Picture) -> PlotFigure:
    """Sweeps, settled levels by the side they were approached from, and the identified curve."""
    seen, unit = picture.source, picture.rig.command.unit
    rising, falling = seen.branch(rising=True), seen.branch(rising=False)
    traces = (PlotTrace(seen.cloud[:, 0], seen.cloud[:, 1], style=2, cloud=True), *_identified(picture))
    markers = (
        Markers(rising[:, 0], rising[:, 1], RISING, 0),
        Markers(falling[:, 0], falling[:, 1], FALLING, 1),
    )
    levels = len(rising) + len(falling)
    return PlotFigure(
        "Motion source",
        PlotAxis("command", unit, LEAST.get(unit, 1e-3)),
        PlotAxis("velocity", "rad/s", LEAST["rad/s"]),
        tuple(trace for trace in traces if len(trace.x)),
        tuple(each for each in markers if len(each.x)),
        f"{RISING}{FALLING} {levels} levels" if levels else "",
        empty="identified in situ, at the end" if picture.in_situ else "fills in while the step 'free' runs",
    )


def _identified(picture: Picture) -> tuple[PlotTrace, ...]:
    """The static source of the estimates, ω = (Km·Ka·c ∓ τc)/B outside the dead zone (paper, section IV.D). A velocity
    commanded is held by B and the loop's gain; a position commanded has no such source."""
    if picture.rig.holds_position:
        return ()
    values, seen = picture.known.network(), picture.source
    known = np.concatenate([seen.cloud, *seen.levels.values()]) if len(seen.cloud) else seen.cloud
    if values is None or not len(known) or any(name not in values for name in NEEDED_FOR_SOURCE):
        return ()
    gain, damping, friction = (values[name] for name in NEEDED_FOR_SOURCE)
    damping += 0.0 if picture.rig.servo is None else gain
    commands = np.linspace(known[:, 0].min(), known[:, 0].max(), SOURCE_POINTS)
    driven = gain * commands
    return (PlotTrace(commands, np.sign(driven) * np.maximum(np.abs(driven) - friction, 0) / damping, style=1),)


def _over_time(
    picture: Picture, window_s: float, title: str, unit: str, names: tuple[str, ...], *, feet: bool = True
) -> PlotFigure:
    end_s = max(picture.now_s, window_s)
    rows = picture.recent.since(picture.first_ns + round((end_s - window_s) * 1e9))
    time_s = (rows["tick_ns"] - picture.first_ns) * 1e-9
    traces = [PlotTrace(time_s, rows[name], style, dashed=style > 0) for style, name in enumerate(names)]
    seen = [trace for trace in traces if len(rows) and np.isfinite(trace.y).any()]
    return PlotFigure(
        title,
        PlotAxis(TIME, "s", 1.0, (end_s - window_s, end_s)),
        PlotAxis(title, unit, LEAST.get(unit, 1e-3)),
        tuple(seen),
        latest=_latest(float(rows[names[0]][-1]), unit) if len(rows) else "",
        growing=True,
        feet=feet,
        legend="╌ commanded" if len(seen) > 1 else "",
    )


def _latest(value: float, unit: str) -> str:
    """A value of constant width, so that the text beside it does not move."""
    if not isfinite(value):
        return "–"
    factor, shown = prefixed(abs(value), unit) if abs(value) >= 1e-3 else (1e3, f"m{pretty_unit(unit)}")
    return f"{number(value * factor, 3):>6} {shown}"


def _of_segment(picture: Picture) -> tuple[Table, int]:
    """The ticks of the running segment, thinned, and how many of them are new."""
    rows = picture.recent.since(picture.first_ns + round((picture.now_s - PHASE_S) * 1e9))
    rows = rows[rows["segment"] != NO_SEGMENT]
    if not len(rows):
        return rows, 0
    rows = rows[int(np.argmax(rows["segment"] == rows["segment"][-1])) :]
    fresh = int(np.count_nonzero(rows["tick_ns"] > rows["tick_ns"][-1] - round(FRESH_S * 1e9)))
    every = max(1, len(rows) // PHASE_POINTS)
    return rows[::-every][::-1], fresh // every


def _phase(title: str, x: PlotAxis, x_values: FloatArray, y_values: FloatArray, fresh: int) -> PlotFigure:
    cut = max(len(x_values) - fresh - 1, 0)
    traces = (PlotTrace(x_values[cut:], y_values[cut:], 0), PlotTrace(x_values[: cut + 1], y_values[: cut + 1], 2))
    return PlotFigure(
        title, x, PlotAxis("torque", "N*m", LEAST["N*m"]), tuple(t for t in traces if np.isfinite(t.y).any())
    )


def _why_no_torque(picture: Picture) -> str:
    return NOTHING_YET if picture.rig.wiring.torque_sensor is not None else "no torque sensor on this bench"
