"""Quantities as people write them ("5 ms", "0.5 N*m", "60 %") to SI numbers, with their dimension checked."""

import re
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import BeforeValidator

if TYPE_CHECKING:
    from pint import UnitRegistry

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*")
RANGE = re.compile(rf"\s*({NUMBER}):({NUMBER}):({NUMBER})\s*(.*?)\s*")
MOST_IN_RANGE = 1000
# In the unit that is asked for: squares and products of two such numbers are still finite, and none is ever near it.
GREATEST = 1e18

# The units of an actuator bench and no others: pint's own thousands hold traps here ("Nm" is a number-metre, "MS" a
# megasiemens), and let an angle pass for a bare number, so that "100 Hz" would silently mean 100 rad/s. With the angle
# a dimension of its own, the two are told apart.
DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
meter = [length] = m
gram = [mass] = g
second = [time] = s
ampere = [current] = A
kelvin = [temperature]; offset: 0 = K
radian = [angle] = rad
bit = [information]
percent = 0.01
degree_celsius = kelvin; offset: 273.15 = degC
degree = 0.017453292519943295 * radian = deg
turn = 6.283185307179586 * radian = rev = revolution
minute = 60 * second = min
hour = 3600 * second = h
hertz = 1 / second = Hz
rpm = turn / minute
newton = kilogram * meter / second ** 2 = N
newton_meter = newton * meter = Nm
joule = newton * meter = J
watt = joule / second = W
volt = watt / ampere = V
ohm = volt / ampere = Ω
inch = 0.0254 * meter = in
foot = 0.3048 * meter = ft
pound_force = 4.4482216152605 * newton = lbf
ounce_force = 0.27801385095378125 * newton = ozf
"""
SPELLINGS = (("%", "percent"), ("°C", "degC"), ("°", "deg"), ("·", "*"))


@cache
def _registry() -> "UnitRegistry[float]":
    import pint  # noqa: PLC0415  (slow to import; most commands need no quantities)

    registry: UnitRegistry[float] = pint.UnitRegistry(None, autoconvert_offset_to_baseunit=True)
    for definition in DEFINITIONS.strip().splitlines():
        registry.define(definition)
    return registry


@cache
def _unit(text: str) -> Any:
    """A pint unit. Raises ValueError for what is none."""
    for written, known in SPELLINGS:
        text = text.replace(written, known)
    try:
        return _registry().Unit(text)
    except Exception as error:  # pint lets the errors of several parsers through
        raise ValueError(f"{text!r} is not a unit known here") from error


def example(unit: str) -> str:
    """How a quantity in ``unit`` is written, quotes included."""
    return f'"1 {unit}"' if unit else '"1"'


def check_unit(unit: str) -> str:
    """``unit`` as it stands. Raises ValueError, in a sentence, where it is none."""
    try:
        _unit(unit)
    except ValueError:
        raise ValueError(f'"{unit}" is not a unit known here; write it like "N*m", "A" or "V"') from None
    return unit


def same_dimension(unit: str, other: str) -> bool:
    """Whether a quantity in ``unit`` can be given in ``other``. Raises ValueError for what is no unit."""
    return bool(_unit(unit).dimensionality == _unit(other).dimensionality)


def conversion(unit: str, to: str) -> tuple[float, float]:
    """Factor and offset that turn a value in ``unit`` into one in ``to``.

    Raises ValueError, in a sentence, where either is no unit or their dimensions differ. A plane angle counts as one.
    """
    source, target = _unit(check_unit(unit)), _unit(to)
    if source.dimensionality != target.dimensionality:
        raise ValueError(f'"{unit}" cannot be given in {to or "a plain number"}; write {example(to)[3:-1]} or like it')
    quantity = _registry().Quantity
    offset = float(quantity(0.0, source).to(target).magnitude)
    # Taken at one: a large value would lose digits to the offset, a small one the other way.
    return float(quantity(1.0, source).to(target).magnitude) - offset, offset


def parse_quantity(text: object, unit: str) -> float:
    """The value of ``text`` in ``unit``.

    Raises ValueError, in a sentence, where ``text`` is no quantity, is a bare number although ``unit`` has a
    dimension, has another dimension than ``unit``, or is not finite. A plane angle counts as a dimension.
    """
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise ValueError(f"expected a quantity such as {example(unit)}, not {text!r}")  # noqa: TRY004
    match = QUANTITY.fullmatch(str(text))
    if match is None:
        raise ValueError(f'"{text}" is not a quantity; write it like {example(unit)}')
    return _convert(float(match[1]), match[2], unit, str(text))


def parse_range(text: object, unit: str) -> tuple[float, ...]:
    """The values of "first:step:last unit" in ``unit``, both ends included where the step meets them.

    Raises ValueError, in a sentence, as :func:`parse_quantity` does, and for a step that never arrives.
    """
    match = RANGE.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        raise ValueError(f'expected a range such as "-40:8:40 {unit}", not {text!r}')
    first, step, last = (_convert(float(match[place]), match[4], unit, str(text)) for place in (1, 2, 3))
    steps = (last - first) / step if step else -1.0
    if steps >= MOST_IN_RANGE:
        raise ValueError(f'the range "{text}" has more than {MOST_IN_RANGE} values; make its step greater')
    if steps < 0:
        raise ValueError(f'the range "{text}" does not get from its first value to its last; write first:step:last')
    return tuple(first + step * index for index in range(int(steps + 1e-9) + 1))


def _convert(value: float, written: str, unit: str, text: str) -> float:
    target = _unit(unit)
    if not written and not target.dimensionless:
        raise ValueError(f'"{text}" has no unit; write it like {example(unit)}')
    try:
        source = _unit(written)
    except ValueError:
        raise ValueError(f'"{written}" in "{text}" is not a unit known here; write it like {example(unit)}') from None
    if source.dimensionality != target.dimensionality:
        raise ValueError(f'"{text}" is not in {unit or "a plain number"}; write it like {example(unit)}')
    converted = float(_registry().Quantity(value, source).to(target).magnitude)
    if not abs(converted) <= GREATEST:
        raise ValueError(f'"{text}" is more than any bench meets; write it like {example(unit)}')
    return converted


def quantity_in(unit: str) -> BeforeValidator:
    """For a pydantic field, ``Annotated[float, quantity_in("s")]``: written as a quantity, held as a float."""
    return BeforeValidator(lambda text: parse_quantity(text, unit))


class Units(NamedTuple):
    """Of the actuator's command, and of its modulator's, as the rig file writes them; "" where there is none."""

    command: str
    modulation: str = ""
