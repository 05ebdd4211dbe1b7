"""The motion that a fit predicts from the goal or the command alone, beside the one that was logged."""

from collections.abc import Iterator

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.friction_model import FrictionModel, Path, remembers
from norton_bench.logs.axis_inputs import inputs_of, load_of, loop_of
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.equation import Problem
from norton_bench.logs.grid import Stretch
from norton_bench.logs.motion import Motion
from norton_bench.logs.results import ErrorFigures
from norton_bench.logs.steps import Axis, Inputs, Load, Motor, Table, simulate

SPEEDS = 400
FASTEST = 4.0  # of the table of friction, over the fastest logged
STEPS_A_SAMPLE = 4
# Shorter parts than this tell nothing of a simulated motion.
LEAST_SAMPLES = 50


def can_be_simulated(column_map: ColumnMap, problem: Problem, model: FrictionModel) -> bool:
    """Whether something drives the motion, its scale is known, and friction follows from velocity alone."""
    alone = "load" not in model.name and not column_map.model.temperature and int(column_map.model.gravity) <= 1
    driven = problem.terms[0].drive is not None
    # A motor that twists its joint is not driven by the load that the link carries.
    twists = problem.terms[0].link is not None and problem.terms[0].port is None
    return driven and problem.scaled and not remembers(model) and not twists and alone and column_map.model.inertia


def motion_errors(
    column_map: ColumnMap, problem: Problem, fit: FrictionFit
) -> tuple[ErrorFigures | None, ErrorFigures | None]:
    """Of the position in training and in test; None where nothing can be simulated.

    Every uninterrupted part starts as it was logged.
    """
    if not can_be_simulated(column_map, problem, fit.model) or not fit.value("inertia") > 0:
        return None, None
    sides = []
    for side in (0, 1):
        pieces = [
            piece
            for index, (stretch, split) in enumerate(zip(problem.stretches, problem.readings.splits, strict=True))
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
    # As logged: what was moved in time is no motion to start from.
    motion = Motion.of(stretch, problem.filters)
    # The filters' ends give no velocity to start with.
    chosen = chosen & (np.arange(chosen.size) >= problem.filters.margin)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    axis, loop = _axis(problem, fit, stretch), loop_of(stretch, sampled=True)
    load, inputs = _load(fit, stretch, translation=column_map.translation), _inputs(problem, fit, index)
    step_s = stretch.dt_s / STEPS_A_SAMPLE
    for first, end in edges.reshape(-1, 2):
        if end - first < LEAST_SAMPLES:
            continue
        part = slice(int(first), int(end))
        start = float(motion.position[first]), float(motion.velocity[first])
        yield (
            motion.position[part],
            simulate(axis, load, loop, inputs.part(part), *start, step_s),
        )


def _axis(problem: Problem, fit: FrictionFit, stretch: Stretch) -> Axis:
    """The fit without what pulls at its load."""
    known = dict(zip(fit.names, fit.values.tolist(), strict=True))
    period = stretch.log.given("model", "cogging_period")
    return Axis(
        inertia=known["inertia"],
        motor=Motor(stretch.log.given("actuator", "torque_gain") or known["torque_gain"]),
        table=_table(problem, fit),
        cogging=(known.get("cogging_sine", 0.0), known.get("cogging_cosine", 0.0)),
        cogging_wave_number=2 * np.pi / period if period else 0.0,
    )


def _load(fit: FrictionFit, stretch: Stretch, *, translation: bool) -> Load:
    """The known load with the gravity that was fitted; a sensor at the port measures what the known one asks for."""
    known = dict(zip(fit.names, fit.values.tolist(), strict=True))
    load = load_of(stretch, translation=translation) if "exertion" not in stretch.columns else Load(0.0)
    sine = known.get("gravity_sine", 0.0) + load.gravity * np.cos(load.gravity_zero)
    cosine = known.get("gravity_cosine", 0.0) - load.gravity * np.sin(load.gravity_zero)
    return load._replace(gravity=float(np.hypot(sine, cosine)), gravity_zero=float(np.arctan2(-cosine, sine)))


def _table(problem: Problem, fit: FrictionFit) -> Table:
    """Friction of velocity alone, from next to nothing on."""
    fastest = FASTEST * float(np.max(np.abs(problem.equation.path.velocity)))
    speeds = fastest * np.geomspace(1e-7, 1.0, SPEEDS)
    sides = []
    for sign in (1.0, -1.0):
        path = Path(problem.filters.dt_s, np.zeros(SPEEDS), sign * speeds, np.zeros(1, dtype=np.int64))
        sides.append(sign * fit.strengths @ fit.model.columns(path, fit.shape))
    return Table(speeds, np.stack(sides))


def _inputs(problem: Problem, fit: FrictionFit, index: int) -> Inputs:
    """With what was measured at the port, and what brakes at any speed."""
    stretch = problem.stretches[index]
    inputs = inputs_of(stretch)
    port = stretch.columns.get("exertion", inputs.port)
    return inputs._replace(port=port + _offset(problem, fit, index))


def _offset(problem: Problem, fit: FrictionFit, index: int) -> FloatArray:
    """What brakes at any speed, at every sample of a stretch."""
    lengths = [len(stretch.time_s) for stretch in problem.stretches]
    first = sum(lengths[:index])
    offset = np.zeros(lengths[index])
    for name, column in problem.columns.items():
        if name.startswith("offset"):
            offset -= fit.value(name) * column[first : first + lengths[index]]
    return offset
