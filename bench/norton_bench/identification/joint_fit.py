"""The search for a motor behind a joint: Gauss-Newton on all unknowns, begun where a rigid fit leaves the most.

No initial guess: a few stiffnesses over all that a bench can tell are tried on the seconds in which the rigid motor is
off the most; from the best of them the search goes on over everything that is fitted.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification import separable
from norton_bench.identification.joint_regression import STEP, JointModel, JointRegression
from norton_bench.identification.regression import Memory, Regression
from norton_bench.identification.search_box import LONGEST_STEP, STEP_SHARES, limits, span_of, velocity_starts
from norton_bench.identification.separable import (
    CONVERGED_STEP,
    LITTLE_GAINED,
    MOST_COGGINGS,
    NOTHING_GAINED,
    ROUGH_STEP,
    Solution,
)
from norton_bench.identification.shape import INERTIA, LINEAR, Shape
from norton_bench.identification.signals import FINE, Signals
from norton_bench.identification.turns import is_new, strongest_period
from norton_bench.models.terms import (
    JOINT_DAMPING,
    JOINT_STIFFNESS,
    OUTPUT_INERTIA,
    Factor,
    NetworkTerm,
    TermParameter,
    joint_of,
)

# The rotor's own frequency on the joint, with the port held: below this it would be a spring beside which nothing of
# the motor is felt.
LEAST_HZ = 1.0
START_HZ = (12.0, 30.0, 75.0, 190.0, 480.0)
# Of the motor's inertia, and of critical damping: what a search begins with.
START_OUTPUT = 0.25
START_RATIO = 0.1
HEAVIEST_OUTPUT = 50.0
MOST_RATIO = 2.0
# A search begins on so many pieces of this length, and goes on from so many of its starts.
PIECES, PIECE_S = 2, 3.0
KEPT_STARTS = 2
FIRST_STEPS, PIECE_STEPS, MOST_STEPS = 2, 12, 20
# What a search over short pieces holds unknowns together with: deviations, relative, and of delays in seconds.
VAGUE_RELATIVE, VAGUE_S = 1.0, 2e-3
# A step longer than this share of a linear unknown leaves the region in which slopes hold.
LONGEST_SHARE = 0.5


@dataclass(frozen=True)
class _Point:
    """The regression linearised at one point: ``linear`` are its linear unknowns with the sensor's zero."""

    regression: JointRegression
    shape: Shape
    linear: FloatArray
    columns: FloatArray
    slopes: FloatArray
    memory: Memory

    @classmethod
    def of(cls, regression: JointRegression, shape: Shape, linear: FloatArray) -> "_Point":
        at = regression.linearised_at(linear)
        columns, memory = at.columns(shape)
        return cls(at, shape, linear, columns, at.jacobian(shape, columns, linear, memory), memory)

    @property
    def innovation(self) -> FloatArray:
        return self.memory.taken_off(self.regression.target() - self.linear @ self.columns)

    @property
    def every(self) -> FloatArray:
        """Of all unknowns, what least squares sees."""
        return self.memory.taken_off(np.concatenate([self.columns, self.slopes]))

    def step(self, *, held: bool) -> tuple[FloatArray, float]:
        """Of Gauss-Newton, (unknowns,), linear ones first; and how far that is, in squared deviations. ``held``: no
        unknown is left without a weight of its own."""
        every, innovation = self.every, self.innovation
        scale = np.maximum(np.linalg.norm(every, axis=1), 1e-300)
        matrix, right = (every / scale[:, None]) @ (every / scale[:, None]).T, every @ innovation / scale
        variance = self.regression.alike * float(innovation @ innovation) / innovation.size
        if held:
            matrix[np.diag_indices(len(matrix))] += variance / (scale * self._vague) ** 2
        whole = np.linalg.lstsq(matrix, right, rcond=1e-13)[0]
        return np.asarray(whole / scale), float(right @ whole) / max(variance, 1e-300)

    @property
    def _vague(self) -> FloatArray:
        linear = np.full(self.linear.size, 1.0)
        physical = self.linear[: len(LINEAR)]
        linear[: len(LINEAR)] = VAGUE_RELATIVE * np.maximum(np.abs(physical), 1e-12)
        shape = np.array([VAGUE_RELATIVE, VAGUE_RELATIVE, VAGUE_S, VAGUE_S])
        terms = _scales(self.regression, self.shape)
        return np.concatenate([linear, shape, VAGUE_RELATIVE * terms])

    def moved(self, step: FloatArray) -> tuple[Shape, FloatArray]:
        """Shape and linear unknowns a ``step`` further, within the box."""
        count = self.linear.size
        low, high = box(self.regression, self.shape)
        shape = self.shape.at(np.clip(self.shape.as_array() + step[count:], low, high))
        return shape, self.linear + step[:count]

    def cost(self, shape: Shape, linear: FloatArray) -> float:
        """At another point near by; what the friction remembers is taken off as here."""
        regression, first = self.regression, self.regression.nominal.size
        model = JointModel(shape, linear[:first], regression.cogging)
        predicted = regression.prediction(model) + linear[first:] @ self.columns[first:]
        left = self.memory.taken_off(regression.target() - predicted)
        return float(left @ left)

    def solution(self, *, converged: bool) -> Solution:
        """What the search ends with."""
        innovation = self.innovation
        rest = self.regression.target() - self.linear @ self.columns
        free = self.regression.free
        return Solution(
            shape=self.shape,
            linear=self.linear,
            residual=rest - self.memory.factors(rest) * self.memory.left,
            innovation=innovation,
            jacobian=self.every.T,
            free=free,
            contamination=np.zeros(self.linear.size + len(free)),
            cost=float(innovation @ innovation),
            regression=self.regression,
            converged=converged,
        )


def solve_behind(near: Solution, terms: Sequence[NetworkTerm], zero_nm: float) -> Solution:
    """The stretches of the solution ``near`` by a motor with ``terms``, one of which is a joint.

    Relative values, as in Shape; those of a joint that ``near`` has not are searched for. ``zero_nm`` is the sensor's.
    """
    shape = replace(near.shape, terms=tuple(terms))
    before, wanted = joint_of(near.shape.terms), joint_of(terms)
    if wanted is None or wanted.name != "compliance":
        raise ValueError("no fit finds the width of a play: ask for the term compliance")
    linear = near.linear[: len(LINEAR)]
    if before is not None and wanted == before:
        begins = [(start, linear) for start in velocity_starts(near.regression, shape)]
    else:
        begins = [_begun_on_pieces(near, shape, linear, zero_nm)]
    plain = replace(_plain(near.regression), cogging=()).with_terms(terms, zero_nm, near.regression.middle_s)
    at = min((_first(plain, *each) for each in begins), key=lambda point: float(point.innovation @ point.innovation))
    at, near_by = _descend(at, most_steps=MOST_STEPS, within=ROUGH_STEP)
    if not near_by:  # a search that does not settle even roughly has no end, and every step takes seconds
        return at.solution(converged=False)
    at = _with_cogging(at)
    at, converged = _descend(at, most_steps=MOST_STEPS, within=CONVERGED_STEP)
    return at.solution(converged=converged)


def solve_again(stretches: tuple[Signals, ...], near: Solution) -> Solution:
    """The same fit of another record of the same experiment, with or without a joint.

    Behind a joint, one step from ``near``: the same instants are used, and the friction is taken to be forgotten in the
    same rests. Slopes are the record's own. Errors of the motion's readings are in them and in what is left alike, and
    bias both fits alike; slopes of the real record would have hidden that.
    """
    before = near.regression
    if not isinstance(before, JointRegression):
        return separable.solve_again(stretches, near)
    rows = tuple(
        replace(own, signals=replace(other, usable=own.signals.usable, rests=own.signals.rests))
        for own, other in zip(before.rows, stretches, strict=True)
    )
    at = _Point.of(replace(before, rows=rows), near.shape, near.linear)
    step, _ = at.step(held=False)
    left = at.innovation - step @ at.every
    return replace(
        near,
        shape=near.shape.at(near.shape.as_array() + step[near.linear.size :]),
        linear=near.linear + step[: near.linear.size],
        residual=left,
        innovation=left,
        jacobian=at.every.T,
        cost=float(left @ left),
        regression=at.regression,
    )


def remaining_power(stretches: tuple[Signals, ...], near: Solution) -> float:
    """Mean square of what ``near`` leaves of another record of the same experiment, with or without a joint."""
    if isinstance(near.regression, JointRegression):
        return float(np.mean(solve_again(stretches, near).innovation ** 2))
    return separable.remaining_power(stretches, near)


def _plain(regression: Regression) -> Regression:
    """Of a motor without a joint, with no filter for what counts leave unknown."""
    rows = tuple(replace(each, friction_error=None) for each in regression.rows)
    return Regression(rows, cogging=regression.cogging, scales=regression.scales)


def _first(plain: Regression, shape: Shape, linear: FloatArray) -> _Point:
    """The regression of a motor behind a joint at a first point, with the sensor's zero that suits it."""
    regression = JointRegression.behind(plain, np.zeros(len(LINEAR) + 2 * len(plain.cogging)))
    regression = regression.linearised_at(linear)
    bias = regression.bias()
    left = regression.target() - regression.prediction(regression.model(shape))
    zero = np.linalg.lstsq(bias.T, left, rcond=1e-12)[0]
    return _Point.of(regression, shape, np.concatenate([linear, zero]))


def _descend(at: _Point, *, most_steps: int, within: FloatArray, held: bool = False) -> tuple[_Point, bool]:
    """Gauss-Newton with halving, until a step is ``within`` that. Returns where it ended and whether it converged."""
    scales = _scales(at.regression, at.shape)
    close = np.concatenate([within, within[0] * scales])
    longest = np.concatenate([LONGEST_STEP, LONGEST_STEP[0] * scales])
    for _ in range(most_steps):
        step, squared_deviations = at.step(held=held)
        if np.all(np.abs(step[at.linear.size :]) < close) or squared_deviations < NOTHING_GAINED:
            return at, True
        step *= _shortened(at, step, longest)
        cost = float(at.innovation @ at.innovation)
        trials = (at.moved(share * step) for share in STEP_SHARES)
        better = next((trial for trial in trials if at.cost(*trial) < cost), None)
        if better is None:
            return at, squared_deviations < LITTLE_GAINED
        at = _Point.of(at.regression, *better)
    return at, False


def _scales(regression: JointRegression, shape: Shape) -> FloatArray:
    """Of the terms' parameters: a change of a logarithm by one, or one that matters as much."""
    logarithmic = np.array([one.logarithmic for _, one in _parameters(shape)])
    return np.where(logarithmic, 1.0, regression.steps(shape)[4:] / STEP)


def _shortened(at: _Point, step: FloatArray, longest: FloatArray) -> float:
    """The share of a step that leads no further than slopes may be trusted."""
    count = at.linear.size
    physical = np.abs(at.linear[: len(LINEAR)])
    known = physical > 0.0
    over = [np.max(np.abs(step[count:]) / longest)]
    over.append(np.max(np.abs(step[: len(LINEAR)][known]) / (LONGEST_SHARE * physical[known])))
    return float(1.0 / max(1.0, *over))


def _with_cogging(at: _Point) -> _Point:
    """The same with every wave that stands out of what is left."""
    for _ in range(MOST_COGGINGS):
        regression, count = at.regression, at.regression.nominal.size
        rest = at.regression.target() - at.linear @ at.columns
        left = rest - at.memory.factors(rest) * at.memory.left
        position = regression.position(at.shape)
        periods = strongest_period(position, left, regression.alike)
        if periods is None or not is_new(periods, regression.cogging, position):
            break
        linear = np.concatenate([at.linear[:count], np.zeros(2), at.linear[count:]])
        more = replace(regression, cogging=(*regression.cogging, periods))
        at, _ = _descend(_Point.of(more, at.shape, linear), most_steps=MOST_STEPS, within=ROUGH_STEP)
    return at


def _begun_on_pieces(near: Solution, shape: Shape, linear: FloatArray, zero_nm: float) -> tuple[Shape, FloatArray]:
    """The best point of a search over a few pieces of the record, for all starts of the joint."""
    middle_s = near.regression.middle_s
    regression = Regression.of(_pieces(near), near.regression.rows[0].kernel)
    plain = regression.with_terms(shape.terms, zero_nm, middle_s)
    points = [
        _descend(_first(plain, *start), most_steps=FIRST_STEPS, within=ROUGH_STEP, held=True)[0]
        for start in _joint_starts(shape, linear, _greatest_hz(plain))
    ]
    points.sort(key=lambda point: float(point.innovation @ point.innovation))
    ends = (_descend(each, most_steps=PIECE_STEPS, within=ROUGH_STEP, held=True)[0] for each in points[:KEPT_STARTS])
    best = min(ends, key=lambda point: float(point.innovation @ point.innovation))
    return best.shape, best.linear[: len(LINEAR)]


def _joint_starts(shape: Shape, linear: FloatArray, greatest_hz: float) -> Iterator[tuple[Shape, FloatArray]]:
    """The rigid motor's values, its inertia shared out between motor and output, and joints of some stiffnesses."""
    joint = joint_of(shape.terms)
    assert joint is not None
    motor = linear.copy()
    motor[INERTIA] /= 1.0 + START_OUTPUT
    for frequency_hz in (each for each in START_HZ if each < greatest_hz):
        rate = 2 * np.pi * frequency_hz
        begun = {
            JOINT_STIFFNESS: rate**2,
            JOINT_DAMPING: 2 * START_RATIO * rate,
            OUTPUT_INERTIA: START_OUTPUT,
        }
        values = tuple(begun[each.column] for each in joint.term.parameters)
        terms = tuple(replace(joint, values=values) if each is joint else each for each in shape.terms)
        yield replace(shape, terms=terms), motor


def _parameters(shape: Shape) -> list[tuple[NetworkTerm, TermParameter]]:
    return [(each, parameter) for each in shape.terms for parameter in each.term.parameters]


def _greatest_hz(regression: Regression) -> float:
    """Half the rate of the readings: none of them tells a joint that rings faster from a rigid one."""
    return 0.5 / regression.rows[0].signals.tick_s


def box(regression: Regression, shape: Shape) -> tuple[FloatArray, FloatArray]:
    """The box searched: least and greatest values of the shape's unknowns, (unknowns,) each, in their order."""
    low, high = limits(regression.rows[0].signals.tick_s)
    spans = [_span(regression, shape, *each) for each in _parameters(shape)]
    return np.array([*low, *(span[0] for span in spans)]), np.array([*high, *(span[1] for span in spans)])


def _span(regression: Regression, shape: Shape, term: NetworkTerm, parameter: TermParameter) -> tuple[float, float]:
    if term.term.factor is not Factor.JOINT:
        return span_of(regression, parameter)
    rates = [2 * np.pi * each for each in (LEAST_HZ, _greatest_hz(regression))]
    critical = 2 * float(np.sqrt(shape.row[JOINT_STIFFNESS]))
    return {
        JOINT_STIFFNESS: (2 * float(np.log(rates[0])), 2 * float(np.log(rates[1]))),
        JOINT_DAMPING: (0.0, MOST_RATIO * critical),
        OUTPUT_INERTIA: (0.0, HEAVIEST_OUTPUT),
    }[parameter.column]


def _pieces(near: Solution) -> tuple[Signals, ...]:
    """The pieces of the record in which much is carried and the rigid motor is off the most, in order of time."""
    regression, pieces = near.regression, list[tuple[float, Signals, int, int]]()
    first, target = 0, near.regression.target()
    for rows in regression.rows:
        power, torque = np.zeros(rows.count), np.zeros(rows.count)
        own = slice(first, first := first + rows.usable.size)
        power[rows.usable], torque[rows.usable] = near.residual[own] ** 2, target[own] ** 2
        length = min(rows.count, round(PIECE_S / rows.signals.tick_s))
        for start in range(0, rows.count - length + 1, max(length, 1)):
            part = slice(start, start + length)
            weight = float(np.sum(power[part]) * np.sum(torque[part]))
            pieces.append((weight, rows.signals, start, start + length))
    chosen = sorted(pieces, key=lambda piece: -piece[0])[:PIECES]
    return tuple(_cut(*piece[1:]) for piece in sorted(chosen, key=lambda piece: piece[1].time_s[piece[2]]))


def _cut(signals: Signals, first: int, last: int) -> Signals:
    """From one index of its instants to another."""
    part, fine = slice(first, last), slice(first * FINE, last * FINE)
    rests = signals.rests[(signals.rests > first) & (signals.rests < last)] - first
    torque = None if signals.torque_nm is None else signals.torque_nm[part]
    return replace(
        signals,
        time_s=signals.time_s[part],
        position_rad=signals.position_rad[fine],
        path_rad=signals.path_rad[fine],
        segment=signals.segment[part],
        usable=signals.usable[part],
        rests=rests,
        torque_nm=torque,
    )
