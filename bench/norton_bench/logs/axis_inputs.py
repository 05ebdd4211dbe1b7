"""What acts on an axis in a stretch of a log: its own loop, its drive, and the known load."""

import numpy as np

from norton_bench.arrays import BoolArray
from norton_bench.logs.grid import Stretch
from norton_bench.logs.steps import Inputs, Load, Loop


def enabled(stretch: Stretch) -> BoolArray:
    """Where the drive was on; it answers to no command elsewhere."""
    if "enabled" not in stretch.columns:
        return np.ones(len(stretch.time_s), dtype=bool)
    return np.asarray(stretch.columns["enabled"] > 0.5)


def loop_of(stretch: Stretch, *, sampled: bool) -> Loop:
    """The device's own law where the map and the log know it, or the command as logged.

    ``sampled`` where the log's instants are the device's own.
    """
    given = stretch.log.given
    proportional, limit = given("loop", "proportional"), given("loop", "limit")
    return Loop(
        closed=proportional is not None and "goal" in stretch.columns,
        proportional=proportional or 0.0,
        derivative=given("loop", "derivative") or 0.0,
        limit=float("inf") if limit is None else limit,
        sampled=sampled,
        switched="supply" in stretch.columns,
    )


def load_of(stretch: Stretch, *, translation: bool) -> Load:
    """Gravity pulls a turning shaft towards its zero and a slide backwards."""
    given = stretch.log.given
    inertia, gravity = given("load", "inertia") or 0.0, given("load", "gravity") or 0.0
    if translation:
        return Load(inertia, weight=gravity)
    return Load(inertia, gravity, given("load", "gravity_zero") or 0.0)


def inputs_of(stretch: Stretch) -> Inputs:
    """With nothing at the port beside the load."""
    columns, nothing = stretch.columns, np.zeros(len(stretch.time_s))
    return Inputs(
        time_s=stretch.time_s,
        goal=columns.get("goal", nothing),
        command=columns.get("command", nothing),
        supply=columns.get("supply", nothing + 1.0),
        enabled=enabled(stretch),
        port=nothing,
    )
