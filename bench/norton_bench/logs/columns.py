"""What a stretch's columns mean in the equation of motion: motion, drive, and what the known load asks for.

τ = gain · drive − inertia · a − friction − offset − load        τ at the port, zero where it is free
"""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.grid import Filters, Stretch, integral, slope
from norton_bench.logs.steps import Inputs, Load, Loop


@dataclass(frozen=True)
class Motion:
    """Filtered motion of one stretch, arrays (n,)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, stretch: Stretch, filters: Filters) -> "Motion":
        """From the position or, where only velocity was logged, from that."""
        dt_s = stretch.dt_s
        if "position" in stretch.columns:
            position = filters.smooth(stretch.columns["position"])
            velocity = slope(position, dt_s)
        else:
            velocity = filters.smooth(stretch.columns["velocity"])
            position = integral(velocity, dt_s)
        return cls(position, velocity, slope(velocity, dt_s))


@dataclass(frozen=True)
class Terms:
    """One stretch at its own rate, before the decimation; arrays (n,). ``gain`` is None where it is unknown."""

    motion: Motion
    drive: FloatArray | None
    gain: float | None
    port: FloatArray | None
    load: FloatArray | None
    normal: FloatArray | None
    temperature: FloatArray | None
    sound: BoolArray

    @classmethod
    def of(cls, stretch: Stretch, column_map: ColumnMap, filters: Filters) -> "Terms":
        motion = Motion.of(stretch, filters)
        port = stretch.columns.get("exertion")
        return cls(
            motion=motion,
            drive=drive_of(stretch),
            gain=stretch.log.given("actuator", "torque_gain"),
            port=port,
            # What hangs beyond a sensor at the port is no part of the actuator.
            load=None if port is not None else _known_load(stretch, motion, translation=column_map.translation),
            normal=stretch.columns.get("normal"),
            temperature=stretch.columns.get("temperature"),
            sound=stretch.sound & enabled(stretch),
        )


def drive_of(stretch: Stretch) -> FloatArray | None:
    """The command; where the supply was logged, the command is the share of it that is switched on."""
    command = stretch.columns.get("command")
    if command is None or "supply" not in stretch.columns:
        return command
    return command * stretch.columns["supply"]


def enabled(stretch: Stretch) -> BoolArray:
    """Where the drive was on; it answers to no command elsewhere."""
    if "enabled" not in stretch.columns:
        return np.ones(len(stretch.time_s), dtype=bool)
    return np.asarray(stretch.columns["enabled"] > 0.5)


def _known_load(stretch: Stretch, motion: Motion, *, translation: bool) -> FloatArray | None:
    """Inertia and gravity of the load, which pulls a turning shaft towards its zero and a slide backwards.

    None where nothing is known of a load.
    """
    inertia, gravity = (stretch.log.given("load", key) for key in ("inertia", "gravity"))
    if inertia is None and gravity is None:
        return None
    zero = stretch.log.given("load", "gravity_zero") or 0.0
    pull = 1.0 if translation else np.sin(motion.position - zero)
    return np.asarray((inertia or 0.0) * motion.acceleration + (gravity or 0.0) * pull)


def loop_of(stretch: Stretch, *, sampled: bool) -> Loop:
    """What acts on an axis in a stretch of a log: its own loop, its drive, and the known load.

    The device's own law where the map and the log know it, or the command as logged.

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
