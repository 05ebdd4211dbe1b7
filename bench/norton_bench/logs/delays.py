"""The delay of command and exertion against the motion: searched within samples, and an unknown of the equation.

The equation has a column for each delay: how what was logged changes with it, as the fitted motion says, or as it was
logged behind a low-pass. The motion is moved instead of what was logged: it has passed a low-pass, and loses nothing
between its samples. So no error becomes smaller only because an interpolation smooths noise.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_fit import FrictionFit, noise_in_target, noise_power
from norton_bench.identification.separable import normal_solution
from norton_bench.identification.statistics import sandwich
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.equation import TORQUE_GAIN, Problem
from norton_bench.logs.motion import Delays

# How many samples a column may be late or early; what the coarse search steps by.
LATEST_SAMPLES = 24
COARSE = 2
# A delay is believed where it leaves less than this share of the error at no delay, and is as many deviations long:
# whatever a model of friction lacks looks a little like one. A longer delay in place of a shorter one has to leave as
# much less once more.
BELIEVED = 0.95
SURE = 3.0
# The fine search: at most so many rounds, of so many samples each, until it moves by less than the last.
ROUNDS = 12
# Or until it is as near as this share of its deviation: where friction turns round, samples make the error rough.
NEAR = 0.5
LONGEST_SAMPLES = 2.0
SETTLED_SAMPLES = 0.02

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
    noise, at_zero = {name: each for name, each in equation.noise.items() if not name.endswith(SHIFT)}, {}
    if EXERTION in columns:
        rate = problem.readings.white_noise("exertion") * problem.filters.in_rows(1)
        at_zero = {EXERTION: np.full(equation.target.size, rate**2)}
    elif COMMAND in columns and "inertia" in equation.noise:
        # The slope has the jerk of the motion in it.
        jerks = np.stack([_rate(problem, each) for each in problem.readings.acceleration_errors])
        noise = noise | {COMMAND: np.mean(equation.process(fit.value("inertia") * jerks) ** 2, axis=0)}
    others = equation.process(np.array(list(columns.values())).reshape(len(columns), problem.known.size))
    equation = replace(equation, names=tuple(columns), others=others, noise=noise, noise_at_zero=at_zero)
    return replace(problem, columns=columns, equation=equation)


def _rate(problem: Problem, values: FloatArray) -> FloatArray:
    """The change in time of samples (n,) of all stretches."""
    ends = np.cumsum([len(term.sound) for term in problem.terms])[:-1]
    return np.concatenate([np.gradient(part, problem.filters.dt_s) for part in np.split(values, ends)])


def _slopes(problem: Problem, fit: FrictionFit) -> Mapping[str, FloatArray]:
    """Change of the target with what each of the columns would have had so much later, at the samples' rate.

    What a port takes may be a small difference of drive and demand, so that there the logged columns tell better.
    """
    if problem.terms[0].port is None:
        return {"command": _rate(problem, _moving(problem, fit))}
    smooth = problem.filters.smooth
    port = [smooth(term.port) for term in problem.terms if term.port is not None]
    slopes = {"exertion": _rate(problem, np.concatenate(port))}
    if problem.terms[0].drive is not None:
        gain = fit.value(TORQUE_GAIN) if problem.terms[0].gain is None else problem.terms[0].gain
        drive = [smooth(term.drive) for term in problem.terms if term.drive is not None]
        slopes["command"] = -gain * _rate(problem, np.concatenate(drive))
    return slopes


def _moving(problem: Problem, fit: FrictionFit) -> FloatArray:
    """What the equation's right side says without drive and delays, less the known load: minus what moving takes."""
    total = -fit.strengths @ fit.model.columns(problem.equation.path, fit.shape)
    for name, column in problem.columns.items():
        if name in fit.names and name != TORQUE_GAIN and not name.endswith(SHIFT):
            total = total + fit.value(name) * column
    if problem.terms[0].load is not None:
        total = total - np.concatenate([term.load for term in problem.terms if term.load is not None])
    return np.asarray(total)


def found(problem: Problem, fit: FrictionFit) -> Delays:
    """The delays of ``problem``, and what the fit of it finds beyond them: noise in a column makes that look smaller,
    so that it has to come down to nothing."""
    stds = dict(zip(fit.names, fit.deviations.tolist(), strict=True))
    more = {
        name: fit.value(name) if name in stds and abs(fit.value(name)) > NEAR * stds[name] else 0.0
        for name in (COMMAND, EXERTION)
    }
    delays, most_s = problem.delays, LATEST_SAMPLES * problem.filters.dt_s
    return replace(
        delays,
        command_s=_limited(delays.command_s + more[COMMAND], most_s),
        exertion_s=_limited(delays.exertion_s + more[EXERTION], most_s),
    )


def edge_s(problem: Problem) -> float:
    """The deviation that no residual shows: friction turns round with the velocity, at a time that samples show to
    within one of them, evenly distributed, at each reversal."""
    path = problem.equation.path
    velocity = path.velocity if path.trained is None else path.velocity[path.trained]
    reversals = float(np.count_nonzero(np.diff(np.sign(velocity))))
    return float(problem.filters.dt_s / np.sqrt(12 * max(reversals, 1.0)))


def with_delays(problem: Problem, fit: FrictionFit) -> dict[str, tuple[float, float]]:
    """The values of a fit of ``problem`` and their deviations, by name; delays with what was put in place before."""
    done = {COMMAND: problem.delays.command_s, EXERTION: problem.delays.exertion_s}
    edge = dict.fromkeys(done, edge_s(problem))
    return {
        name: (value + done.get(name, 0.0), float(np.hypot(std, edge.get(name, 0.0))))
        for name, value, std in zip(fit.names, fit.values.tolist(), fit.deviations.tolist(), strict=True)
    }


def searched(problem: Problem, fit: FrictionFit, again: Callable[[Delays], Problem]) -> Delays:
    """The delays that the fitted friction asks for: that of one column first, then, beside it, that of the other. Where
    a delay of either leaves about as little, the shorter is the likelier one.

    ``fit`` is one of ``problem``, which is made again by ``again`` for other delays. What is not surely late or early
    stays where it was logged; it is ``sought`` all the same, because nobody knows that it is in time.
    """
    sought = problem.delays.sought
    best, left = Delays(), _linear(problem, fit).rms
    while open_names := [name for name in sought if name not in best.sought]:
        trials = [_beside(best, name, problem, fit, again) for name in open_names]
        least = min(linear.rms for _, linear in trials)
        as_good = [trial for trial in trials if BELIEVED**2 * trial[1].rms <= least]
        delays, linear = min(as_good, key=lambda trial: abs(_length_s(trial[0])))
        sure = abs(_length_s(delays)) > SURE * linear.deviations[delays.sought[-1] + SHIFT]
        if not sure or not linear.rms < BELIEVED * left:
            break
        best, left = delays, linear.rms
    return replace(best, sought=sought)


def _length_s(delays: Delays) -> float:
    """Of the last column sought."""
    return delays.command_s if delays.sought[-1] == "command" else delays.exertion_s


def _beside(
    best: Delays, name: str, problem: Problem, fit: FrictionFit, again: Callable[[Delays], Problem]
) -> "tuple[Delays, _Linear]":
    """The delay of one more column beside those that are known: first over whole samples, then all within them."""
    delays = _coarse(problem, fit, best, name)
    dt_s = problem.filters.dt_s
    for _ in range(ROUNDS):
        here = _linear(with_columns(again(delays), fit), fit)
        step = {each: _limited(here.values.get(each, 0.0), LONGEST_SAMPLES * dt_s) for each in (COMMAND, EXERTION)}
        settled = {each: max(SETTLED_SAMPLES * dt_s, NEAR * here.deviations.get(each, 0.0)) for each in step}
        if all(abs(step[each]) < settled[each] for each in step):
            break
        delays = replace(
            delays,
            command_s=_limited(delays.command_s + step[COMMAND], LATEST_SAMPLES * dt_s),
            exertion_s=_limited(delays.exertion_s + step[EXERTION], LATEST_SAMPLES * dt_s),
        )
    return delays, here


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
    linear, left = _solution(problem, columns, target, equation.names)
    residual = target - linear @ columns
    deviations = np.sqrt(np.maximum(np.diag(sandwich(columns.T, residual, equation.time_s[rows])), 0.0))
    return _Linear(
        dict(zip(equation.names, linear.tolist(), strict=False)),
        dict(zip(equation.names, deviations.tolist(), strict=False)),
        left,
    )


def _solution(
    problem: Problem, columns: FloatArray, target: FloatArray, names: Sequence[str]
) -> tuple[FloatArray, float]:
    """Coefficients of scaled columns, and the rms of what they leave, both without what noise does to them: a column of
    less noise in place of one of more would otherwise leave less for that alone.

    The first columns (k, n) are further ones of the equation, by ``names``, those of friction follow.
    """
    equation, rows = problem.equation, problem.train
    at = [equation.names.index(name) for name in names]
    squares = np.zeros((1, len(equation.names)))
    squares[0, at] = np.sum(columns[: len(at)] ** 2, axis=1)
    noise = noise_power(equation, equation.noise, np.where(rows, 0, -1), squares)[0, at]
    in_target = noise_in_target(equation)[at]
    right = columns @ target
    right[: len(at)] -= noise * in_target
    linear = normal_solution(columns, right, noise)
    left = float(np.sum((target - linear @ columns) ** 2) - noise @ (linear[: len(at)] - in_target) ** 2)
    return linear, float(np.sqrt(max(left, 0.0) / np.sum(equation.scale[rows] ** 2)))


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)


def _coarse(problem: Problem, fit: FrictionFit, best: Delays, name: str) -> Delays:
    """Over whole samples of one column; the other is where it is known to be."""
    dt_s, equation, rows = problem.filters.dt_s, problem.equation, problem.train
    friction = equation.process(fit.model.columns(equation.path, fit.shape))
    fixed = [name for name in equation.names if name != TORQUE_GAIN and not name.endswith(SHIFT)]
    scale = equation.scale[rows]
    basis = np.concatenate([equation.others[[equation.names.index(name) for name in fixed]], friction])[:, rows] * scale
    known = {"command": round(best.command_s / dt_s), "exertion": round(best.exertion_s / dt_s)}

    def left(samples: int) -> float:
        target, drive = _rolled(problem, known | {name: samples})
        processed = equation.process(np.stack([target, drive]))[:, rows] * scale
        columns = np.concatenate([basis, processed[1:]]) if TORQUE_GAIN in equation.names else basis
        return _solution(problem, columns, processed[0], fixed)[1]

    delay_s = dt_s * min(range(-LATEST_SAMPLES, LATEST_SAMPLES + 1, COARSE), key=left)
    return replace(best, sought=(*best.sought, name), **{f"{name}_s": delay_s})


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
