"""What in a log contradicts mechanics: wrong signs, swapped columns, an equation that explains nothing.

Every finding is a sentence with the remedy; any of them makes all estimates doubtful.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.redundancy import AGREEMENT, SLOPE, agreement
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.statistics import sandwich
from norton_bench.logs.basic_equation import (
    SIGNIFICANT,
    UNEXPLAINED,
    Basic,
    basic_columns,
    basic_of,
    rms,
    variation,
)
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.equation import TORQUE_GAIN, Problem
from norton_bench.logs.grid import Filters, Stretch, slope
from norton_bench.logs.log import Log
from norton_bench.logs.results import ErrorFigures
from norton_bench.models.parameters import HALF_INTERVAL

# What is left of it is worth an explanation.
MUCH = 0.05
# Columns are out of step by more than this many samples, if that explains this share of what is unexplained.
LATE_SAMPLES = 2
LATEST_SAMPLES = 24
COARSE = 3
LATE_EXPLAINS = 0.3
# Swapping two columns is suspected where it leaves less than this share of what is left otherwise.
BETTER = 0.5
AS_GOOD = 1.5  # where signs are wrong as it is
LOAD_ONLY_PRESSES = (
    " [columns] load says what presses on the gears, and is not taken off; what a sensor at the port measures is "
    "exertion."
)
DRIVERS = ("command", "exertion")
SWAPPABLE = ("position", "velocity", "command", "exertion", "goal")
# A position that leads its goal by more than this many samples, and by this many deviations.
LEAD_SAMPLES = 0.5
LEAD_LEAVES = 0.7  # of the difference between the two, if a lead is what makes it
# A goal is followed where it and the position agree this well.
FOLLOWED = 0.8
# Moved at three tenths of its resonance, a link on a spring goes by 1 / (1 - 0.3²), a tenth further than its motor.
LINK_WITHIN = 0.1
# A column this much rougher than the position is no position.
ROUGHER = 3.0


def wrong_columns(logs: Sequence[Log], basic: Basic, solve: Callable[[Sequence[Log]], Problem]) -> Mapping[str, float]:
    """The columns of what drives with whose sign turned nothing is wrong, and what the equation then leaves. ``basic``
    is that of ``logs`` as ``solve`` has it."""
    result = {}
    for name in (each for each in DRIVERS if each in logs[0].columns):
        other = basic_of([_with_turned(log, name) for log in logs], solve)
        contradicted = other.at_port is not None and other.at_port.contradicts_gain
        if other.sound and not contradicted and other.unexplained < min(AS_GOOD * basic.unexplained, UNEXPLAINED):
            result[name] = other.unexplained
    return result


def wrong_signs(
    basic: Basic, column_map: ColumnMap, gear_ratio: float | None, mends: Mapping[str, float]
) -> Iterator[str]:
    """Inertia and dissipation are positive, and so is a gain, if the signs of the columns agree; gears that turn the
    other way turn that of the motor's command. ``mends`` are those of :func:`wrong_columns`."""
    columns = column_map.columns
    both = columns.exertion is not None and columns.command is not None
    driver = min(mends, key=lambda name: mends[name], default="exertion" if columns.exertion is not None else "command")
    mend = f"turn the sign of {driver}{'' if mends and both else ' or of the motion'} in [columns] (sign = -1)"
    agree = f"the signs of {driver} and motion do not agree; {mend}"
    if both and not mends and column_map.actuator.torque_gain is not None:
        agree = (
            "turning no sign mends it; check the units and scales of exertion and of [actuator] torque_gain: with this "
            "gain the motor cannot give the torque at the port"
        )
    backwards = columns.command is not None and columns.command.side == "motor" and (gear_ratio or 1.0) < 0
    if basic.load is not None and basic.load.negative:
        yield f"The torque at the port is that of a load with a negative inertia: {agree}."
    elif basic.unidentifiable_gain:
        return
    elif basic.gain is not None and (-basic.gain if backwards else basic.gain) < -SIGNIFICANT:
        yield f"A positive command drives the shaft backwards: {mend.replace(driver, 'command')}."
    elif basic.inertia is not None and basic.inertia < -SIGNIFICANT:
        yield f"The inertia comes out negative: {agree}."
    elif basic.braking is not None and basic.braking < -SIGNIFICANT:
        yield f"Friction comes out negative, driving the motion: {agree}."


def unidentifiable_gain(basic: Basic, column_map: ColumnMap) -> Iterator[str]:
    """A torque at the port that is only what the load answers the motion with."""
    if basic.unidentifiable_gain and basic.load is not None:
        unit = "kg" if column_map.translation else "kg*m^2"
        yield (
            f"The torque at the port follows from the motion alone, as that of an inertia of {basic.load.value:.3g} "
            f"{unit}: beside it the command tells no torque gain. Give [actuator] torque_gain, or load the port by a "
            "brake or a second drive."
        )


def out_of_step(problem: Problem, fit: FrictionFit, column_map: ColumnMap) -> Iterator[str]:
    """Exertion and motion that were logged at different times: a shift of one that explains far more."""
    if problem.terms[0].load is not None:
        return  # what the load asks for follows from the motion, and cannot be late for it
    equation, rows = problem.equation, problem.train
    friction = equation.process(fit.model.columns(equation.path, fit.shape))
    basis = np.linalg.qr(np.concatenate([equation.others, friction])[:, rows].T)[0]

    def left(shift: int) -> float:
        target = equation.process(np.roll(problem.known, -shift)[None, :])[0][rows]
        return rms(target - basis @ (basis.T @ target)) / max(rms(target), 1e-300)

    reach = LATEST_SAMPLES // COARSE
    coarse = COARSE * min(range(-reach, reach + 1), key=lambda number: left(COARSE * number))
    best = min(range(coarse - COARSE + 1, coarse + COARSE), key=left)
    if abs(best) >= LATE_SAMPLES and left(best) < (1 - LATE_EXPLAINS) * left(0):
        what = "exertion" if column_map.columns.exertion is not None else "command"
        late_ms = 1e3 * best * problem.filters.dt_s
        yield (
            f"{what} is logged about {abs(late_ms):.2g} ms {'later' if best > 0 else 'earlier'} than the motion it "
            f'goes with: shift its time in [columns] {what} (shift = "{-late_ms:.2g} ms").'
        )


def hanging(problem: Problem, left: float, column_map: ColumnMap) -> Iterator[str]:
    """A weight that the map does not know, which some law of friction, or a delay, may have been taken for; ``problem``
    is the equation without delays. A load beyond a sensor at the port may hang as it likes: where the angle alone
    tells more of the torque there than the equation does, it is that."""
    known = column_map.model.gravity or column_map.translation or problem.terms[0].load is not None
    if known or not left > MUCH:
        return
    equation, rows = problem.equation, problem.train
    angle = equation.path.position
    weight = equation.process(np.stack([np.sin(angle), np.cos(angle)]))
    alone = np.concatenate([weight, np.ones((1, weight.shape[1]))])[:, rows]
    columns, target = np.concatenate([basic_columns(problem), weight])[:, rows], equation.target[rows]
    beside, by_angle = (
        rms(target - linear_solution(each, target) @ each) / max(variation(problem), 1e-300)
        for each in (columns, alone)
    )
    of_load = problem.terms[0].port is not None and by_angle < left
    if beside**2 < BETTER * left**2 and not of_load:
        yield (
            f"A torque goes with the angle, as a weight does: with it {beside:.1%} of the exertion would be left, and "
            f"not {left:.1%}; write [model] gravity = true, or a known [load]."
        )


def scales_apart(given: float, freed: Problem, fit: FrictionFit, basic: Basic, left: float) -> Iterator[str]:
    """A torque gain that the sensor at the port, or the known load, does not bear out: with another one, ``fit`` of the
    problem ``freed``, far less is left, or no sign is wrong. ``basic`` and ``left`` are those of the gain ``given``."""
    gain, std = fit.value(TORQUE_GAIN), fit.deviation(TORQUE_GAIN)
    beside = fit.rms / max(variation(freed), 1e-300)
    mends = not basic.sound and fit.value("inertia") > SIGNIFICANT * fit.deviation("inertia")
    # A gain of the other sign is the sign's matter.
    apart = gain / given > 0 and abs(gain - given) > SIGNIFICANT * std
    if apart and (mends or beside**2 < BETTER * left**2):
        yield (
            f"{'Exertion' if freed.terms[0].port is not None else 'The known load'} says that torque_gain is "
            f"{gain:.4g} ± {HALF_INTERVAL * std:.2g}, and {given:.4g} is given: check the units and scales of both, or "
            "leave [actuator] torque_gain out to have it estimated."
        )


def unexplained(basic: Basic, left: float, column_map: ColumnMap) -> Iterator[str]:
    """``left`` is what the model that was chosen leaves, relative to what varies."""
    if min(basic.unexplained, left) > UNEXPLAINED:
        columns = column_map.columns
        yield (
            f"The equation leaves {min(basic.unexplained, left):.0%} of the exertion unexplained: check which column "
            "is which, their units and signs, and whether something else acted."
            + (LOAD_ONLY_PRESSES if columns.load is not None and columns.exertion is None else "")
        )


def astray(motion: ErrorFigures | None) -> Iterator[str]:
    """A simulation that was fitted to the motion and does not follow it."""
    if motion is not None and motion.relative > UNEXPLAINED:
        yield (
            f"The simulated motion differs from the logged one by {motion.relative:.0%} of its spread: check which "
            "column is which, their units and signs, and the loop's law."
        )


def swapped(logs: Sequence[Log], basic: Basic, solve: Callable[[Sequence[Log]], Problem]) -> Iterator[str]:
    """Two columns that explain far more with their places changed; ``basic`` is that of ``logs`` as they are."""
    names = [name for name in SWAPPABLE if name in logs[0].columns]
    if "position" in names:
        names = [name for name in names if name != "velocity"]  # which is its derivative, or it would have been said
    result: list[tuple[float, str]] = []
    for first, second in combinations(names, 2):
        if first == "position" and not _may_be_position(logs, second):
            continue
        other = basic_of([_with_swapped(log, first, second) for log in logs], solve)
        # A goal is so like its position that either would do.
        much = BETTER if basic.sound or second == "goal" else AS_GOOD
        if other.sound and other.unexplained < min(much * basic.unexplained, UNEXPLAINED):
            result.append(
                (other.unexplained, f"{first} and {second} seem to be swapped: change them round in [columns].")
            )
    if result:
        yield min(result)[1]


def _may_be_position(logs: Sequence[Log], other: str) -> bool:
    """Whether a column can be the position instead: a motion is smooth, and what is said to be it now must not be
    borne out by a velocity or a goal."""
    for log in logs:
        position = log.columns["position"]
        if other != "goal" and _rough(log.columns[other]) > ROUGHER * _rough(position):
            return False
        witness = log.columns.get("velocity")
        if witness is not None and other != "velocity":
            followed = np.corrcoef(np.diff(position), witness[1:] + witness[:-1])[0, 1]
            if followed > FOLLOWED:
                return False
        goal = log.columns.get("goal")
        if goal is not None and other != "goal" and np.ptp(goal) > 0 and np.corrcoef(position, goal)[0, 1] > FOLLOWED:
            return False
    return True


def _rough(values: FloatArray) -> float:
    """Of what varies, the share that changes from row to row."""
    return float(np.std(np.diff(values))) / max(float(np.std(values)), 1e-300)


def _with_turned(log: Log, name: str) -> Log:
    return replace(log, columns={**log.columns, name: -log.columns[name]})


def _with_swapped(log: Log, first: str, second: str) -> Log:
    columns = dict(log.columns)
    columns[first], columns[second] = columns[second], columns[first]
    return replace(log, columns=columns)


def unlike_link(parts: Sequence[Stretch]) -> Iterator[str]:
    """A link turns as its motor does, but for the twist between them."""
    if not all({"position", "link_position"} <= set(part.columns) for part in parts):
        return
    motor, link = (
        np.concatenate([part.columns[name][part.sound] - np.mean(part.columns[name][part.sound]) for part in parts])
        for name in ("position", "link_position")
    )
    factor, alike = agreement(motor, link)
    if alike > AGREEMENT and factor < 0:
        yield (
            "link_position runs against position: turn the sign of one of them in [columns] (sign = -1), or of "
            "[actuator] gear_ratio."
        )
    elif alike > AGREEMENT and not 1 - LINK_WITHIN < factor < 1 + LINK_WITHIN:
        yield (
            f"link_position moves {factor:.3g} times as far as position: check [actuator] gear_ratio, the units, and "
            "which encoder is which."
        )


def unlike_derivative(parts: Sequence[Stretch], filters: Filters) -> Iterator[str]:
    """A logged velocity must be the derivative of the logged position."""
    if not all({"position", "velocity"} <= set(part.columns) for part in parts):
        return
    derived, logged = _derivatives(parts, filters, "position", "velocity")
    factor, alike = agreement(derived, logged)
    if alike > AGREEMENT and SLOPE[0] < factor < SLOPE[1]:
        return
    swapped_factor, swapped_alike = agreement(*_derivatives(parts, filters, "velocity", "position"))
    if swapped_alike > AGREEMENT and SLOPE[0] < swapped_factor < SLOPE[1]:
        yield "position and velocity seem to be swapped: change them round in [columns]."
    elif alike > AGREEMENT:
        yield f"velocity is {factor:.3g} times the derivative of position: check the units, scales and signs of both."
    else:
        yield "velocity is not the derivative of position: check which column is which, and the clock."


def _derivatives(
    parts: Sequence[Stretch], filters: Filters, position: str, velocity: str
) -> tuple[FloatArray, FloatArray]:
    derived, logged = [], []
    for part in parts:
        keep = part.sound & (np.arange(len(part.sound)) >= filters.margin)
        keep[-filters.margin :] = False
        derived.append(slope(filters.smooth(part.columns[position]), part.dt_s)[keep])
        logged.append(filters.smooth(part.columns[velocity])[keep])
    return np.concatenate(derived), np.concatenate(logged)


def ahead_of_goal(parts: Sequence[Stretch], filters: Filters) -> Iterator[str]:
    """A controlled position follows its goal: one that leads it is the goal, one that runs against it has a wrong sign.

    Nothing is said of a goal that is not followed.
    """
    if not all({"position", "goal"} <= set(part.columns) for part in parts):
        return
    position, goal = (_smoothed(parts, filters, name) for name in ("position", "goal"))
    velocity = np.concatenate([slope(p + g, filters.dt_s) / 2 for p, g in zip(position, goal, strict=True)])
    error = np.concatenate([p - g for p, g in zip(position, goal, strict=True)])
    together = float(np.corrcoef(np.concatenate(position), np.concatenate(goal))[0, 1])
    columns = np.stack([velocity, np.ones(error.size)])
    lead_s, rest = linear_solution(columns, error)
    time_s = np.arange(error.size, dtype=np.float64) * filters.dt_s
    residual = error - lead_s * velocity - rest
    deviation_s = np.sqrt(sandwich(columns.T, residual, time_s)[0, 0])
    if together < -FOLLOWED:
        yield "position runs against its goal: turn the sign of one of them in [columns] (sign = -1)."
    elif (
        together > FOLLOWED
        and lead_s > max(LEAD_SAMPLES * filters.dt_s, SIGNIFICANT * deviation_s)
        and np.std(residual) < LEAD_LEAVES * np.std(error)
    ):
        yield (
            f"position runs {1e3 * lead_s:.3g} ms ahead of its goal: the two seem to be swapped; change them round "
            "in [columns]."
        )


def _smoothed(parts: Sequence[Stretch], filters: Filters, name: str) -> list[FloatArray]:
    return [filters.smooth(part.columns[name])[filters.margin : -filters.margin] for part in parts]
