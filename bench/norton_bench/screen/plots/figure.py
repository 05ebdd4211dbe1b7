"""What a plot shows, as plain data: traces, markers, names and units."""

from dataclasses import dataclass
from math import ceil, floor, isfinite, log10

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.report.words import pretty_unit

NOTHING_YET = "nothing measured yet"


@dataclass(frozen=True)
class Trace:
    """One curve or cloud, arrays of shape (n,), in SI units. ``style`` is 0 for the main one, 1 beside it, 2 faint."""

    x: FloatArray
    y: FloatArray
    style: int = 0
    dashed: bool = False
    cloud: bool = False


@dataclass(frozen=True)
class Markers:
    """A character at each point."""

    x: FloatArray
    y: FloatArray
    sign: str
    style: int = 0


@dataclass(frozen=True)
class Axis:
    """What an axis is called, its unit, and the least range that is worth looking at. ``span`` fixes the range."""

    name: str
    unit: str
    least_span: float
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class Figure:
    """One plot. ``growing`` means that x is time. ``latest`` is said at the right of its heading."""

    title: str
    x: Axis
    y: Axis
    traces: tuple[Trace, ...] = ()
    markers: tuple[Markers, ...] = ()
    latest: str = ""
    legend: str = ""  # what the second style is
    growing: bool = False
    feet: bool = True  # numbers below; not where the plot beneath shares them
    empty: str = NOTHING_YET


Range = tuple[float, float]

MARGIN = 0.06
# A range narrows only once less than this share of it is in use, so that it stands still meanwhile.
NARROW_BELOW = 0.45
STEPS = 10  # a range ends on tidy numbers, about so many of them long
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"))
_MANTISSAS = (1.0, 2.0, 5.0, 10.0)


def settled(before: Range | None, values: FloatArray, least_span: float) -> Range:
    """Ranges that do not fidget, ticks that read well, and units with a prefix where they need one.

    The range to show ``values`` in: the one ``before`` as long as it fits them well.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return before or (-least_span / 2, least_span / 2)
    low, high = float(known.min()), float(known.max())
    span = max(high - low, least_span)
    middle = (high + low) / 2
    low, high = min(low, middle - span / 2), max(high, middle + span / 2)
    if before is not None and before[0] <= low and high <= before[1] and span > NARROW_BELOW * (before[1] - before[0]):
        return before
    step = tidy_step(span / STEPS)
    return floor((low - MARGIN * span) / step) * step, ceil((high + MARGIN * span) / step) * step


def tidy_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10, 20 ... (and their tenths) that is not below ``least``."""
    if not (isfinite(least) and least > 0):
        return 1.0
    power = 10.0 ** floor(log10(least))
    return float(next(power * mantissa for mantissa in _MANTISSAS if power * mantissa >= least * (1 - 1e-9)))


def ticks(span: Range, most: int) -> list[float]:
    """At most ``most`` tidy places within the range."""
    low, high = span
    if most < 1 or not high > low:
        return []
    step = tidy_step((high - low) / most)
    first = ceil(low / step - 1e-9)
    return [number * step for number in range(first, floor(high / step + 1e-9) + 1)][:most]


def label(value: float, step: float) -> str:
    """A tick's number, with the digits that its step leaves meaning."""
    decimals = max(0, -floor(log10(step) + 1e-9)) if step > 0 else 0
    text = f"{value:.{decimals}f}"
    return "0" if float(text) == 0 else text.replace("-", "−")


def prefixed(greatest: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which numbers up to ``greatest`` are easy to read: 0.003 N*m as 3 mN·m."""
    factor, prefix = next(
        (pair for pair in PREFIXES if greatest >= pair[0]), PREFIXES[-1] if greatest > 0 else PREFIXES[0]
    )
    pretty = pretty_unit(unit)
    return (1.0 / factor, f"{prefix}{pretty}") if pretty[:1].isalpha() else (1.0, pretty)
