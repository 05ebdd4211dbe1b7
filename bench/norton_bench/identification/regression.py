"""The impedance form as a regression: what is linear once lag, friction's shape and delays are given.

    τ(t) = Km·Ka·lag_β(c)(t − d_c) − Im·ω̇ − B·ω − τc·h − σ1·ḣ/s + bias + E,   motion at t + d_m,  h = s·φ

E is what is left of the friction's unknown state at the end of each rest; it fades as the shaft turns, and whatever
looks like it is taken off every term. The same low-pass stands before every term, so it cancels; a sensor that averages
by itself has filtered its torque once more, and so every other term is averaged over as long here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.fed_back import SharedErrors
from norton_bench.identification.friction_operators import linear_basis
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.rows import Rows
from norton_bench.identification.shape import (
    COULOMB,
    DAMPING,
    GAIN,
    INERTIA,
    LINEAR,
    MOTION_DELAY,
    SMALL,
    SMALL_S,
    STILL,
    VISCOUS,
    Shape,
)
from norton_bench.identification.signals import Signals
from norton_bench.identification.turns import Turns, Whitening
from norton_bench.models.terms import (
    DAMPING_BEND,
    DAMPING_DRIFT,
    DRAG,
    FRICTION_BEND,
    FRICTION_DRIFT,
    GAIN_BEND,
    GAIN_DRIFT,
    LOAD,
    SATURATION,
    Factor,
    NetworkTerm,
    TermParameter,
    parameters_of,
)

# The torque sensor's zero may wander this slowly.
DRIFT_KNOT_S = 60.0


@dataclass(frozen=True)
class Memory:
    """What is left of unknown states of the friction, one a rest, each with an unknown factor: all solved for at once.

    ``left`` (samples,) in order of time, ``edges`` where each rest's samples begin and the last one's end, ``power``
    the sum of squares of ``left`` over each.
    """

    left: FloatArray
    edges: npt.NDArray[np.int64]
    power: FloatArray

    @classmethod
    def of(cls, left: FloatArray, rest: npt.NDArray[np.int64]) -> "Memory":
        edges = np.concatenate([[0], np.flatnonzero(np.diff(rest)) + 1, [rest.size]])
        power = np.add.reduceat(left**2, edges[:-1])
        return cls(left, edges, np.where(power > 0, power, 1.0))

    def columns(self) -> FloatArray:
        """What a state of 1 after each rest leaves, shape (rests, samples)."""
        columns = np.zeros((self.power.size, self.left.size))
        for column, start, end in zip(columns, self.edges, self.edges[1:], strict=False):
            column[start:end] = self.left[start:end]
        return columns

    def factors(self, values: FloatArray) -> FloatArray:
        """The states after each rest that explain ``values`` (samples,) best, repeated for each of its samples."""
        factors = np.add.reduceat(values * self.left, self.edges[:-1]) / self.power
        return np.repeat(factors, np.diff(self.edges))

    def taken_off(self, values: FloatArray) -> FloatArray:
        """What no unknown state could have made of ``values``, shape (..., samples)."""
        rows = np.ascontiguousarray(values).reshape(-1, self.left.size)
        return loops.without_memory(rows, self.left, self.edges, self.power).reshape(values.shape)


@dataclass(frozen=True)
class Regression:
    """All stretches together.

    ``free_motion`` solves the same equation for ω̇ instead of τ, which stays sound as τ vanishes: linear unknowns are
    then those of LINEAR over the inertia, and the inertia's column is -τ with the unknown 1/Im. It stands on the
    motion's time: d_c is then relative to the motion, and d_m moves the torque.
    """

    rows: tuple[Rows, ...]
    free_motion: bool = False
    cogging: tuple[float, ...] = ()  # periods a turn of torques that go with the position
    whitening: Whitening | None = None  # of the rows, where turns have been counted
    scales: FloatArray = field(default_factory=lambda: np.empty(0))  # of the terms' parameters, relative as in Shape

    @classmethod
    def of(
        cls,
        stretches: tuple[Signals, ...],
        kernel: Kernel,
        stride: int = 1,
        *,
        free_motion: bool = False,
        cogging: tuple[float, ...] = (),
    ) -> "Regression":
        return cls(tuple(Rows(stretch, kernel, stride) for stretch in stretches), free_motion, cogging)

    def with_terms(self, terms: Sequence[NetworkTerm], zero_nm: float, middle_s: float) -> "Regression":
        """The same for shapes with such terms; ``zero_nm`` is that of the torque sensor, ``middle_s`` the session's."""
        rows = tuple(replace(each, zero_nm=zero_nm, middle_s=middle_s) for each in self.rows)
        sizes = np.array([self._size(parameter) for parameter in parameters_of(terms)])
        return replace(self, rows=rows, scales=sizes)

    @property
    def count_rad(self) -> float:
        """The greatest width of the steps in which positions are read; 0 where none can be seen."""
        return max(rows.signals.counts.width for rows in self.rows)

    @property
    def middle_s(self) -> float:
        """Of the time that all stretches span."""
        times_s = [rows.signals.time_s[[0, -1]] for rows in self.rows]
        return 0.5 * float(np.min(times_s) + np.max(times_s))

    def terms_of(self, other: "Regression") -> "Regression":
        """``other`` for shapes with the terms that this one is for."""
        own = self.rows[0]
        rows = tuple(replace(each, zero_nm=own.zero_nm, middle_s=own.middle_s) for each in other.rows)
        return replace(other, rows=rows, scales=self.scales)

    @cached_property
    def rms_velocity(self) -> float:
        """Of all that is fitted [rad/s]."""
        return float(np.sqrt(np.mean(self._speed**2)))

    def _size(self, parameter: TermParameter) -> float:
        """Of a term's parameter: at this value its factor differs from one by about one, somewhere."""
        time_s = self.time_s() - self.rows[0].middle_s
        signals = {LOAD: self._target, DRAG: self._speed, SATURATION: self._command**2}
        signals |= dict.fromkeys((GAIN_DRIFT, DAMPING_DRIFT, FRICTION_DRIFT), time_s)
        signals |= dict.fromkeys((GAIN_BEND, DAMPING_BEND, FRICTION_BEND), time_s**2)
        greatest = float(np.max(np.abs(signals.get(parameter.column, np.ones(1)))))
        return 1.0 / greatest if greatest > 0.0 else 1.0

    @property
    def _speed(self) -> FloatArray:
        return self.chosen([rows.kinematics(STILL)[0] for rows in self.rows])

    @property
    def _command(self) -> FloatArray:
        return np.concatenate([rows.signals.command for rows in self.rows])

    def recounted(self, shape: Shape) -> "Regression":
        """The same, corrected for what counts do to the friction on average."""
        return replace(self, rows=tuple(rows.recounted(shape) for rows in self.rows))

    def whitened(
        self, shape: Shape, coulomb: float, residual: FloatArray, like: Whitening | None = None
    ) -> "Regression":
        """The same, by what counts leave unknown at every turn of the path.

        ``coulomb`` and ``residual`` (samples,) as found at ``shape``; rows near turns have the weights of ``like``.
        """
        if self.count_rad == 0.0:
            return self
        turns, known_again = self._turns(shape)
        width = abs(coulomb) * self.count_rad / np.sqrt(self.alike * np.mean(residual**2))
        found = Whitening.likeliest(turns, known_again, shape.s_per_rad, residual, width)
        weighed = found.weighed(turns.near, residual) if like is None else found.weighed_by(turns.near, like.wider)
        return replace(self, whitening=weighed)

    def whitened_as(self, shape: Shape, like: Whitening | None) -> "Regression":
        """The same, with turns as unknown and with weights as in ``like``, that of another record."""
        if like is None:
            return self
        turns, known_again = self._turns(shape)
        found = Whitening.of_known(turns, known_again, shape.s_per_rad, like.width)
        return replace(self, whitening=found.weighed_by(turns.near, like.wider))

    def _turns(self, shape: Shape) -> tuple[Turns, npt.NDArray[np.int64]]:
        """Of the path, at every row, and the rows at which their errors begin anew."""
        reach = self.rows[0].kernel.half_width
        turns = Turns.joined([Turns.of(rows.signals, shape.s_per_rad, reach).at(rows.usable) for rows in self.rows])
        return turns, np.flatnonzero(np.diff(self._rest, prepend=-1))

    def white(self, values: FloatArray) -> FloatArray:
        """``values`` (k, samples) as least squares should see them."""
        return values if self.whitening is None else self.whitening.of(values)

    def white_memory(self, memory: "Memory") -> "Memory":
        """The same of what the friction may remember: the filter begins anew after every rest."""
        return memory if self.whitening is None else Memory.of(self.white(memory.left[None, :])[0], self._rest)

    @property
    def free(self) -> tuple[int, ...]:
        """Which of Shape's unknowns can be estimated: without torque only one delay has a meaning."""
        measured = all(rows.signals.torque_nm is not None for rows in self.rows)
        terms = range(MOTION_DELAY + 1, MOTION_DELAY + 1 + self.scales.size)
        return (0, 1, 2, 3, *terms) if measured else (0, 1, 2, *terms)

    @property
    def alike(self) -> float:
        """So many neighbouring rows, made alike by the low-pass, count as one."""
        rows = self.rows[0]
        return max(1.0, 0.5 / (rows.kernel.cutoff * rows.stride))

    def chosen(self, parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Parts of shape (..., count), one a stretch, cut to their usable instants and joined."""
        cut = [part.take(rows.usable, axis=-1) for part, rows in zip(parts, self.rows, strict=True)]
        return np.concatenate(cut, axis=-1)

    def target(self) -> FloatArray:
        """What the columns explain, shape (samples,)."""
        return self._target

    @cached_property  # the same at every step of the search, as are the others below
    def _target(self) -> FloatArray:
        if self.free_motion:
            return self.chosen([rows.kinematics(STILL)[1] for rows in self.rows])
        return self.chosen([rows.torque() for rows in self.rows])

    def time_s(self) -> FloatArray:
        return self.chosen([rows.signals.time_s[:: rows.stride] for rows in self.rows])

    def segment(self) -> npt.NDArray[np.int64]:
        return self.chosen([rows.signals.segment[:: rows.stride] for rows in self.rows])

    def columns(self, shape: Shape) -> tuple[FloatArray, "Memory"]:
        """Physical columns, cogging, bias: shape (unknowns, samples); and what the friction may remember."""
        own = self._on_own_time(shape)
        parts = [rows.columns(own) for rows in self.rows]
        chosen = self.chosen(parts)
        if self.free_motion:
            chosen[INERTIA] = -self._torque_at(shape.motion_delay_s)
        waves = [self.chosen([rows.cogging(own, periods) for rows in self.rows]) for periods in self.cogging]
        return np.concatenate([chosen[:5], *waves, self.bias()]), Memory.of(chosen[5], self._rest)

    @cached_property
    def _rest(self) -> npt.NDArray[np.int64]:
        """A number for each rest of each stretch, at every sample."""
        numbers, first = [], 0
        for rows in self.rows:
            memory = rows.memory()
            numbers.append(first + memory)
            first += int(memory[-1]) + 1
        return self.chosen(numbers)

    def shared_contamination(self, shape: Shape) -> SharedErrors | None:
        """What they add to the products of two different ones; None where that is nothing."""
        if self.rows[0].signals.servo is None:
            return None
        total = sum((rows.position_errors(shape) * rows.usable.size for rows in self.rows), np.zeros((5, 5)))
        products = (total - np.diag([0.0, *np.diag(total)[1:]])) * self.white_energy
        return SharedErrors(np.asarray(products), self.free_motion)

    def shared_slope(self, shape: Shape, linear: FloatArray) -> float:
        """Half of how what they add to the squares of the residual changes with log β, at these linear unknowns."""
        quicker = replace(shape, bandwidth_rad_s=shape.bandwidth_rad_s * np.exp(SMALL))
        now, then = (self.shared_contamination(each) for each in (shape, quicker))
        return 0.0 if now is None or then is None else 0.5 * (then.square(linear) - now.square(linear)) / SMALL

    def contamination(self) -> FloatArray:
        """What readings' own errors add to the squares of the physical columns, shape (5,): expected sums."""
        total = np.zeros(5)
        for rows in self.rows:
            torque, acceleration, velocity = rows.noise() * rows.usable.size
            total[VISCOUS] += velocity
            total[INERTIA] += torque if self.free_motion else acceleration
        return total * self.white_energy

    def carried(self, linear: FloatArray) -> FloatArray:
        """By what the variances of Rows.noise() come into the torque at these linear unknowns, shape (3,)."""
        return np.array([1.0, linear[INERTIA] ** 2, linear[VISCOUS] ** 2])

    def noise_left(self, linear: FloatArray) -> float:
        """The mean square that readings' own errors leave of the target at these linear unknowns."""
        torque, acceleration, viscous = 1.0, linear[INERTIA] ** 2, linear[VISCOUS] ** 2
        if self.free_motion:
            torque, acceleration = acceleration, torque
        counts = [rows.usable.size for rows in self.rows]
        each = [rows.noise() @ [torque, acceleration, viscous] for rows in self.rows]
        return float(np.average(each, weights=counts))

    def slope_contamination(self, linear: FloatArray) -> float:
        """The same of the change with d_m: noise in it makes d_m look better known than it is."""
        inertia, viscous = linear[INERTIA], linear[VISCOUS]
        squares = (
            inertia**2 * rows.torque_noise(1)
            if self.free_motion
            else inertia**2 * rows.motion_noise(3) + viscous**2 * rows.motion_noise(2)
            for rows in self.rows
        )
        sizes = (rows.usable.size for rows in self.rows)
        return self.white_energy * float(sum(square * size for square, size in zip(squares, sizes, strict=True)))

    @property
    def white_energy(self) -> float:
        """The mean share of the squares of something quick, such as white noise, that is left for least squares."""
        return 1.0 if self.whitening is None else self.whitening.energy

    def position(self, shape: Shape) -> FloatArray:
        """Of the shaft when the torque acts, shape (samples,): its readings come earlier or later."""
        own = self._on_own_time(shape)
        return self.chosen([rows.position(own)[0] for rows in self.rows])

    def _on_own_time(self, shape: Shape) -> Shape:
        return replace(shape, motion_delay_s=0.0) if self.free_motion else shape

    def _torque_at(self, delay_s: float) -> FloatArray:
        """The torque that belongs to a motion whose readings come later by ``delay_s``."""
        return self.chosen([rows.torque(-delay_s) for rows in self.rows])

    def bias(self) -> FloatArray:
        """The sensor's slowly wandering zero, as linear basis functions of time: shape (knots, samples)."""
        return self._bias

    @cached_property
    def _bias(self) -> FloatArray:
        time_s = self.time_s()
        return linear_basis(time_s, round((time_s[-1] - time_s[0]) / DRIFT_KNOT_S) + 2)

    def jacobian(
        self,
        shape: Shape,
        columns: FloatArray,
        linear: FloatArray,
        memory: Memory | None = None,
        states: FloatArray | None = None,
    ) -> FloatArray:
        """Change of the prediction with (log β, log s, d_c, d_m) and the terms' parameters, (4 + parameters, samples).

        What is left of the friction's ``states`` (samples,) after rests changes with the shape, too (Golub and Pereyra
        1973); without them that is left out.
        """
        at = self._on_own_time(shape)
        other_lag = replace(at, bandwidth_rad_s=at.bandwidth_rad_s * np.exp(SMALL))
        other_s = replace(at, s_per_rad=at.s_per_rad * np.exp(SMALL))
        lag_rate = self.chosen([rows.lag_rate(at) for rows in self.rows])
        lag = self.chosen([rows.lag(other_lag) for rows in self.rows])
        left = np.zeros(columns.shape[1]) if memory is None else memory.left
        held = np.zeros(left.size) if states is None else states
        now = np.concatenate([columns[[COULOMB, DAMPING]], left[None, :]])
        friction = -self.chosen([rows.friction(other_s) for rows in self.rows]) - now
        return np.stack(
            [
                linear[GAIN] * (lag - columns[GAIN]) / SMALL,
                (linear[[COULOMB, DAMPING]] @ friction[:2] + held * friction[2]) / SMALL,
                -linear[GAIN] * lag_rate,
                self._motion_slope(shape, linear, held),
                *self._term_slopes(at, columns, linear, held, now[2]),
            ]
        )

    def _term_slopes(
        self, shape: Shape, columns: FloatArray, linear: FloatArray, states: FloatArray, left: FloatArray
    ) -> Iterator[FloatArray]:
        """Change of the prediction with each of the terms' parameters, (samples,) each; ``left`` as in Memory."""
        at = shape.as_array()
        factors = [each.term.factor for each in shape.terms for _ in each.values]
        for unknown, factor in enumerate(factors, MOTION_DELAY + 1):
            step = SMALL * self.scales[unknown - MOTION_DELAY - 1]
            moved = at.copy()
            moved[unknown] += step
            other = shape.at(moved)
            match factor:
                case Factor.GAIN:
                    lag = self.chosen([rows.lag(other) for rows in self.rows])
                    yield linear[GAIN] * (lag - columns[GAIN]) / step
                case Factor.DAMPING:
                    damped = self.chosen([rows.damped(other) for rows in self.rows])
                    yield -linear[VISCOUS] * (damped + columns[VISCOUS]) / step
                case Factor.STRENGTH:
                    friction = -self.chosen([rows.friction(other) for rows in self.rows])
                    change = friction - np.stack([columns[COULOMB], columns[DAMPING], left])
                    yield (linear[[COULOMB, DAMPING]] @ change[:2] + states * change[2]) / step

    def _motion_slope(self, shape: Shape, linear: FloatArray, states: FloatArray) -> FloatArray:
        """Change of the prediction with d_m, shape (samples,)."""
        if self.free_motion:
            around = (shape.motion_delay_s + side * SMALL_S for side in (0.5, -0.5))
            later, earlier = (self._torque_at(delay_s) for delay_s in around)
            return np.asarray(linear[INERTIA] * (earlier - later) / SMALL_S)
        waves = self.cogging if len(linear) > len(LINEAR) else ()  # whose size nobody asks for
        rates = self.chosen([rows.rates(shape, waves) for rows in self.rows])
        moving = len(LINEAR) + 2 * len(waves)
        slope = linear[INERTIA:moving] @ rates[:-1] + states * rates[-1]
        if self.rows[0].signals.servo is not None:
            slope -= linear[GAIN] * self.chosen([rows.held_back(shape, 1) for rows in self.rows])
        return np.asarray(slope)
