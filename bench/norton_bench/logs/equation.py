"""All stretches as one equation in which friction, and what else is not known, is to be found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification import friction_operators as operators
from norton_bench.identification.friction_model import Path
from norton_bench.identification.ladder import Equation, blocked_folds
from norton_bench.logs.axis_inputs import enabled
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.grid import Filters, Stretch
from norton_bench.logs.motion import Delays, Motion, moved
from norton_bench.logs.readings import Readings
from norton_bench.logs.slow import drift_columns

# Columns of the equation: what the drive does, and the spring of a joint that gives where nothing tells what it
# transmits.
TORQUE_GAIN = "torque_gain"
LINK_STIFFNESS, LINK_DAMPING = "link_stiffness", "link_damping"


# What a stretch's columns mean in the equation of motion: motion, drive, and what the known load asks for.
#
# τ = gain · drive − inertia · a − friction − offset − load τ at the port, zero where it is free
@dataclass(frozen=True)
class Terms:
    """One stretch at its own rate, before the decimation; arrays (n,). ``gain`` is None where it is unknown.

    ``link`` is the motion beyond a joint that gives, None where it was not logged; ``pressing`` is what presses on the
    surfaces that rub, None where nothing tells.
    """

    motion: Motion
    link: Motion | None
    drive: FloatArray | None
    gain: float | None
    port: FloatArray | None
    load: FloatArray | None
    pressing: FloatArray | None
    temperature: FloatArray | None
    sound: BoolArray

    @classmethod
    def of(cls, stretch: Stretch, column_map: ColumnMap, filters: Filters, delays: Delays) -> "Terms":
        port = stretch.columns.get("exertion")
        later_s = delays.reference_s(exertion=port is not None)
        motion = Motion.of(stretch, filters, later_s)
        drive = drive_of(stretch)
        if drive is not None and delays.command_s != later_s:
            drive = moved(drive, stretch.dt_s, later_s - delays.command_s)
        logged = stretch.columns.get("link_position")
        link = None if logged is None else Motion.of_position(logged, filters, later_s)
        translation = column_map.translation
        return cls(
            motion=motion,
            link=link,
            drive=drive,
            gain=stretch.log.given("actuator", "torque_gain"),
            port=port,
            # What hangs beyond a sensor at the port is no part of the actuator.
            load=None if port is not None else _known_load(stretch, link or motion, translation=translation),
            # Where no command tells what else drives, the torque measured is the friction's own: it cannot explain it.
            pressing=_pressing(stretch, link or motion, None if drive is None else port, translation=translation),
            temperature=stretch.columns.get("temperature"),
            sound=stretch.sound & enabled(stretch) & _inside(stretch, delays),
        )

    @property
    def twist(self) -> FloatArray | None:
        """Of the joint that gives, and its rate, (2, n)."""
        if self.link is None:
            return None
        motor, link = self.motion, self.link
        return np.stack([motor.position - link.position, motor.velocity - link.velocity])


def _pressing(stretch: Stretch, motion: Motion, port: FloatArray | None, *, translation: bool) -> FloatArray | None:
    """What friction that depends on the load depends on: the normal force, or what the gears transmit.

    That is logged, or is what the sensor at the port measures, or what the known load asks for.
    """
    for name in ("normal", "load"):
        if name in stretch.columns:
            return stretch.columns[name]
    return port if port is not None else _known_load(stretch, motion, translation=translation)


def _inside(stretch: Stretch, delays: Delays) -> BoolArray:
    """Where nothing that was moved in time came from beyond an end."""
    reach = int(np.ceil(max(abs(delays.command_s), abs(delays.exertion_s)) / stretch.dt_s))
    count = len(stretch.time_s)
    return np.asarray((np.arange(count) >= reach) & (np.arange(count) < count - reach))


def drive_of(stretch: Stretch) -> FloatArray | None:
    """The command; where the supply was logged, the command is the share of it that is switched on."""
    command = stretch.columns.get("command")
    if command is None or "supply" not in stretch.columns:
        return command
    return command * stretch.columns["supply"]


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


LEAST_ROWS = 30
NO_DELAYS = Delays()


@dataclass(frozen=True)
class Problem:
    """The equation of a log, and what its rows are.

    ``known`` is the target and ``columns`` the others, at the samples' own rate. ``exertion`` (n,) is what the actuator
    exerts, where anything measures it or a known gain gives it, else what the known load asks for, else the drive:
    errors are relative to it. ``scaled`` says whether anything fixes the scale of exertion.
    ``train`` and ``test`` (n,) are the split, ``pick`` (n,) the rows' samples, those of all stretches joined.
    ``drift_s`` is the map's.
    """

    equation: Equation
    known: FloatArray
    exertion: FloatArray
    scaled: bool
    train: BoolArray
    test: BoolArray
    columns: Mapping[str, FloatArray]
    terms: tuple[Terms, ...]
    readings: Readings
    delays: Delays
    pick: IntArray
    drift_s: float | None

    @property
    def filters(self) -> Filters:
        return self.readings.filters

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        return self.readings.stretches

    def joined(self, name: str) -> FloatArray | None:
        """A field of the terms, at the samples' rate of all stretches; None where it is not known."""
        return _joined(self.terms, name)

    @property
    def transmitted(self) -> FloatArray | None:
        """What the port is driven with, by a sensor or by a known load, at the samples' rate, filtered as the motion
        is; None where none tells."""
        if self.terms[0].port is None:
            return self.joined("load")
        return np.concatenate([self.filters.smooth(term.port) for term in self.terms if term.port is not None])

    @property
    def exertion_rms(self) -> float:
        """Over the rows trained on."""
        return float(np.sqrt(np.mean(self.exertion[self.train] ** 2)))

    @property
    def side(self) -> int:
        """1 where the exertion stands in the target as it is, −1 where it stands there turned round."""
        first = self.terms[0]
        return 1 if first.port is not None or (first.gain is None and first.load is not None) else -1


@dataclass(frozen=True)
class Rows:
    """Which samples of all stretches joined become rows, and the filter that they pass on the way.

    ``starts`` (stretches + 1,) are the first samples of the stretches, and the end; ``sound`` says which of all rows
    are used, ``pick`` (n,) are their samples.
    """

    starts: IntArray
    sound: BoolArray
    pick: IntArray
    filters: Filters

    @classmethod
    def of(cls, terms: Sequence[Terms], filters: Filters) -> "Rows":
        lengths = [len(term.sound) for term in terms]
        starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        sound = np.concatenate([_settled(term.sound, filters.margin) for term in terms])
        places = np.concatenate([np.arange(a, b, filters.factor) for a, b in pairwise(starts)])
        return cls(starts, sound[places], places[sound[places]], filters)

    def process(self, samples: FloatArray) -> FloatArray:
        """Columns at the samples' rate, (columns, samples), as rows, (columns, n)."""
        pieces = [self.filters.decimated(samples[:, a:b]) for a, b in pairwise(self.starts)]
        return np.asarray(np.concatenate(pieces, axis=1)[:, self.sound])


def make_problem(column_map: ColumnMap, readings: Readings, delays: Delays = NO_DELAYS) -> Problem:
    """Raises ExperimentError where nothing is left to learn from."""
    parts, trained, filters = readings.stretches, readings.trained, readings.filters
    terms = tuple(Terms.of(part, column_map, filters, delays) for part in parts)
    rows = Rows.of(terms, filters)
    train, test = (np.concatenate([split[side] for split in readings.splits])[rows.pick] for side in (0, 1))
    _check_enough(parts, int(np.count_nonzero(train)))
    scaled = any(terms[0].__dict__[name] is not None for name in ("port", "gain", "load"))
    columns = _others(column_map, parts, terms, trained, scaled=scaled)
    target, exertion = _known(terms, scaled=scaled)
    # What a known load takes is computed from the same acceleration, unless it is the link's.
    same = terms[0].load is not None and terms[0].link is None
    carried = (parts[0].log.given("load", "inertia") or 0.0) if same else 0.0
    equation = Equation(
        target=rows.process(target[None, :])[0],
        others=rows.process(np.array(list(columns.values())).reshape(len(columns), target.size)),
        names=tuple(columns),
        path=_path(parts, terms, rows, trained),
        fold=_folds(train),
        time_s=_running(np.concatenate([part.time_s for part in parts])[rows.pick]),
        process=rows.process,
        noise={"inertia": np.mean(rows.process(readings.acceleration_errors) ** 2, axis=0)}
        if column_map.model.inertia
        else {},
        noise_in_target={"inertia": -carried},
    )
    return Problem(
        equation=equation,
        known=target,
        exertion=rows.process(exertion[None, :])[0],
        scaled=scaled,
        train=train,
        test=test,
        columns=columns,
        terms=terms,
        readings=readings,
        delays=delays,
        pick=rows.pick,
        drift_s=column_map.model.drift_s,
    )


def _check_enough(parts: Sequence[Stretch], count: int) -> None:
    if count < LEAST_ROWS:
        raise ExperimentError(
            f"{parts[0].log.place}: {count} rows are left to learn from, {LEAST_ROWS} are the least; "
            "use a longer log, a wider --train, or a higher [filter] rate"
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
    return np.asarray(time_s[0] + np.cumsum(steps))


def _joined(terms: Sequence[Terms], name: str) -> FloatArray | None:
    values = [getattr(term, name) for term in terms]
    return None if values[0] is None else np.concatenate(values, axis=-1)


def _path(parts: Sequence[Stretch], terms: Sequence[Terms], rows: Rows, trained: Sequence[BoolArray]) -> Path:
    return Path(
        dt_s=parts[0].dt_s,
        position=np.concatenate([term.motion.position for term in terms]),
        velocity=np.concatenate([term.motion.velocity for term in terms]),
        starts=rows.starts[:-1],
        load=_joined(terms, "pressing"),
        temperature_c=_joined(terms, "temperature"),
        trained=np.concatenate(trained),
    )


def _gravity(position: FloatArray, harmonics: int) -> dict[str, FloatArray]:
    """A Fourier series of the angle; the first harmonic is that of one body that hangs."""
    columns: dict[str, FloatArray] = {}
    for number in range(1, harmonics + 1):
        which = "" if number == 1 else f"_{number}"
        columns |= {
            f"gravity_sine{which}": -np.sin(number * position),
            f"gravity_cosine{which}": -np.cos(number * position),
        }
    return columns


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
    column_map: ColumnMap,
    parts: Sequence[Stretch],
    terms: Sequence[Terms],
    trained: Sequence[BoolArray],
    *,
    scaled: bool,
) -> dict[str, FloatArray]:
    """What is not friction and not known, as columns of the target. Raises UsageError for a temperature unknown."""
    model = column_map.model
    position = np.concatenate([term.motion.position for term in terms])
    columns: dict[str, FloatArray] = {}
    drive = _joined(terms, "drive")
    if drive is not None and terms[0].gain is None and scaled:
        columns[TORQUE_GAIN] = drive
    if model.inertia:
        columns["inertia"] = -np.concatenate([term.motion.acceleration for term in terms])
    twist = _joined(terms, "twist")
    if twist is not None and terms[0].port is None and terms[0].load is None:
        columns |= {LINK_STIFFNESS: -twist[0], LINK_DAMPING: -twist[1]}
    if model.gravity and not column_map.translation:
        hanging = np.concatenate([(term.link or term.motion).position for term in terms])
        columns |= _gravity(hanging, int(model.gravity))
    period = parts[0].log.given("model", "cogging_period")
    if period is not None:
        columns |= operators.cogging(position, period)
    if model.temperature:
        warmth = _joined(terms, "temperature")
        if warmth is None:
            raise UsageError(f"{parts[0].log.place}: [model] temperature: the log holds none; leave it out of the map")
        velocity = np.concatenate([term.motion.velocity for term in terms])
        columns |= operators.temperature(velocity, warmth, np.concatenate(trained))
    if model.drift_s is not None:
        places = [part.log.place for part in parts]
        columns |= drift_columns(places, [part.time_s for part in parts], trained, model.drift_s)
    elif model.offset:
        columns["offset"] = -np.ones(position.size)
    return columns
