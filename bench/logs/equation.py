"""All stretches as one equation in which friction, and what else is not known, is to be found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from bench.errors import ExperimentError
from bench.identification.friction.path import Path
from bench.identification.ladder import Equation, blocked_folds
from bench.logs.column_map import ColumnMap
from bench.logs.columns import Terms
from bench.logs.filters import Filters
from bench.logs.grid import Stretch

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LEAST_ROWS = 30


@dataclass(frozen=True)
class Problem:
    """The equation of a log, and what its rows are.

    ``known`` is the target and ``columns`` the others, at the samples' own rate. ``exertion`` (n,) is what the actuator
    exerts, where anything measures it or a known gain gives it, else what the known load asks for, else the drive:
    errors are relative to it. ``scaled`` says whether anything fixes the scale of exertion. ``pick`` (n,) are the rows'
    samples among all stretches joined; ``train`` and ``test`` (n,) the split.
    """

    equation: Equation
    known: FloatArray
    exertion: FloatArray
    scaled: bool
    pick: IntArray
    train: BoolArray
    test: BoolArray
    columns: Mapping[str, FloatArray]
    terms: tuple[Terms, ...]
    filters: Filters
    stretches: tuple[Stretch, ...]


def make_problem(
    column_map: ColumnMap,
    parts: Sequence[Stretch],
    splits: Sequence[tuple[BoolArray, BoolArray]],
) -> Problem:
    """``splits`` are the instants of each stretch to train and to test on.

    Raises ExperimentError where nothing is left to learn from.
    """
    filters = Filters.of(parts[0].dt_s, column_map.filter.cutoff_hz, column_map.filter.rate_hz)
    terms = tuple(Terms.of(part, column_map, filters) for part in parts)
    lengths = [len(part.time_s) for part in parts]
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    sound = np.concatenate([_settled(term.sound, filters.margin) for term in terms])
    offsets = [np.arange(0, length, filters.factor) for length in lengths]
    places = np.concatenate([start + offset for start, offset in zip(starts, offsets, strict=False)])
    pick = places[sound[places]]
    train, test = (np.concatenate([split[side] for split in splits])[pick] for side in (0, 1))
    if np.count_nonzero(train) < LEAST_ROWS:
        raise ExperimentError(
            f"{parts[0].log.place}: {np.count_nonzero(train)} rows are left to learn from, {LEAST_ROWS} are the least; "
            "use a longer log, a wider --train, or a higher [filter] rate"
        )

    def process(rows: FloatArray) -> FloatArray:
        """The filter that the target has passed too, stretch by stretch."""
        pieces = [filters.anti_alias(rows[:, a:b]) for a, b in pairwise(starts)]
        return np.asarray(np.concatenate(pieces, axis=1)[:, pick])

    scaled = any(terms[0].__dict__[name] is not None for name in ("port", "gain", "load"))
    columns = _others(column_map, parts, terms, scaled=scaled)
    target, exertion = _known(terms, scaled=scaled)
    time_s = np.concatenate([part.time_s for part in parts])[pick]
    equation = Equation(
        target=process(target[None, :])[0],
        others=process(np.stack(list(columns.values()))),
        names=tuple(columns),
        path=_path(parts, terms, starts[:-1]),
        fold=_folds(train),
        time_s=_running(time_s),
        process=process,
    )
    return Problem(
        equation=equation,
        known=target,
        exertion=process(exertion[None, :])[0],
        scaled=scaled,
        pick=pick,
        train=train,
        test=test,
        columns=columns,
        terms=terms,
        filters=filters,
        stretches=tuple(parts),
    )


def _settled(sound: BoolArray, margin: int) -> BoolArray:
    """Where nothing unsound, and no end of the stretch, lies within ``margin`` samples."""
    count = np.concatenate([[0], np.cumsum(~sound)])
    at = np.arange(len(sound))
    low, high = at - margin, at + margin + 1
    inside = (low >= 0) & (high <= len(sound))
    spoilt = count[np.clip(high, 0, len(sound))] > count[np.clip(low, 0, len(sound))]
    return np.asarray(inside & ~spoilt)


def _folds(train: BoolArray) -> IntArray:
    """Blocks of the rows trained on take turns; the others are in no fold."""
    fold = np.full(train.size, -1, dtype=np.int64)
    fold[train] = blocked_folds(int(np.count_nonzero(train)))
    return fold


def _running(time_s: FloatArray) -> FloatArray:
    """Time that goes on where the next log begins again."""
    steps = np.diff(time_s, prepend=time_s[0])
    steps[steps < 0] = 0.0
    return np.asarray(np.cumsum(steps))


def _joined(terms: Sequence[Terms], name: str) -> FloatArray | None:
    values = [getattr(term, name) for term in terms]
    return None if values[0] is None else np.concatenate(values)


def _path(parts: Sequence[Stretch], terms: Sequence[Terms], starts: IntArray) -> Path:
    return Path(
        dt_s=parts[0].dt_s,
        position=np.concatenate([term.motion.position for term in terms]),
        velocity=np.concatenate([term.motion.velocity for term in terms]),
        starts=starts,
        load=_joined(terms, "normal"),
        temperature_c=_joined(terms, "temperature"),
    )


def _known(terms: Sequence[Terms], *, scaled: bool) -> tuple[FloatArray, FloatArray]:
    """The target, and what errors are relative to: all that is known of the exertion, at the samples' rate."""
    zeros = np.zeros(sum(len(term.motion.position) for term in terms))
    port, load, drive = (_joined(terms, name) for name in ("port", "load", "drive"))
    gained = None if terms[0].gain is None else np.concatenate([_gained(term) for term in terms])
    if not scaled:
        assert drive is not None  # the map has a command or an exertion
        return -drive, drive
    target = (zeros if port is None else port) + (zeros if load is None else load)
    target = target - (zeros if gained is None else gained)
    exertion = next(known for known in (port, gained, load) if known is not None)
    return target, exertion


def _gained(term: Terms) -> FloatArray:
    assert term.drive is not None
    assert term.gain is not None
    return term.gain * term.drive


def _others(
    column_map: ColumnMap, parts: Sequence[Stretch], terms: Sequence[Terms], *, scaled: bool
) -> dict[str, FloatArray]:
    """What is not friction and not known, as columns of the target."""
    model = column_map.model
    position = np.concatenate([term.motion.position for term in terms])
    columns: dict[str, FloatArray] = {}
    drive = _joined(terms, "drive")
    if drive is not None and terms[0].gain is None and scaled:
        columns["torque_gain"] = drive
    if model.inertia:
        columns["inertia"] = -np.concatenate([term.motion.acceleration for term in terms])
    if model.gravity and not column_map.translation:
        columns |= {"gravity_sine": -np.sin(position), "gravity_cosine": -np.cos(position)}
    period = parts[0].log.given("model", "cogging_period")
    if period is not None:
        phase = 2 * np.pi * position / period
        columns |= {"cogging_sine": -np.sin(phase), "cogging_cosine": -np.cos(phase)}
    if model.drift_s is not None:
        columns |= _drift(np.concatenate([part.time_s for part in parts]), model.drift_s)
    elif model.offset:
        columns["offset"] = -np.ones(position.size)
    return columns


def _drift(time_s: FloatArray, spacing_s: float) -> dict[str, FloatArray]:
    """The offset as a line with a knot every ``spacing_s``."""
    first, last = float(time_s.min()), float(time_s.max())
    knots = np.linspace(first, last, max(2, round((last - first) / spacing_s) + 1))
    return {f"offset_{index}": -np.interp(time_s, knots, row) for index, row in enumerate(np.eye(len(knots)), 1)}
