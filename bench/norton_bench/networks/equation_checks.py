"""The paper's conditions (IV.B.1, VI.C) for networks of equations: looked for over the declared domain, numerically."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.networks.family import form_of, kind_of
from norton_bench.networks.findings import Finding, of_modes
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.nonlinear import NonlinearNetwork, advance, steps_in
from norton_bench.networks.settled import linearised, settled

# Of the source's places and the port's, which are broadcast to one shape.
Exertion = Callable[[FloatArray, FloatArray], FloatArray]
PLACES = 21
POINTS = 401
# An exertion below this part of the greatest in the domain is none.
NOTHING = 1e-9
# Places tried where the connection has states: it takes a motion to each.
STOPS, SOURCES = 41, 9
# An exertion of which no more than this is left when the states have settled is none: seven time constants.
RELAXED = 1e-3
# The same place, reached from both sides, has exertions that differ by less than this share, or remembers the way.
REMEMBERED = 1e-2
# A range of no exertion is one where it is this much wider than about a plain zero.
BROADER = 10.0
HALVINGS = 50  # of an interval of places, to the last digit


def conditions_of_equations(network: NonlinearNetwork, settle_s: float) -> Iterator[Finding]:
    if form_of(network) is not Form.IMPEDANCE:
        yield Finding(
            "impedance form", False, "an admittance form: an impedance form of it need not exist (section III)"
        )
        return
    yield Finding("impedance form", True, "the equations put out f for every motion")
    if kind_of(network) is not Kind.NORTON:
        yield Finding("source is a zero", False, "an exertion source is no zero of the impedance (section VI.C)")
        return
    try:
        yield from _zero(network, settle_s)
        yield _stability([linearised(network, each, settle_s=settle_s).zeros() for each in _commands(network)])
    except (UsageError, ZeroDivisionError) as error:
        yield Finding("stable zero dynamics", None, f"the network could not be linearised: {error}")


def _stability(zeros: Sequence[ComplexArray]) -> Finding:
    """Of the modes (modes,) at each of some commands: the worst of these."""
    judged = [of_modes(each) for each in zeros]
    holds, why = min(judged, key=lambda each: (True, None, False)[::-1].index(each[0]))
    if holds is None:
        why += "; to first order the port then neither comes back nor runs away, and more is not looked at"
    return Finding("stable zero dynamics", holds, f"modes of the free port, linearised at the settled source: {why}")


def _zero(network: NonlinearNetwork, settle_s: float) -> Iterator[Finding]:
    """Z(x_N, x_N) = 0, and how many zeros there are beside it, over the declared domain."""
    motion = "x" if {"x", "dx"} & set(network.connection.inputs) else "v"
    if motion not in network.domain:
        text = f'declare the domain of "{motion}", then this can be checked'
        yield Finding("source is a zero", None, text)
        yield Finding("unique zero", None, text)
        return
    if network.connection.rates and motion == "x":
        yield from _zero_at_rest(network, settle_s)
        return
    at_source, widest, crossings = 0.0, 0.0, 1
    places = np.linspace(*network.domain[motion], POINTS)
    source = _sources(network, motion, places)
    for commands in _commands(network):
        exertion_at = _exertions(network, commands, motion, settle_s)
        exertion = exertion_at(source[:, None], places[None, :])
        size = float(np.abs(exertion).max()) or 1.0
        at_source = max(at_source, float(np.abs(np.diagonal(exertion[:, _nearest(places, source)])).max()) / size)
        at_edges, zeros = _zeros(places, exertion, NOTHING * size)
        flat = max(at_edges, _range(exertion_at, source, places, exertion, NOTHING * size))
        widest, crossings = max(widest, flat), max(crossings, zeros)
    holds = at_source <= 1e-9
    how = f"at x = x_N the exertion is at most {at_source:.2g} of the greatest in the domain"
    yield Finding("source is a zero", holds, how)
    if widest > 0.0:
        unit = "rad" if motion == "x" else "rad/s"
        text = f"no exertion over a range of {widest:.4g} {unit}: the source is known to within that"
        yield Finding("unique zero", False, text, widest)
        return
    number = "once" if crossings == 1 else f"{crossings} times"
    yield Finding(
        "unique zero", crossings == 1, f"over the domain of {motion} the exertion is zero {number} at the most"
    )


def _nearest(places: FloatArray, wanted: FloatArray) -> Any:
    return np.abs(places[None, :] - wanted[:, None]).argmin(axis=1)


def _sources(network: NonlinearNetwork, motion: str, places: FloatArray) -> FloatArray:
    """Places (p,) of the source among those of the domain."""
    low, high = network.domain.get(f"{motion}_N", network.domain[motion])
    chosen = places[(places >= low) & (places <= high)]
    return chosen[:: max(1, len(chosen) // PLACES)]


def _exertions(network: NonlinearNetwork, commands: dict[str, float], motion: str, settle_s: float) -> Exertion:
    """Exertion with the source at one place and the port at another, of the shape of both together.

    The connection is asked, not the source: the identity must hold for any x_N, also those that no command reaches.
    """
    states = settled(network, commands, settle_s) if network.connection.rates else dict(network.start)

    def exertion(source: FloatArray, port: FloatArray) -> FloatArray:
        given = dict.fromkeys(network.source.outputs, 0.0) | {f"{motion}_N": source}
        at = {"x": 0.0, "v": 0.0, "a": 0.0} | {motion: port}
        result = network.connect(given, states, commands, at)["f"]
        return np.broadcast_to(np.asarray(result, dtype=float), np.broadcast_shapes(source.shape, port.shape))

    return exertion


def _zeros(places: FloatArray, exertion: FloatArray, nothing: float) -> tuple[float, int]:
    """The widest flat stretch of no exertion (0.0 where there is none), and the most zeros in one row."""
    widest, most = 0.0, 1
    for row in exertion:
        none = np.abs(row) <= nothing
        edges = np.flatnonzero(np.diff(np.concatenate([[False], none, [False]]).astype(int)))
        starts, ends = edges[::2], edges[1::2] - 1
        widest = max(widest, float((places[ends] - places[starts]).max(initial=0.0)))
        signs = np.sign(np.where(none, 0.0, row))
        most = max(most, len(starts) + int(np.sum(signs[:-1] * signs[1:] < 0)))
    return widest, most


def _range(
    exertion_at: Exertion, source: FloatArray, places: FloatArray, exertion: FloatArray, nothing: float
) -> float:
    """The widest range of no exertion, with its ends found between the places of the grid, by bisection."""

    def sign(place: float, at: float) -> int:
        value = float(exertion_at(np.array(place), np.array(at)))
        return 0 if abs(value) <= nothing else (1 if value > 0.0 else -1)

    def edge(place: float, outside: float, inside: float, kind: int) -> float:
        """Where the sign ``kind`` ends, between a place that has it and one that has not."""
        for _ in range(HALVINGS):
            middle = 0.5 * (outside + inside)
            outside, inside = (middle, inside) if sign(place, middle) == kind else (outside, middle)
        return inside

    widest = 0.0
    for place, row in zip(source.tolist(), exertion, strict=True):
        signs = np.where(np.abs(row) <= nothing, 0, np.sign(row))
        some = np.flatnonzero(signs)
        for i, j in pairwise(some.tolist()):
            if signs[i] == signs[j] and j == i + 1:
                continue
            beyond, before = (j, i) if j == i + 1 else (i + 1, j - 1)
            first = edge(place, float(places[i]), float(places[beyond]), int(signs[i]))
            last = edge(place, float(places[j]), float(places[before]), int(signs[j]))
            # A line between the neighbours is within ``nothing`` of zero over this range.
            of_line = 2 * nothing * float(places[j] - places[i]) / float(np.abs(row[[i, j]]).min())
            widest = max(widest, last - first if last - first > BROADER * of_line else 0.0)
    return widest


def _zero_at_rest(network: NonlinearNetwork, settle_s: float) -> Iterator[Finding]:
    """The same where the connection has states: with the port held until they have settled, and come from both sides.

    A connection that relaxes exerts nothing at rest, wherever the port is; one that remembers how the port came there
    has a whole range of places without exertion.
    """
    visited = _visited(network, settle_s)
    size = np.maximum(visited.most_nm, 1e-300)  # (commands,)
    rest = np.stack([visited.from_below, visited.from_above])
    at_source = float(np.max(np.abs(visited.at_source).max(axis=1) / size))
    left = float(np.min(np.abs(rest).max(axis=(0, 2, 3)) / size))
    differs_nm = np.abs(rest[0] - rest[1]).max(axis=(1, 2))
    apart = float(np.max(differs_nm / size))
    flat, crossings = 0.0, 1
    for each, nothing in zip(np.moveaxis(rest, 1, 0), NOTHING * size, strict=True):
        for way in each:
            range_rad, zeros = _zeros(visited.places, way, float(nothing))
            flat, crossings = max(flat, range_rad), max(crossings, zeros)
    yield Finding(
        "source is a zero",
        at_source <= RELAXED,
        f"at x = x_N, settled, the exertion is {at_source:.2g} of the greatest that was met",
    )
    if left <= RELAXED:
        why = f"a port that is held exerts nothing in the end, wherever it is (after {settle_s:g} s): the place is free"
        yield Finding("unique zero", False, why)
    elif apart > REMEMBERED:
        widest = max(_between(visited.places, *ways) for ways in np.moveaxis(rest, 1, 0))
        why = (
            f"at rest the exertion depends on how the port came there, by up to {differs_nm.max():.3g} N m: no "
            f"exertion over a range of up to {widest:.4g} rad"
        )
        yield Finding("unique zero", False, why, widest)
    elif flat > 0.0:
        yield Finding("unique zero", False, f"no exertion over a range of {flat:.4g} rad", flat)
    else:
        number = "once" if crossings == 1 else f"{crossings} times"
        why = f"over the domain of x the settled exertion is zero {number} at the most"
        yield Finding("unique zero", crossings == 1, why)


@dataclass(frozen=True)
class _Visited:
    """Exertions [N m] at rest, with the port come from below and from above: (commands, sources, places).

    ``at_source`` (commands, sources) are those with the port held at the source; ``most_nm`` (commands,) is the
    greatest met anywhere, also before the states had settled.
    """

    places: FloatArray
    at_source: FloatArray
    most_nm: FloatArray
    from_below: FloatArray
    from_above: FloatArray


def _visited(network: NonlinearNetwork, settle_s: float) -> _Visited:
    """The port is held at the source, moved to one end of its domain, and from there to each place, and held."""
    chosen, ends = list(_commands(network)), network.domain["x"]
    low, high = network.domain.get("x_N", ends)
    places = np.linspace(*ends, STOPS)
    sources = np.linspace(max(low, ends[0]), min(high, ends[1]), SOURCES)[:, None]
    commands = {name: np.array([each[name] for each in chosen])[:, None, None] for name in network.command_units}
    source = dict.fromkeys(network.source.outputs, 0.0) | {"x_N": sources}
    fixed, shape = settled(network, commands, settle_s), np.zeros((len(chosen), SOURCES, STOPS))

    def moved(states: Mapping[str, Any], start: Any, end: Any) -> tuple[dict[str, Any], FloatArray]:
        """States and exertion after a way that takes ``settle_s``; at its end the port stands still."""
        speed = (end - start) / settle_s

        def rates(at: dict[str, Any], part: float) -> Mapping[str, Any]:
            port = {"x": start + part * (end - start), "v": speed, "a": 0.0}
            return network.connection_rates(source, {**fixed, **at}, commands, port)

        with np.errstate(all="ignore"):
            after = advance(dict(states), rates, settle_s, steps_in(settle_s, network.step_s))
            port = {"x": end, "v": 0.0, "a": 0.0}
            exertion = network.connect(source, {**fixed, **after}, commands, port)["f"]
        if not all(np.isfinite(value).all() for value in after.values()):
            raise UsageError("the states do not stay finite over the domain of x; is step_s short enough?")
        return after, np.broadcast_to(np.asarray(exertion, dtype=float), shape.shape)

    begin = {name: fixed[name] + shape for name in network.connection.rates}
    begin, at_source = moved(begin, sources + shape, sources + shape)
    met, rest = [at_source], []
    for end in ends:
        states, first = moved(begin, sources + shape, end + shape)
        states, second = moved(states, end + shape, places + shape)
        met += [first, second]
        rest.append(moved(states, places + shape, places + shape)[1])
    most_nm = np.abs(np.stack(met)).max(axis=(0, 2, 3))
    return _Visited(places, at_source[:, :, 0], most_nm, *rest)


def _between(places: FloatArray, one: FloatArray, other: FloatArray) -> float:
    """How far the zeros of two exertions (sources, places) lie apart at most, linear between the places."""
    widest = 0.0
    for rows in zip(one, other, strict=True):
        first, second = (_first_zero(places, row) for row in rows)
        if first is not None and second is not None:
            widest = max(widest, abs(first - second))
    return widest


def _first_zero(places: FloatArray, row: FloatArray) -> float | None:
    changes = np.flatnonzero(row[:-1] * row[1:] <= 0.0)
    if not changes.size:
        return None
    k = int(changes[0])
    step = row[k + 1] - row[k]
    return float(places[k] - (row[k] / step * (places[k + 1] - places[k]) if step else 0.0))


def _commands(network: NonlinearNetwork) -> Iterator[dict[str, float]]:
    """Both ends and the middle of each command's domain, in every combination; zero where it has none."""
    ranges = [
        np.linspace(*network.domain[name], 3) if name in network.domain else np.zeros(1)
        for name in network.command_units
    ]
    for values in product(*ranges):
        yield dict(zip(network.command_units, map(float, values), strict=True))
