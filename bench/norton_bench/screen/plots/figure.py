"""What a plot shows, as plain data: traces, markers, names and units."""

from dataclasses import dataclass

from norton_bench.arrays import FloatArray

NOTHING_YET = "nothing measured yet"


@dataclass(frozen=True)
class Trace:
    """One curve or cloud, arrays of shape (n,), in SI units. ``tone`` is 0 for the main one, 1 beside it, 2 faint."""

    x: FloatArray
    y: FloatArray
    tone: int = 0
    dashed: bool = False
    cloud: bool = False


@dataclass(frozen=True)
class Markers:
    """A character at each point."""

    x: FloatArray
    y: FloatArray
    sign: str
    tone: int = 0


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
    legend: str = ""  # what the second tone is
    growing: bool = False
    feet: bool = True  # numbers below; not where the plot beneath shares them
    empty: str = NOTHING_YET
