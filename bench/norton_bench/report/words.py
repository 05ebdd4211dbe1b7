"""Numbers as text for readers; and the glossary of the report."""

import re
from dataclasses import dataclass
from math import floor, isfinite, log10

from norton_bench.models.parameters import BY_NAME, Estimate, Parameter
from norton_bench.models.terms import TERM_PARAMETERS


# What a section of the report is made of.
@dataclass(frozen=True)
class Facts:
    """A small table: its head and its rows, all text."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure as SVG. ``purpose`` says in a sentence what it is for, ``caption`` what is drawn in it."""

    markup: str
    purpose: str
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, sentences, pictures and tables; ``points`` are sentences that stand in a list below the others."""

    name: str  # the anchor
    title: str
    sentences: tuple[str, ...] = ()
    figures: tuple[Picture, ...] = ()
    tables: tuple[Facts, ...] = ()
    points: tuple[str, ...] = ()


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NO_NUMBER = "–"
_UNIT_WORDS = (("N*m*s/rad", "N·m·s/rad"), ("kg*m^2", "kg·m²"), ("N*m", "N·m"), ("**", "^"), ("*", "·"), ("^2", "²"))

_OVER_ITSELF = re.compile(r"(.+)/\(\1\)|(\w+)/\2")


def pretty_unit(unit: str) -> str:
    """A unit with its proper signs: "kg*m^2" is written kg·m². One over itself, as in "A/(A)", is none."""
    for plain, proper in _UNIT_WORDS:
        unit = unit.replace(plain, proper)
    return "" if _OVER_ITSELF.fullmatch(unit) else unit


def number(value: float, digits: int = 4) -> str:
    """``digits`` significant digits, with a power of ten where that is shorter to read."""
    if not isfinite(value):
        return NO_NUMBER
    if value == 0.0:
        return "0"
    exponent = _exponent(value, digits)
    if -4 < exponent < 6:
        return f"{value:.{max(0, digits - 1 - exponent)}f}".replace("-", "−")
    return f"{value / 10.0**exponent:.{digits - 1}f}".replace("-", "−") + power(exponent)


def _exponent(value: float, digits: int) -> int:
    """The power of ten of ``value`` rounded to so many digits: 9.9999e-4 in four digits is 1.000e-3."""
    return int(f"{value:.{max(digits, 1) - 1}e}".partition("e")[2])


def power(exponent: int) -> str:
    """ "·10⁻⁵", or nothing for 10⁰."""
    return f"·10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else ""


def to_its_digits(value: float, std: float) -> str:
    """The value alone, to two digits of its standard deviation: "5.002·10⁻⁵"."""
    if not isfinite(value):
        return NO_NUMBER
    if not isfinite(std) or std <= 0.0:
        return number(value)
    scale = scale_of(value)
    decimals = max(0, 1 - floor(log10(std / 10.0**scale)))
    return f"{value / 10.0**scale:.{decimals}f}".replace("-", "−") + power(scale)


def within(value: float, half_width: float) -> str:
    """Value ± half of its interval, to one digit of the latter and never with a power of ten: "0.16 ± 0.03"."""
    if not isfinite(value):
        return NO_NUMBER
    if not isfinite(half_width) or half_width <= 0.0:
        return number(value)
    decimals = max(0, -floor(log10(half_width)))
    return " ± ".join(f"{x:.{decimals}f}".replace("-", "−") for x in (value, half_width))


def interval(value: float, std: float) -> str:
    """The 95 % interval of a normal distribution, to the same digits as :func:`to_its_digits`."""
    if not (isfinite(value) and isfinite(std)) or std <= 0.0:
        return NO_NUMBER
    scale = scale_of(value)
    decimals = max(0, 1 - floor(log10(std / 10.0**scale)))
    low, high = (f"{(value + side * 1.96 * std) / 10.0**scale:.{decimals}f}".replace("-", "−") for side in (-1, 1))
    return f"({low} … {high}){power(scale)}" if scale else f"{low} … {high}"


def between(value: float, interval: tuple[float, float]) -> tuple[str, str]:
    """A value and its interval, to two digits of a quarter of the interval's width, with one power of ten for both."""
    low, high = interval
    if not isfinite(value):
        return NO_NUMBER, NO_NUMBER
    if not (isfinite(low) and isfinite(high)) or high <= low:
        return number(value), _open(low, high)
    scale = scale_of(max(abs(value), high - low))
    decimals = max(0, 1 - floor(log10((high - low) / 4 / 10.0**scale)))
    middle, *ends = (f"{x / 10.0**scale:.{decimals}f}".replace("-", "−") for x in (value, low, high))
    span = " … ".join(ends)
    return (middle + power(scale), f"({span}){power(scale)}") if scale else (middle, span)


def _open(low: float, high: float) -> str:
    if isfinite(low):
        return f"above {number(low, 3)}"
    return f"below {number(high, 3)}" if isfinite(high) else NO_NUMBER


def percent(ratio: float) -> str:
    return f"{number(100 * ratio, 2)} %" if isfinite(ratio) else NO_NUMBER


def symbol(estimate: Estimate) -> str:
    """The paper's symbol for a parameter, or its name where the paper has none."""
    parameter = parameter_named(estimate.name)
    return estimate.name if parameter is None else parameter.symbol


def parameter_named(name: str) -> Parameter | None:
    """The parameter of that name, of the plain motor or of a term; None where no table has it."""
    return BY_NAME.get(name) or TERM_PARAMETERS.get(name)


def in_prefixed_unit(greatest: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which values up to ``greatest`` are easy to read: 0.003 N·m as 3 mN·m."""
    small = 0.0 < abs(greatest) < 0.1
    return (1e3, f"m{pretty_unit(unit)}") if small and unit[:1] in ("N", "r") else (1.0, pretty_unit(unit))


def scale_of(value: float) -> int:
    """The power of ten to write in front: none for numbers of everyday size."""
    exponent = _exponent(value, 3) if value else 0
    return exponent if not -2 <= exponent < 5 else 0


TERMS: tuple[tuple[str, str], ...] = (
    ("port", "the actuator's output shaft: where its torque and its motion are measured, and where a load is coupled"),
    ("command (c)", "what is sent to the drive, in the unit that the rig file gives"),
    (
        "motion source (N)",
        "the motion that the shaft makes under a command when nothing holds or drives it: no torque at the port",
    ),
    (
        "impedance",
        "the torque that the actuator exerts when its shaft moves otherwise than the motion source: from friction, "
        "damping and inertia",
    ),
    (
        "Norton network",
        "motion source and impedance together: a full model of the actuator as its load feels it (Hogan 2014)",
    ),
    ("blocked", "with the shaft held still"),
    ("breakaway", "where a command becomes strong enough to move the shaft against friction"),
    (
        "presliding",
        "the motion, some milliradians, in which a friction contact bends like a spring before it slides",
    ),
    (
        "95 % interval",
        "in 95 of 100 repeated measurements of the same actuator such an interval holds the true value, if the model "
        "is right",
    ),
    ("±", "in a table: the 95 % interval reaches so far to either side of the number before it"),
    ("residual", "what is left of a measured torque when the model's prediction is subtracted"),
    ("rms", "root mean square: the usual size of a signal or an error"),
    (
        "kept apart from the fit",
        "recorded in the same session, but not used to find the parameters; so a fair test of the prediction",
    ),
    ("valid (status)", "known well enough to use; the 95 % interval holds"),
    ("learning (status)", "known, but not yet well enough to rely on; a longer session helps"),
    ("unexcited (status)", "the motion recorded says nothing of it"),
    ("at bound (status)", "the search ended at the edge of what it was allowed, so this is no result"),
    ("ratio only (status)", "known only up to a factor that it shares with other parameters"),
    ("not converged (status)", "the search did not come to an end, so this is no result"),
    ("inadequate (status)", "the actuator does something that the model lacks, and this value depends on it"),
    ("doubtful (status)", "the data contradict the model or themselves, so this is no result"),
)
