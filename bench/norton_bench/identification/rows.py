"""One stretch of a recording as rows of the regression: every term at the same instants and in the same band.

The same low-pass stands before every term, so it cancels. A sensor that averages by itself has filtered its torque once
more, and so every other term is averaged over as long here. :class:`Aligned` is torque, motion and command in that way,
whatever is to be made of them.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.counts import REACH, Resolution, unquantised
from norton_bench.identification.fed_back import fed_back, fed_back_of, position_errors
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.shape import Shape
from norton_bench.identification.signals import FINE, Signals, TimeSeries
from norton_bench.models.terms import Factor

MOST_RECENT = 6


class _Recent(dict[tuple[Hashable, ...], FloatArray]):
    """The few paths worked out last: differences that stand for derivatives ask for each again and again."""

    def once(self, key: tuple[Hashable, ...], make: Callable[[], FloatArray]) -> FloatArray:
        if key not in self:
            while len(self) >= MOST_RECENT:
                del self[next(iter(self))]
            self[key] = make()
        return self[key]


COUNTED_DRAWS = 2
# The zero of such an encoder wanders at about this rate, now faster, now slower, so that what is slow meets all phases
# of the counts, and no motion that repeats itself always the same; for friction that is no motion.
WANDERS_COUNTS_S = 10.0
SWAYS_COUNTS = 3.0
NO_RESTS = np.empty(0, dtype=np.int64)


def friction_error(signals: Signals, s_per_rad: float) -> FloatArray | None:
    """What an encoder's counts do to the friction on average, found by counting the motion again.

    Friction follows every turning back, so errors of its path do not cancel: counts that are left in it make the
    shaft travel too far, smoothing that takes them out cuts its turns. One reading of the motion tells neither. But
    the smoothed path is a motion too, and known: counted once more by encoders whose counts lie elsewhere, and
    smoothed as before, it gives a friction that differs from its own about as its own, on average, differs from the
    true one (a bootstrap of the bias: of the right sign, and mostly within half of its size).

    How much too great the friction's share h is along ``path_rad``, shape (n · FINE,); None without counts.
    """
    if signals.smoothed is None or signals.counts.width == 0.0 or signals.smoothed.value.size <= 2 * REACH:
        return None
    smoothed = signals.smoothed
    own, *again = (
        loops.friction_path(path, s_per_rad, NO_RESTS)[0]
        for path in (smoothed.value, *_counted_again(smoothed, signals.counts))
    )
    fine_s = signals.time_s[0] + np.arange(signals.path_rad.size) * (signals.tick_s / FINE)
    return np.asarray(np.interp(fine_s, smoothed.time_s, np.mean(again, axis=0) - own))


def _counted_again(smoothed: TimeSeries, counts: Resolution) -> Iterator[FloatArray]:
    wander = WANDERS_COUNTS_S * smoothed.time_s + SWAYS_COUNTS * np.sin(smoothed.time_s)
    for draw in range(COUNTED_DRAWS):
        moved_rad = counts.count * (wander + draw / COUNTED_DRAWS)
        yield unquantised(counts.read(smoothed.value + moved_rad), counts.width) - moved_rad


@dataclass(frozen=True)
class Rows:
    """The rows of the regression at every ``stride``-th usable instant of one stretch."""

    signals: Signals
    kernel: Kernel
    stride: int = 1
    friction_error: FloatArray | None = None  # of h along the path, what is known of it
    zero_nm: float = 0.0  # of the torque sensor, where friction depends on the load
    middle_s: float = 0.0  # of the session, for what changes with time
    _recent: _Recent = field(default_factory=_Recent, init=False, repr=False, compare=False)
    _waves: dict[float, tuple[FloatArray, FloatArray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )  # by periods a turn, before any filter: the same at every step of the search

    @property
    def fine(self) -> int:
        """How many times a tick motion and lag are worked out: where not every tick counts, once will do."""
        return FINE if self.stride == 1 else 1

    def _grid(self, motion: FloatArray) -> FloatArray:
        return motion if self.fine == FINE else np.ascontiguousarray(motion[::FINE])

    @cached_property
    def usable(self) -> npt.NDArray[np.int64]:
        """Which of the rows may be fitted."""
        return np.flatnonzero(self.signals.usable[:: self.stride])

    @property
    def count(self) -> int:
        return -(-self.signals.usable.size // self.stride)

    @cached_property
    def averaging(self) -> Kernel:
        """The kernel for all but the torque, whose sensor has averaged already."""
        return self.kernel.averaging(self.signals.torque_averaging_s / self.signals.tick_s)

    def torque(self, shift_s: float = 0.0) -> FloatArray:
        """The filtered torque, ``shift_s`` later, shape (count,); zero where nothing measures it."""
        torque = self.signals.torque_nm
        return np.zeros(self.count) if torque is None else self._at_ticks(torque[None, :], shift_s, self.kernel)[0]

    def of_tick_signal(self, values: FloatArray, shift_s: float = 0.0) -> FloatArray:
        """Any signal but the torque, given at the ticks, filtered."""
        return np.asarray(self.of_tick_signals(values[None, :], shift_s)[0])

    def of_tick_signals(self, values: FloatArray, shift_s: float = 0.0) -> FloatArray:
        """Several at once: from (signals, ticks) to (signals, count)."""
        return self._at_ticks(values, shift_s, self.averaging)

    def _at_ticks(self, values: FloatArray, shift_s: float, kernel: Kernel) -> FloatArray:
        return np.stack([self._derivatives(row, (0,), shift_s, kernel)[0] for row in values])

    def derivatives(self, values: FloatArray, derivatives: tuple[int, ...], shift_s: float = 0.0) -> FloatArray:
        """Of any signal but the torque, given at the ticks, filtered: shape (derivatives, count)."""
        return self._derivatives(values, derivatives, shift_s, self.averaging)

    def torque_derivatives(self, derivatives: tuple[int, ...]) -> FloatArray:
        """The same of the torque; zero where nothing measures it."""
        torque = self.signals.torque_nm
        if torque is None:
            return np.zeros((len(derivatives), self.count))
        return self._derivatives(torque, derivatives, 0.0, self.kernel)

    def _derivatives(
        self, values: FloatArray, derivatives: tuple[int, ...], shift_s: float, kernel: Kernel
    ) -> FloatArray:
        taps = _fine_taps(kernel, derivatives, shift_s, self.signals.tick_s, 1, of_means=False)
        return np.asarray(loops.filter_at(values, taps, -(taps.shape[1] // 2), self.stride, self.count))

    def lag(self, shape: Shape) -> FloatArray:
        """The amplifier's lag of what it is told, per unit of gain, (count,): the command, or what a servo makes of
        it and of where the shaft is."""
        result = self.of_fine_signal(self._driven(shape), (0,), -shape.command_delay_s, of_means=True)[0]
        if self.signals.servo is not None and not shape.changes(Factor.GAIN):
            result = result - self.held_back(shape)
        return np.asarray(result)

    def lag_rate(self, shape: Shape) -> FloatArray:
        """Change in time of what the command has in it, (count,)."""
        lag = self._driven(shape) if self.signals.servo is None else self._lag_of_command(shape)
        return np.asarray(self.of_fine_signal(lag, (1,), -shape.command_delay_s, of_means=True)[0])

    def _driven(self, shape: Shape) -> FloatArray:
        """The lag of the command, or with a term of the gain that of all that is asked for, as the terms change it."""
        lag, servo = self._lag_of_command(shape), self.signals.servo
        if not shape.changes(Factor.GAIN):
            return lag
        # The command that was sent at an instant acts later, and the motion then is read later still.
        fine_s = self.signals.tick_s / self.fine
        cells = (shape.command_delay_s + shape.motion_delay_s) / fine_s
        if servo is not None:
            place = self._lag_of_place(shape)
            lag = lag - fed_back_of(servo, place, fine_s, cells * fine_s)
        return lag * shape.gain(lag, loops.later(self._grid(self.signals.path_rad), cells), self._fine_time_s)

    def held_back(self, shape: Shape, derivative: int = 0) -> FloatArray:
        """What a servo takes off its command behind the amplifier's lag, (count,), or its rate."""
        servo, lag = self.signals.servo, self._lag_of_place(shape)
        assert servo is not None
        return fed_back(servo, lambda late_s: self.of_fine_signal(lag, (derivative,), shape.motion_delay_s - late_s)[0])

    def _lag_of_command(self, shape: Shape) -> FloatArray:
        """Its means about the motion's instants."""
        signals, bandwidth = self.signals, shape.bandwidth_rad_s
        fine_s, count = signals.tick_s / self.fine, signals.time_s.size * self.fine
        return self._recent.once(
            ("lag", bandwidth),
            lambda: loops.mean_lag_of_held(
                signals.sent_s,
                signals.command,
                bandwidth,
                signals.time_s[0],
                fine_s,
                count,
                signals.released_at_zero,
            ),
        )

    def _lag_of_place(self, shape: Shape) -> FloatArray:
        """The same lag of the shaft's angle, at the motion's instants."""
        bandwidth, fine_s = shape.bandwidth_rad_s, self.signals.tick_s / self.fine
        return self._recent.once(
            ("place", bandwidth), lambda: loops.lag_of(self._grid(self.signals.position_rad), bandwidth * fine_s)
        )

    def kinematics(self, shape: Shape) -> FloatArray:
        """ω and ω̇, shape (2, count)."""
        return self._recent.once(
            ("kinematics", shape.motion_delay_s),
            lambda: self.of_fine_signal(self._grid(self.signals.position_rad), (1, 2), shape.motion_delay_s),
        )

    def position(self, shape: Shape) -> FloatArray:
        """θ and ω, shape (2, count)."""
        return self.of_fine_signal(self._grid(self.signals.position_rad), (0, 1), shape.motion_delay_s)

    def friction(self, shape: Shape) -> FloatArray:
        """h, ḣ/s and E, shape (3, count)."""
        path = self._friction_path(shape)
        sliding = self.of_fine_signal(self._corrected(path[0]), (0, 1), shape.motion_delay_s, of_means=True)
        left = self.of_fine_signal(path[1], (0,), shape.motion_delay_s, of_means=True)
        return np.stack([sliding[0], sliding[1] / shape.s_per_rad, left[0]])

    def _friction_path(self, shape: Shape) -> FloatArray:
        """h and what is left of an unknown state along the path, shape (2, ...)."""
        path, rests, s_per_rad = self.signals.path_rad, self.signals.rests, shape.s_per_rad
        if not shape.changes(Factor.STRENGTH):
            return self._recent.once(
                ("friction", s_per_rad), lambda: loops.friction_path(self._grid(path), s_per_rad, rests * self.fine)
            )
        return self._recent.once(
            ("friction", s_per_rad, shape.motion_delay_s, shape.row.tobytes()),
            lambda: loops.friction_path_of(self._grid(path), s_per_rad, rests * self.fine, self._strengths(shape)),
        )

    def _strengths(self, shape: Shape) -> FloatArray:
        """γ along the path, shape (...,)."""
        port_nm = loops.later(self._port_nm, -shape.motion_delay_s / self.signals.tick_s * self.fine)
        return shape.strength(self._velocity, self._grid(self.signals.path_rad), port_nm, self._fine_time_s)

    @property
    def _time_s(self) -> FloatArray:
        """At the rows, (count,), from the middle of the session on."""
        return np.asarray(self.signals.time_s[:: self.stride] - self.middle_s)

    @cached_property
    def _fine_time_s(self) -> FloatArray:
        """At the motion's instants, from the middle of the session on."""
        signals = self.signals
        step_s = signals.tick_s / self.fine
        return np.asarray(signals.time_s[0] + np.arange(signals.time_s.size * self.fine) * step_s - self.middle_s)

    @cached_property
    def _velocity(self) -> FloatArray:
        """Of the path, through the low-pass, at the motion's instants."""
        path = self._grid(self.signals.path_rad)
        taps = _fine_taps(FULL_BAND, (1,), 0.0, self.signals.tick_s, self.fine, of_means=False)
        return np.asarray(loops.filter_at(path, taps, -(taps.shape[1] // 2), 1, path.size)[0])

    @cached_property
    def _port_nm(self) -> FloatArray:
        """The torque at the port, through the low-pass, at the motion's instants; zero where nothing measures it."""
        signals = self.signals
        if signals.torque_nm is None:
            return np.zeros(self._grid(signals.path_rad).size)
        taps = _fine_taps(FULL_BAND, (0,), 0.0, signals.tick_s, 1, of_means=False)
        count = signals.torque_nm.size
        smooth = loops.filter_at(signals.torque_nm - self.zero_nm, taps, -(taps.shape[1] // 2), 1, count)[0]
        return np.asarray(np.interp(np.arange(count * self.fine) / self.fine, np.arange(count), smooth))

    def _corrected(self, h: FloatArray) -> FloatArray:
        """Without what counts do to it on average, as far as that is known."""
        return h if self.friction_error is None else h - self._grid(self.friction_error)

    def rates(self, shape: Shape, cogging: tuple[float, ...]) -> FloatArray:
        """Change in time of all that moves: columns from INERTIA to DAMPING, each wave of cogging's two, and E, shape
        (5 + 2 · waves, count)."""
        motion = self.of_fine_signal(self._grid(self.signals.position_rad), (2, 3), shape.motion_delay_s)
        path = self._friction_path(shape)
        # The slope of D·|ω|·ω is 2·D·|ω|.
        motion[0] *= shape.damping(2.0 * self.kinematics(shape)[0], self._time_s)
        sliding = self.of_fine_signal(self._corrected(path[0]), (1, 2), shape.motion_delay_s, of_means=True)
        left = self.of_fine_signal(path[1], (1,), shape.motion_delay_s, of_means=True)
        waves = [self.cogging(shape, periods, 1) for periods in cogging]
        return np.concatenate([-motion[::-1], -sliding / [[1.0], [shape.s_per_rad]], *waves, -left])

    def recounted(self, shape: Shape) -> "Rows":
        """With what counts do to the friction on average taken off, as found at ``shape``."""
        return replace(self, friction_error=friction_error(self.signals, shape.s_per_rad))

    def cogging(self, shape: Shape, periods: float, derivative: int = 0) -> FloatArray:
        """Cosine and sine of so many periods a turn, or their change in time, shape (2, count)."""
        if periods not in self._waves:
            angle = periods * self._grid(self.signals.position_rad)
            self._waves[periods] = (np.cos(angle), np.sin(angle))
        return np.concatenate(
            [self.of_fine_signal(wave, (derivative,), shape.motion_delay_s) for wave in self._waves[periods]]
        )

    def memory(self) -> npt.NDArray[np.int64]:
        """After which rest each instant lies, shape (count,): from 0, before the first."""
        return np.searchsorted(self.signals.rests, np.arange(self.count) * self.stride, side="right")

    def noise(self) -> FloatArray:
        """Variances that readings' own errors give to the torque, the acceleration and the velocity, shape (3,)."""
        torque, (velocity, acceleration) = self.torque_noise(0), (self.motion_noise(order) for order in (1, 2))
        return np.array([torque, acceleration, velocity])

    def torque_noise(self, derivative: int) -> float:
        """The variance that readings' own errors give to a derivative of the torque."""
        tick_s = self.signals.tick_s
        return self.signals.torque_noise * self.kernel.energy(derivative) / tick_s ** (2 * derivative + 1)

    def motion_noise(self, derivative: int) -> float:
        """The same of the motion."""
        tick_s = self.signals.tick_s
        return self.signals.position_noise * self.averaging.energy(derivative) / tick_s ** (2 * derivative + 1)

    def position_errors(self, shape: Shape) -> FloatArray:
        """What the position readings' own errors add to the products of a servo's columns, (5, 5), in the mean."""
        signals = self.signals
        assert signals.servo is not None
        errors = position_errors(signals.servo, shape.bandwidth_rad_s, self.averaging, signals.tick_s)
        return np.asarray(signals.position_noise * errors)

    def columns(self, shape: Shape) -> FloatArray:
        """The five physical columns in the order of LINEAR, then E: shape (6, count)."""
        h, rate, left = self.friction(shape)
        return np.stack([self.lag(shape), -self.kinematics(shape)[1], -self.damped(shape), -h, -rate, -left])

    def damped(self, shape: Shape) -> FloatArray:
        """b·ω, shape (count,)."""
        velocity = self.kinematics(shape)[0]
        return np.asarray(velocity * shape.damping(velocity, self._time_s))

    def of_fine_signal(
        self, values: FloatArray, derivatives: tuple[int, ...], shift_s: float, *, of_means: bool = False
    ) -> FloatArray:
        """Derivatives of any signal given at the motions' instants, filtered: shape (derivatives, count)."""
        tick_s = self.signals.tick_s
        taps = _fine_taps(self.averaging, derivatives, shift_s, tick_s, self.fine, of_means)
        reach = taps.shape[1] // 2
        return np.asarray(loops.filter_at(values, taps, -reach, self.stride * self.fine, self.count))


@lru_cache(maxsize=64)  # every stretch asks for the same, and one step of the search for several of the last's
def _fine_taps(
    kernel: Kernel, derivatives: tuple[int, ...], shift_s: float, tick_s: float, fine: int, of_means: bool
) -> FloatArray:
    """Shape (derivatives, taps), of a signal known ``fine`` times a tick; not to be written to."""
    reach = int(np.ceil(kernel.half_width + abs(shift_s) / tick_s)) * fine
    offsets = np.arange(-reach, reach + 1) / fine - shift_s / tick_s
    return np.stack([kernel.taps(offsets, order, of_means=of_means) / tick_s**order for order in derivatives])


# As a bandwidth, this makes no lag: the command as it is held.
NO_LAG_RAD_S = 1e9


@dataclass(frozen=True)
class Aligned:
    """One stretch at its ticks, arrays of shape (n,), all through one low-pass, on the torque's time.

    ``command`` is the command as it was held, not delayed: what comes of it later is for others to find out.
    """

    rows: Rows
    motion_delay_s: float
    torque_nm: FloatArray
    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    command: FloatArray

    @property
    def signals(self) -> Signals:
        return self.rows.signals

    @property
    def usable(self) -> npt.NDArray[np.bool_]:
        return self.signals.usable


def align(stretches: Sequence[Signals], motion_delay_s: float) -> tuple[Aligned, ...]:
    """Every stretch; positive ``motion_delay_s`` where motion comes later than torque."""
    return tuple(_align(Rows(stretch, FULL_BAND), motion_delay_s) for stretch in stretches)


def usable_of(stretches: Sequence[Aligned], parts: Sequence[FloatArray]) -> FloatArray:
    """Parts (..., n), one a stretch, cut to what may be used and joined."""
    return np.concatenate([part[..., each.usable] for part, each in zip(parts, stretches, strict=True)], axis=-1)


def _align(rows: Rows, motion_delay_s: float) -> Aligned:
    signals = rows.signals
    held = loops.mean_lag_of_held(
        signals.sent_s,
        signals.command,
        NO_LAG_RAD_S,
        signals.time_s[0],
        signals.tick_s / FINE,
        signals.position_rad.size,
        signals.released_at_zero,
    )
    position, velocity, acceleration = rows.of_fine_signal(signals.position_rad, (0, 1, 2), motion_delay_s)
    return Aligned(
        rows,
        motion_delay_s,
        rows.torque(),
        position,
        velocity,
        acceleration,
        rows.of_fine_signal(held, (0,), 0.0, of_means=True)[0],
    )
