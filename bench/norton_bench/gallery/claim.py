"""A claim of the paper as a result: rows of expected and measured values, and a picture."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.distributions import t_quantile
from norton_bench.errors import ExperimentError
from norton_bench.identification.averages import velocity_of
from norton_bench.procedures.waves import hold, imposed, pushed, ramp, sweep
from norton_bench.records import Measured, SegmentInfo
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

Interval = tuple[float, float]


@dataclass(frozen=True)
class Estimated:
    """A value with the interval that its own repetitions give it (:mod:`norton_bench.gallery.claim`)."""

    value: float
    interval: Interval


@dataclass(frozen=True)
class Row:
    """One figure of a claim, in ``unit``. ``expected`` is the closed form with the simulated machine's true values.

    ``rival`` is what the figure would be were the claim false, NaN where there is no such value: an interval that is
    too wide to exclude it shows nothing.
    """

    claim: str
    what: str
    unit: str
    expected: float
    found: float
    interval: Interval
    rival: float = float("nan")

    @property
    def passed(self) -> bool:
        low, high = self.interval
        return low <= self.expected <= high and not low <= self.rival <= high


def row(claim: str, what: str, unit: str, expected: float, found: Estimated, rival: float = float("nan")) -> Row:
    return Row(claim, what, unit, expected, found.value, found.interval, rival)


@dataclass(frozen=True)
class Shown:
    """A claim after its experiment; ``caption`` explains the picture that ``draw`` makes."""

    name: str
    title: str
    section: str  # of the paper
    says: str
    rows: tuple[Row, ...]
    draw: Callable[[], Figure]
    caption: str


@dataclass(frozen=True)
class PaperExperiment:
    """What was measured on one rig, and what is true of its actuator, by the names of ``sim truth``.

    ``torque_zero_nm`` is what the torque sensor read at the start, with nothing at the port; ``load`` is the bench's
    own calibration of its load drive.
    """

    rig: Rig
    measured: Measured
    true: Mapping[str, float]
    torque_zero_nm: float = 0.0
    load: LoadCalibration | None = None

    def segments(self, procedure: str, name: str) -> list[SegmentInfo]:
        """Those of a procedure that have this name, in the order of time."""
        return [each for each in self.measured.segments if each.procedure == procedure and each.name == name]


@dataclass(frozen=True)
class Look:
    """``label`` is the segment's name, in words; torque as it was read, with whatever the sensor's zero adds."""

    label: tuple[str, ...]
    command: float
    velocity_rad_s: float
    torque_nm: float


def looks(measured: Measured, procedure: str, look_s: float) -> Iterator[Look]:
    """At the last ``look_s`` of every segment of ``procedure``. Raises ExperimentError where readings are missing."""
    for segment in measured.segments:
        if segment.procedure == procedure:
            yield _look(measured, segment, look_s)


def pairs(found: Iterable[Look]) -> Iterator[tuple[Look, Look]]:
    """An experiment and its mirror image, which comes next."""
    all_of_them = list(found)
    yield from zip(all_of_them[::2], all_of_them[1::2], strict=True)


def _look(measured: Measured, segment: SegmentInfo, look_s: float) -> Look:
    end = measured.between(max(segment.start_ns, segment.end_ns - round(look_s * 1e9)), segment.end_ns)
    if len(end.motion) < 3 or not len(end.torque) or not len(end.ticks):
        raise ExperimentError(f'the end of "{segment.procedure}: {segment.name}" was hardly recorded; run it again')
    return Look(
        label=tuple(segment.name.split()),
        command=float(np.mean(end.ticks["command"])),
        velocity_rad_s=velocity_of(end.motion),
        torque_nm=float(np.mean(end.torque["torque_nm"][end.torque["valid"]])),
    )


# One interval in a thousand misses by chance: of a gallery of 44 rows, one gallery in twenty-three.
LEVEL = 0.999


def mean(values: npt.ArrayLike) -> Estimated:
    """Of independent repetitions (n,)."""
    repetitions = np.asarray(values, dtype=float)
    half = _student(repetitions.size - 1) * float(np.std(repetitions, ddof=1)) / np.sqrt(repetitions.size)
    return _around(float(np.mean(repetitions)), half)


def wider(found: Estimated, by: float) -> Estimated:
    """With a tolerance that no repetition shows."""
    low, high = found.interval
    return Estimated(found.value, (low - by, high + by))


class StraightLine:
    """A straight line through independent points (n,), by least squares."""

    def __init__(self, x: npt.ArrayLike, y: npt.ArrayLike) -> None:
        self._x = np.asarray(x, dtype=float)
        values = np.asarray(y, dtype=float)
        self._middle = float(np.mean(self._x))
        self._spread = float(np.sum((self._x - self._middle) ** 2))
        self._slope = float(np.sum((self._x - self._middle) * values)) / self._spread
        self._mean = float(np.mean(values))
        self._freedom = values.size - 2
        left = values - self.at(self._x)
        self._scatter = float(np.sqrt(np.sum(left**2) / self._freedom))

    def at(self, x: npt.ArrayLike) -> FloatArray:
        return self._mean + self._slope * (np.asarray(x, dtype=float) - self._middle)

    @property
    def slope(self) -> Estimated:
        return _around(self._slope, _student(self._freedom) * self._scatter / np.sqrt(self._spread))

    def value(self, x: float) -> Estimated:
        """Of the line itself at ``x``."""
        return _around(float(self.at(x)), _student(self._freedom) * self._deviation(x))

    def zero(self) -> Estimated:
        """Where the line crosses zero: Fieller's interval, of all places where zero lies in the line's own interval."""
        zero = self._middle - self._mean / self._slope
        t = _student(self._freedom)
        g = (t * self._scatter / self._slope) ** 2 / self._spread
        if g >= 1.0:
            return Estimated(zero, (-np.inf, np.inf))
        centre = self._middle + (zero - self._middle) / (1 - g)
        half = t * self._scatter / abs(self._slope) / (1 - g)
        half *= np.sqrt((1 - g) / self._x.size + (zero - self._middle) ** 2 / self._spread)
        return Estimated(zero, (centre - float(half), centre + float(half)))

    def _deviation(self, x: float) -> float:
        return float(self._scatter * np.sqrt(1 / self._x.size + (x - self._middle) ** 2 / self._spread))


def _student(freedom: int) -> float:
    return t_quantile(0.5 + 0.5 * LEVEL, freedom)


def _around(value: float, half: float) -> Estimated:
    return Estimated(value, (value - float(half), value + float(half)))


# Moves to a place of the actuator's shaft, for plants that have places: a muscle, a pendulum.
def place_rad(measured: Measured) -> float:
    """Where the actuator's shaft stands at the end."""
    return float(measured.motion["position_rad"][-1])


def swept(procedure: str, name: str, command: float, distance_rad: float, speed_rad_s: float, tick_s: float) -> Segment:
    """A sweep as imposed motion, under one command."""
    motion = sweep(distance_rad, speed_rad_s, tick_s)
    return imposed(procedure, name, Use.PREPARE, np.full(len(motion.velocity_rad_s), command), motion)


def let_go(
    procedure: str, name: str, command: float, before: Measured, easing_s: float, rest_s: float, tick_s: float
) -> Segment:
    """The load's torque goes from what it was slowly to none; the shaft follows as far as friction lets it."""
    held_nm = float(np.mean(before.ticks["load_torque_nm"][-round(0.1 / tick_s) :]))
    torque_nm: FloatArray = np.concatenate([ramp(held_nm, 0.0, easing_s, tick_s), hold(0.0, rest_s, tick_s)])
    return pushed(procedure, name, Use.PREPARE, torque_nm, np.full(len(torque_nm), command))
