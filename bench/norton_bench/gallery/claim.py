"""What a claim of the paper comes to: rows of expected beside found, and a picture."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from matplotlib.figure import Figure

from norton_bench.records import Measured
from norton_bench.rig.rig import Rig

Interval = tuple[float, float]


@dataclass(frozen=True)
class Estimated:
    """A value with the interval that its own repetitions give it (:mod:`norton_bench.gallery.repeated`)."""

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
class Experiment:
    """What was measured on one rig, and what is true of its actuator, by the names of ``sim truth``.

    ``torque_zero_nm`` is what the torque sensor read at the start, with nothing at the port.
    """

    rig: Rig
    measured: Measured
    true: Mapping[str, float]
    torque_zero_nm: float = 0.0
