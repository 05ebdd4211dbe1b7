"""The motion that a fit predicts from the goal or the command alone, beside the one that was logged."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bench.identification.friction.model import Dimension, FrictionModel
from bench.identification.friction.path import Path
from bench.identification.ladder import FrictionFit
from bench.logs.column_map import ColumnMap
from bench.logs.columns import enabled
from bench.logs.equation import Problem
from bench.logs.grid import Stretch
from bench.logs.results import ErrorFigures

if TYPE_CHECKING:
    from bench.logs.motion_steps import Inputs, Law, Machine

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SPEEDS = 400
FASTEST = 4.0  # of the table of friction, over the fastest logged
# Shorter parts than this tell nothing of a simulated motion.
LEAST_SAMPLES = 50


def can_be_simulated(column_map: ColumnMap, problem: Problem, model: FrictionModel) -> bool:
    """Whether something drives the motion, its scale is known, and friction follows from velocity alone."""
    remembers = any(unknown.dimension is Dimension.DISPLACEMENT for unknown in model.unknowns)
    driven = problem.terms[0].drive is not None
    return driven and problem.scaled and not remembers and "load" not in model.name and column_map.model.inertia


def motion_errors(
    column_map: ColumnMap, problem: Problem, fit: FrictionFit, splits: list[tuple[BoolArray, BoolArray]]
) -> tuple[ErrorFigures | None, ErrorFigures | None]:
    """Of the position in training and in test; None where nothing can be simulated.

    ``splits`` are the instants of each stretch that belong to either. Every uninterrupted part starts as it was logged.
    """
    if not can_be_simulated(column_map, problem, fit.model) or not fit.value("inertia") > 0:
        return None, None
    sides = []
    for side in (0, 1):
        pieces = [
            piece
            for index, (stretch, split) in enumerate(zip(problem.stretches, splits, strict=True))
            for piece in _parts(column_map, problem, fit, index, stretch, split[side])
        ]
        sides.append(_figures(pieces, column_map.units.motion))
    return sides[0], sides[1]


def _figures(pieces: list[tuple[FloatArray, FloatArray]], unit: str) -> ErrorFigures | None:
    if not pieces:
        return None
    logged = np.concatenate([piece[0] for piece in pieces])
    error = logged - np.concatenate([piece[1] for piece in pieces])
    return ErrorFigures.of(error, float(np.std(logged)), unit) if np.isfinite(error).all() else None


def _parts(
    column_map: ColumnMap, problem: Problem, fit: FrictionFit, index: int, stretch: Stretch, chosen: BoolArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Logged and simulated position of every uninterrupted part of a stretch."""
    from bench.logs import motion_steps  # noqa: PLC0415  (compiled: slow to import)

    motion = problem.terms[index].motion
    # The filters' ends give no velocity to start with.
    chosen = chosen & (np.arange(chosen.size) >= problem.filters.margin)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    machine, law = _machine(problem, fit, stretch, translation=column_map.translation), _law(stretch)
    offset = _offset(problem, fit, index)
    for first, end in edges.reshape(-1, 2):
        if end - first < LEAST_SAMPLES:
            continue
        part = slice(int(first), int(end))
        inputs = _inputs(stretch, part, offset[part])
        start = float(motion.position[first]), float(motion.velocity[first])
        yield motion.position[part], motion_steps.simulate(machine, law, inputs, *start, stretch.dt_s)


def _machine(problem: Problem, fit: FrictionFit, stretch: Stretch, *, translation: bool) -> "Machine":
    """The fit and the known load as one axis."""
    from bench.logs.motion_steps import Machine  # noqa: PLC0415  (compiled: slow to import)

    known, log = dict(zip(fit.names, fit.values, strict=True)), stretch.log
    speed, braking = _braking(problem, fit)
    pull, zero = log.given("load", "gravity") or 0.0, log.given("load", "gravity_zero") or 0.0
    # A sensor at the port measures what the load asks for.
    loaded = "exertion" not in log.columns
    gravity = np.array([known.get("gravity_sine", 0.0), known.get("gravity_cosine", 0.0)])
    if loaded and not translation:
        gravity += pull * np.array([np.cos(zero), -np.sin(zero)])
    period = log.given("model", "cogging_period")
    return Machine(
        inertia=float(known["inertia"]) + (loaded * (log.given("load", "inertia") or 0.0)),
        gain=float(log.given("actuator", "torque_gain") or known["torque_gain"]),
        speed=speed,
        braking=braking,
        weight=pull if loaded and translation else 0.0,
        gravity=gravity,
        cogging=np.array([known.get("cogging_sine", 0.0), known.get("cogging_cosine", 0.0)]),
        cogging_wave_number=2 * np.pi / period if period else 0.0,
    )


def _braking(problem: Problem, fit: FrictionFit) -> tuple[FloatArray, FloatArray]:
    """Friction of velocity alone as a table: speeds from next to nothing on, and what brakes either way."""
    fastest = FASTEST * float(np.max(np.abs(problem.equation.path.velocity)))
    speed = fastest * np.geomspace(1e-7, 1.0, SPEEDS)
    coefficients = fit.values[len(problem.equation.names) : len(problem.equation.names) + len(fit.model.terms)]
    sides = []
    for sign in (1.0, -1.0):
        path = Path(problem.filters.dt_s, np.zeros(SPEEDS), sign * speed, np.zeros(1, dtype=np.int64))
        sides.append(sign * coefficients @ fit.model.columns(path, fit.shape))
    return speed, np.stack(sides)


def _law(stretch: Stretch) -> "Law":
    """The device's own law where the map knows it, or the command as logged."""
    from bench.logs.motion_steps import Law  # noqa: PLC0415  (compiled: slow to import)

    proportional = stretch.log.given("loop", "proportional")
    closed = proportional is not None and "goal" in stretch.columns
    limit = stretch.log.given("loop", "limit")
    derivative = stretch.log.given("loop", "derivative") or 0.0
    return Law(closed, proportional or 0.0, derivative, float("inf") if limit is None else limit)


def _offset(problem: Problem, fit: FrictionFit, index: int) -> FloatArray:
    """What brakes at any speed, at every sample of a stretch."""
    lengths = [len(stretch.time_s) for stretch in problem.stretches]
    first = sum(lengths[:index])
    offset = np.zeros(lengths[index])
    for name, column in problem.columns.items():
        if name.startswith("offset"):
            offset -= fit.value(name) * column[first : first + lengths[index]]
    return offset


def _inputs(stretch: Stretch, part: slice, offset: FloatArray) -> "Inputs":
    from bench.logs.motion_steps import Inputs  # noqa: PLC0415  (compiled: slow to import)

    nothing = np.zeros(len(stretch.time_s))
    columns = stretch.columns
    return Inputs(
        command=columns["command"][part],
        goal=columns.get("goal", nothing)[part],
        supply=(columns.get("supply", nothing + 1.0) * enabled(stretch))[part],
        port=columns.get("exertion", nothing)[part],
        offset=offset,
    )
