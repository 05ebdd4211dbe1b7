"""Maps that have an inverse on their domain, as tables of it: of one argument, or of one beside a parameter."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.networks.expressions import Table
from norton_bench.networks.kinds import NoConversionError

# Places at which a map is looked at; a table has no more nodes.
PLACES = 4097
FEWEST = 65
# A table of two arguments has as many of each.
SIDE = 129
# Of the range of values: a table of one argument gets nodes until it is as near as this.
TOLERANCE = 1e-6
WORST = 1e-3
HALVINGS = 60

Range = tuple[float, float]


@dataclass(frozen=True)
class Inverse:
    """``table`` gives the argument for a value in ``domain``, to within ``error`` (in the argument's unit)."""

    table: Table
    domain: Range
    error: float


def inverse_of(function: Callable[[FloatArray], FloatArray], bounds: Range, what: str, name: str) -> Inverse:
    """The inverse of y = function(x) for x in ``bounds``; ``what`` and ``name`` say in a refusal what y and x are.

    Raises NoConversionError, in a sentence that says where, for a map that does not rise or fall throughout.
    """
    places = np.linspace(*bounds, PLACES)
    return _inverted(places, _strictly(places, function(places), what, name))


def _strictly(places: FloatArray, values: FloatArray, what: str, name: str) -> FloatArray:
    values = np.broadcast_to(np.asarray(values, dtype=float), places.shape)
    if not np.isfinite(values).all():
        where = places[int(np.argmin(np.isfinite(values)))]
        raise NoConversionError(f"{what} is not finite at {name} = {where:.4g}; narrow the domain")
    steps = np.diff(values)
    wrong = np.flatnonzero(steps * steps[0] <= 0.0)
    if wrong.size:
        word = "stays" if not steps[wrong[0]] else "turns"
        raise NoConversionError(
            f"{what} {word} at {name} = {places[wrong[0]]:.4g}, so it has no inverse there; narrow the domain to where "
            "it rises or falls throughout"
        )
    return values


def _inverted(places: FloatArray, values: FloatArray) -> Inverse:
    order = slice(None) if values[-1] > values[0] else slice(None, None, -1)
    places, values = places[order], values[order]
    last = len(places) - 1
    step = 2 ** max(0, (last // (FEWEST - 1)).bit_length() - 1)

    def error_of(every: int) -> tuple[list[int], float]:
        nodes = sorted({*range(0, last + 1, every), last})
        return nodes, float(np.abs(np.interp(values, values[nodes], places[nodes]) - places).max())

    nodes, error = error_of(step)
    while error > TOLERANCE * np.ptp(places) and step > 1:
        step //= 2
        nodes, error = error_of(step)
    if step == 1:  # nothing lies between the nodes: of every other one, lines are off by four times as much
        error = error_of(2)[1] / 4.0
    table = Table((tuple(values[nodes].tolist()),), tuple(places[nodes].tolist()))
    return Inverse(table, (float(values[0]), float(values[-1])), error)


def inverse_beside(
    function: Callable[[FloatArray, FloatArray], FloatArray], beside: Range, bounds: Range, what: str, name: str
) -> Inverse:
    """The inverse of y = function(s, x) in x, for each s in ``beside``: a table of s and y.

    ``domain`` is that of y which has an x for every s. Raises NoConversionError as :func:`inverse_of`, where no y has,
    and where the table would be off by more than ``WORST`` of the range of x.
    """
    finer = np.linspace(*beside, 2 * SIDE - 1)
    places = np.linspace(*bounds, PLACES)
    rows = [_strictly(places, function(np.full_like(places, each), places), what, name) for each in finer]
    rising = rows[0][-1] > rows[0][0]
    if any((row[-1] > row[0]) != rising for row in rows):
        raise NoConversionError(f"{what} rises with {name} at some sources and falls at others; narrow the domain")
    order = slice(None) if rising else slice(None, None, -1)
    low, high = max(row[order][0] for row in rows), min(row[order][-1] for row in rows)
    if not low < high:
        raise NoConversionError(
            f"no value of {what} is reached within the domain of {name} at every source; widen that domain, or narrow "
            "the source's"
        )
    values = np.linspace(low, high, 2 * SIDE - 1)
    exact = np.array([np.interp(values, row[order], places[order]) for row in rows])
    table = Table(
        (tuple(finer[::2].tolist()), tuple(values[::2].tolist())),
        tuple(tuple(row) for row in exact[::2, ::2].tolist()),
    )
    return Inverse(
        table, (float(low), float(high)), float(np.abs(table(*np.meshgrid(finer, values, indexing="ij")) - exact).max())
    )


def zeros_along(
    function: Callable[[FloatArray, FloatArray], FloatArray], beside: Range, bounds: Range, what: str, name: str
) -> tuple[FloatArray, FloatArray]:
    """Places s of ``beside``, and for each the x in ``bounds`` at which function(s, x) is zero, as far as there is one.

    Raises NoConversionError where the sign does not change once, and where fewer than two s have a zero.
    """
    sources, places = np.linspace(*beside, PLACES), np.linspace(*bounds, PLACES)
    rough = sources[:: (PLACES - 1) // (FEWEST - 1)]
    for each in rough:
        _strictly(places, function(np.full_like(places, each), places), what, name)
    low, high = (np.full_like(sources, bound) for bound in bounds)
    at_low, at_high = function(sources, low), function(sources, high)
    has = at_low * at_high <= 0.0
    if np.count_nonzero(has) < 2:
        raise NoConversionError(f"{what} has no zero in the domain of {name}; widen it")
    sources, low, high, at_low = sources[has], low[has], high[has], at_low[has]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        before = function(sources, middle) * np.sign(at_low) > 0.0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return sources, 0.5 * (low + high)


def inverse_of_points(places: FloatArray, values: FloatArray, what: str, name: str) -> Inverse:
    """The inverse of a map that is known at rising ``places``; raises as :func:`inverse_of` does."""
    return _inverted(places, _strictly(places, values, what, name))
