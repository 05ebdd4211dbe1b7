"""The delay of command and exertion against the motion: searched within samples, and an unknown of the equation.

The equation has a column for each delay: how what was logged changes with it, as the fitted motion says, or as it was
logged behind a low-pass. The motion is moved instead of what was logged: it has passed a low-pass, and loses nothing
between its samples. So no error becomes smaller only because an interpolation smooths noise.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_fit import FrictionFit, scaled_rms
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.statistics import sandwich
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.equation import Problem
from norton_bench.logs.motion import Delays

# How many samples a column may be late or early; what the coarse search steps by.
LATEST_SAMPLES = 24
COARSE = 2
# A delay is believed where it leaves less than this share of the error at no delay, and is as many deviations long:
# whatever a model of friction lacks looks a little like one.
BELIEVED = 0.95
SURE = 3.0
# The fine search: at most so many rounds, of so many samples each, until it moves by less than the last.
ROUNDS = 12
# Or until it is as near as this share of its deviation: where friction turns round, samples make the error rough.
NEAR = 0.5
LONGEST_SAMPLES = 2.0
SETTLED_SAMPLES = 0.02
# Passes over the two columns where both may be late.
PASSES = 2

SHIFT = "_shift"
COMMAND, EXERTION = "command" + SHIFT, "exertion" + SHIFT


def sought(column_map: ColumnMap) -> tuple[str, ...]:
    """The columns whose delay is not known: those without a ``shift`` of their own, beside a motion without one."""
    columns = column_map.mapped()
    moved = {name for name, section in columns.items() if "shift_s" in section.model_fields_set}
    if not column_map.model.delays or column_map.model.refine is not None or moved & {"position", "velocity"}:
        return ()
    return tuple(name for name in ("command", "exertion") if name in columns and name not in moved)


def with_columns(problem: Problem, fit: FrictionFit) -> Problem:
    """The problem with a column for each delay that is sought; ``fit`` is one of it, without or with them."""
    slopes = _slopes(problem, fit)
    columns = {name: column for name, column in problem.columns.items() if not name.endswith(SHIFT)}
    columns |= {f"{name}{SHIFT}": slopes[name] for name in problem.delays.sought}
    equation = problem.equation
    others = equation.process(np.array(list(columns.values())).reshape(len(columns), problem.known.size))
    return replace(problem, columns=columns, equation=replace(equation, names=tuple(columns), others=others))


def _slopes(problem: Problem, fit: FrictionFit) -> Mapping[str, FloatArray]:
    """Change of the target with what each of the columns would have had so much later, at the samples' rate.

    What a port takes may be a small difference of drive and demand, so that there the logged columns tell better.
    """
    demand = -_moving(problem, fit)
    dt_s = problem.filters.dt_s
    ends = np.cumsum([len(term.sound) for term in problem.terms])[:-1]

    def rate(values: FloatArray) -> FloatArray:
        return np.concatenate([np.gradient(part, dt_s) for part in np.split(values, ends)])

    if problem.terms[0].port is None:
        return {"command": -rate(demand)}
    smooth = problem.filters.smooth
    slopes = {"exertion": rate(np.concatenate([smooth(term.port) for term in problem.terms if term.port is not None]))}
    if problem.terms[0].drive is not None:
        gain = fit.value("torque_gain") if problem.terms[0].gain is None else problem.terms[0].gain
        drive = [smooth(term.drive) for term in problem.terms if term.drive is not None]
        slopes["command"] = -gain * rate(np.concatenate(drive))
    return slopes


def _moving(problem: Problem, fit: FrictionFit) -> FloatArray:
    """What the equation's right side says without drive and delays, less the known load: minus what moving takes."""
    equation, path = problem.equation, problem.equation.path
    count = len(equation.names)
    total = -fit.values[count : count + len(fit.model.terms)] @ fit.model.columns(path, fit.shape)
    for name, column in problem.columns.items():
        if name in fit.names and name != "torque_gain" and not name.endswith(SHIFT):
            total = total + fit.value(name) * column
    if problem.terms[0].load is not None:
        total = total - np.concatenate([term.load for term in problem.terms if term.load is not None])
    return np.asarray(total)


def found(problem: Problem, fit: FrictionFit) -> Delays:
    """The delays of ``problem``, and what the fit of it finds beyond them."""
    more = {name: fit.value(name) if name in fit.names else 0.0 for name in (COMMAND, EXERTION)}
    delays = problem.delays
    return replace(delays, command_s=delays.command_s + more[COMMAND], exertion_s=delays.exertion_s + more[EXERTION])


def edge_s(problem: Problem) -> float:
    """The deviation that no residual shows: friction turns round with the velocity, at a time that samples show to
    within one of them, evenly distributed, at each reversal."""
    path = problem.equation.path
    velocity = path.velocity if path.trained is None else path.velocity[path.trained]
    reversals = float(np.count_nonzero(np.diff(np.sign(velocity))))
    return float(problem.filters.dt_s / np.sqrt(12 * max(reversals, 1.0)))


def searched(problem: Problem, fit: FrictionFit, again: Callable[[Delays], Problem]) -> Delays:
    """The delays that the fitted friction asks for: first over whole samples, then within them.

    ``fit`` is one of ``problem``, which is made again by ``again`` for other delays. What is not surely late or early
    stays where it was logged; it is ``sought`` all the same, because nobody knows that it is in time.
    """
    nowhere = Delays(sought=problem.delays.sought)
    delays = _coarse(problem, fit)
    dt_s = problem.filters.dt_s
    for _ in range(ROUNDS):
        here = _linear(with_columns(again(delays), fit), fit)
        step = {name: _limited(here.values.get(name, 0.0), LONGEST_SAMPLES * dt_s) for name in (COMMAND, EXERTION)}
        delays = replace(
            delays,
            command_s=_limited(delays.command_s + step[COMMAND], LATEST_SAMPLES * dt_s),
            exertion_s=_limited(delays.exertion_s + step[EXERTION], LATEST_SAMPLES * dt_s),
        )
        settled = {name: max(SETTLED_SAMPLES * dt_s, NEAR * here.deviations.get(name, 0.0)) for name in step}
        if all(abs(step[name]) < settled[name] for name in step):
            break
    else:
        return nowhere
    if not here.rms < BELIEVED * _linear(problem, fit).rms:
        return nowhere
    lengths = {COMMAND: delays.command_s, EXERTION: delays.exertion_s}
    sure = [
        name
        for name in delays.sought
        if abs(lengths[name + SHIFT]) > SURE * here.deviations.get(name + SHIFT, float("inf"))
    ]
    return replace(
        delays,
        command_s=delays.command_s if "command" in sure else 0.0,
        exertion_s=delays.exertion_s if "exertion" in sure else 0.0,
    )


@dataclass(frozen=True)
class _Linear:
    """Coefficients of an equation's columns beside friction of a given shape, and their deviations, by name."""

    values: Mapping[str, float]
    deviations: Mapping[str, float]
    rms: float


def _linear(problem: Problem, fit: FrictionFit) -> _Linear:
    equation, rows = problem.equation, problem.train
    friction = equation.process(fit.model.columns(equation.path, fit.shape))
    columns = np.concatenate([equation.others, -friction])[:, rows]
    scale = equation.scale[rows]
    columns, target = scale * columns, scale * equation.target[rows]
    linear = linear_solution(columns, target)
    residual = target - linear @ columns
    deviations = np.sqrt(np.maximum(np.diag(sandwich(columns.T, residual, equation.time_s[rows])), 0.0))
    return _Linear(
        dict(zip(equation.names, linear.tolist(), strict=False)),
        dict(zip(equation.names, deviations.tolist(), strict=False)),
        scaled_rms(residual, scale),
    )


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)


def _coarse(problem: Problem, fit: FrictionFit) -> Delays:
    """Over whole samples, one column after the other."""
    dt_s, equation, rows = problem.filters.dt_s, problem.equation, problem.train
    friction = equation.process(fit.model.columns(equation.path, fit.shape))
    fixed = [name for name in equation.names if name != "torque_gain" and not name.endswith(SHIFT)]
    scale = equation.scale[rows]
    basis = np.concatenate([equation.others[[equation.names.index(name) for name in fixed]], friction])[:, rows] * scale

    def left(samples: Mapping[str, int]) -> float:
        target, drive = _rolled(problem, samples)
        processed = equation.process(np.stack([target, drive]))[:, rows] * scale
        columns = np.concatenate([basis, processed[1:]]) if "torque_gain" in equation.names else basis
        error = processed[0] - linear_solution(columns, processed[0]) @ columns
        return float(np.sqrt(np.mean(error**2)))

    nowhere = dict.fromkeys(problem.delays.sought, 0)
    best = dict(nowhere)
    reach = range(-LATEST_SAMPLES, LATEST_SAMPLES + 1, COARSE)
    for _ in range(PASSES if len(best) > 1 else 1):
        for name in best:
            errors = [left(best | {name: samples}) for samples in reach]
            best[name] = reach[int(np.argmin(errors))]
    if not left(best) < BELIEVED * left(nowhere):
        best = nowhere
    return replace(problem.delays, command_s=dt_s * best.get("command", 0), exertion_s=dt_s * best.get("exertion", 0))


def _rolled(problem: Problem, samples: Mapping[str, int]) -> tuple[FloatArray, FloatArray]:
    """The target, and the drive, with columns that belong to so many samples later."""
    zeros = np.zeros(problem.known.size)

    def joined(name: str) -> FloatArray:
        parts = [getattr(term, name) for term in problem.terms]
        values = zeros if parts[0] is None else np.concatenate(parts)
        return np.roll(values, samples.get({"drive": "command", "port": "exertion"}.get(name, ""), 0))

    gain = problem.terms[0].gain
    drive = joined("drive")
    if not problem.scaled:
        return -drive, drive
    return joined("port") + joined("load") - (0.0 if gain is None else gain) * drive, drive
