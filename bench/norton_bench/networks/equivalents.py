"""The equivalents of a network of equations, where they follow from them (paper, sections II, III and IV.C).

A nonlinear network obeys no superposition, so the other type is no sum of the same parts. It exists where what the
source gives can be told from the other source's output:

- Thévenin to Norton: the source is the motion of the free port, f = Z(f_T, x_N) = 0, and f_T is taken from this
  motion, as section IV.C takes the actuator's source from that of the outer port: f = Z(f_T[x_N], x). Exact where f is
  linear in f_T and in the port's highest derivative; else, without memory, by tables.
- Norton to Thévenin: where f is a sum of a part of the source's motion and one of the port's, the first is f_T,
  exactly. Else, without memory, f_T is what the port blocked at zero exerts, and a table takes x_N from it.

Form follows by :mod:`norton_bench.networks.forms`.
"""

from dataclasses import replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.composing import MOTION_SOURCE, Names, distinct, equations_of, joined, own_names, renamed
from norton_bench.networks.expressions import Equations
from norton_bench.networks.forms import in_form, map_of, range_of, told, with_table
from norton_bench.networks.inverses import Inverse, inverse_of, inverse_of_points, zeros_along
from norton_bench.networks.kinds import Form, Kind, NoConversionError, told_as_no_conversion
from norton_bench.networks.motor import as_equations
from norton_bench.networks.motor_read import motor_of
from norton_bench.networks.nonlinear import MOTIONS, NonlinearNetwork
from norton_bench.networks.rewriting import linear_in, names_in, negative, solved, substituted, summands


def equivalent(network: NonlinearNetwork, kind: Kind, form: Form) -> NonlinearNetwork | NortonNetwork:
    """The network of another type or form; an identified motor that was written as equations is that motor again.

    Raises NoConversionError, in a sentence that says why, where none follows.
    """
    motor = motor_of(network)
    if motor is not None:
        return motor if (kind, form) == (Kind.NORTON, Form.IMPEDANCE) else as_equations(motor, kind, form)
    with told_as_no_conversion():
        if kind is network.kind:
            return in_form(network, form)
        (apart,) = distinct([network])
        return _norton(apart, form) if kind is Kind.NORTON else _thevenin(apart, form)


def with_port_source(network: NonlinearNetwork) -> NonlinearNetwork | NortonNetwork:
    """A Norton network whose source is the motion of its own free port: Z_P(θ_N, θ) of section IV.C.

    An actuator that carries a load has another free motion than the actuator alone. Raises NoConversionError as
    :func:`equivalent` does.
    """
    blocked = equivalent(network, Kind.THEVENIN, Form.IMPEDANCE)
    if isinstance(blocked, NortonNetwork):
        return blocked
    return equivalent(blocked, Kind.NORTON, network.form)


def _norton(network: NonlinearNetwork, form: Form) -> NonlinearNetwork:
    flat = joined(in_form(network, Form.IMPEDANCE))
    split = linear_in(flat.connection.outputs["f"], "f_T")
    if split is None or split[0] == "0":
        return _norton_by_table(network, flat, form)
    free = in_form(network, Form.ADMITTANCE)
    names = Names([*own_names(flat), *own_names(free)])
    source = _free_port(free, names)
    taken = dict(zip(MOTIONS, MOTION_SOURCE, strict=True))
    own = {state: names.give(f"{state}_N") for state in flat.connection.rates}
    slope, rest = (substituted(text, {**taken, **own}) for text in split)
    drive = {"f_T": solved("0", slope, rest)}
    outputs = {"f": substituted(flat.connection.outputs["f"], drive)}
    at_source = renamed(flat.connection, {**taken, **own})
    moving = {**flat.connection.rates, **at_source.rates}
    rates = {state: substituted(text, drive) for state, text in moving.items()}
    connection = equations_of(outputs, rates, [flat.connection, at_source])
    for name in sorted(set(connection.inputs) & set(MOTION_SOURCE) - set(source.outputs)):
        raise NoConversionError(f'the free port\'s "{name}" does not follow from its equations, and is needed')
    domain = _without(network, "f_T", "df")
    whole = replace(flat, kind=Kind.NORTON, source=source, connection=connection, domain=domain, step_s=free.step_s)
    return in_form(whole, form)


def _without(network: NonlinearNetwork, *names: str) -> dict[str, tuple[float, float]]:
    return {name: bounds for name, bounds in network.domain.items() if name not in names}


def _free_port(network: NonlinearNetwork, names: Names) -> Equations:
    """The motion of an admittance without exertion, as a source."""
    own = {state: names.give(f"{state.removesuffix('_r')}_w") for state in network.connection.rates}
    source, connection = network.source, renamed(joined(network).connection, own)
    instead = {name: f"({text})" for name, text in source.outputs.items()} | {"f": "0"}
    outputs = {
        f"{near}_N": substituted(connection.outputs[near], instead) for near in MOTIONS if near in connection.outputs
    }
    rates = {state: substituted(text, instead) for state, text in connection.rates.items()}
    return equations_of(outputs, {**source.rates, **rates}, [source, connection])


def _norton_by_table(network: NonlinearNetwork, flat: NonlinearNetwork, form: Form) -> NonlinearNetwork:
    """Of a connection without memory that is not linear in f_T: where the free port rests for each f_T."""
    text = flat.connection.outputs["f"]
    _without_memory(flat, text, ("f_T", "x"))

    value = map_of(flat, text)

    def exertion(source: FloatArray, place: FloatArray) -> FloatArray:
        return value({"f_T": source, "x": place})

    sources, places = zeros_along(exertion, range_of(flat, "f_T"), range_of(flat, "x"), "the exertion", "x")
    behind = inverse_of_points(sources, places, "the place of the free port", "f_T")
    order = slice(None) if places[-1] > places[0] else slice(None, None, -1)
    free = inverse_of_points(places[order], sources[order], "the exertion source", "x")
    name = Names(own_names(network)).give("free")
    source = replace(
        network.source,
        outputs={"x_N": f"{name}({network.source.outputs['f_T']})"},
        tables={**network.source.tables, name: free.table},
    )
    whole = _by_source(network, form, source, behind, ("f_T", "x_N"))
    return replace(whole, provenance={**whole.provenance, **told(name, free, "rad", "f_T")})


def _by_source(
    network: NonlinearNetwork, form: Form, source: Equations, behind: Inverse, names: tuple[str, str]
) -> NonlinearNetwork:
    """The network with another source, from which the table ``behind`` takes what its own gave.

    ``names`` are those of its own source's output and of the other's.
    """
    own, other = names
    flat = joined(in_form(network, form))
    table = Names([*own_names(flat), *source.tables]).give("behind")
    instead = {own: f"{table}({other})"}
    outputs = {name: substituted(text, instead) for name, text in flat.connection.outputs.items()}
    rates = {name: substituted(text, instead) for name, text in flat.connection.rates.items()}
    domain = _without(flat, own, "dx", "df")
    return replace(
        flat,
        kind=Kind.NORTON if other == "x_N" else Kind.THEVENIN,
        source=source,
        connection=equations_of(outputs, rates, [with_table(flat, table, behind.table)]),
        domain={**domain, other: behind.domain},
        provenance={**flat.provenance, **told(table, behind, "rad" if own == "x_N" else "N m", other)},
    )


def _without_memory(network: NonlinearNetwork, text: str, allowed: tuple[str, ...]) -> None:
    beyond = (names_in([text]) & {*network.connection.inputs, *network.connection.rates}) - set(allowed)
    if beyond:
        raise NoConversionError(
            f"a nonlinear network obeys no superposition: its source is not told from the port, because the exertion "
            f'depends on "{min(beyond)}" too, and is no sum of a part of the source and one of the port; keep it '
            f"{network.kind.value}"
        )


def _thevenin(network: NonlinearNetwork, form: Form) -> NonlinearNetwork:
    flat = joined(in_form(network, Form.IMPEDANCE))
    parts = _sum_of_source_and_port(flat.connection)
    if parts is None:
        return _thevenin_by_table(network, flat, form)
    of_source, of_port, own = parts
    source, connection = flat.source, flat.connection
    instead = {name: f"({text})" for name, text in source.outputs.items()}
    rates = {state: substituted(connection.rates[state], instead) for state in own}
    drive = equations_of({"f_T": substituted(of_source, instead)}, {**source.rates, **rates}, [source, connection])
    kept = {state: text for state, text in connection.rates.items() if state not in own}
    rest = equations_of({"f_Z": negative(of_port)}, kept, [connection])
    domain = _without(network, *MOTION_SOURCE, "dx")
    whole = replace(flat, kind=Kind.THEVENIN, source=drive, connection=rest, joined_linearly=True, domain=domain)
    return in_form(whole, form)


def _reached(connection: Equations, names: tuple[str, ...]) -> set[str]:
    """``names``, and the states that answer to them, directly or through others."""
    reached = set(names)
    while True:
        more = {state for state, text in connection.rates.items() if names_in([text]) & reached} - reached
        if not more:
            return reached
        reached |= more


def _sum_of_source_and_port(connection: Equations) -> tuple[str, str, frozenset[str]] | None:
    """The source's part of f, the port's, and the states that are the source's; None where f is no such sum."""
    of_source, of_port = _reached(connection, MOTION_SOURCE), _reached(connection, MOTIONS)
    if of_source & of_port:
        return None
    parts: dict[bool, list[str]] = {True: [], False: []}
    for term in summands(connection.outputs["f"]):
        rest = term
        if names_in([term]) & of_port:
            for name in MOTION_SOURCE:
                slope, rest = linear_in(rest, name) or ("", rest)
                if slope not in ("", "0"):
                    parts[True].append(f"({slope})*{name}")
        if names_in([*parts[True]]) & of_port or (names_in([rest]) & of_source and names_in([rest]) & of_port):
            return None
        parts[bool(names_in([rest]) & of_source)].append(f"({rest})")
    texts = [" + ".join(parts[side]) or "0" for side in (True, False)]
    return texts[0], texts[1], frozenset(of_source & set(connection.rates))


def _thevenin_by_table(network: NonlinearNetwork, flat: NonlinearNetwork, form: Form) -> NonlinearNetwork:
    """Of a connection without memory that is no sum: f_T is what the port exerts that is blocked at zero.

    Where zero lies outside of the domain, it is blocked at the nearest end.
    """
    text = flat.connection.outputs["f"]
    _without_memory(flat, text, ("x_N", *MOTIONS))
    low, high = flat.domain.get("x", (-np.inf, np.inf))
    place = float(min(max(0.0, low), high))
    held = substituted(text, {"x": repr(place), "v": "0", "a": "0"})

    value = map_of(flat, held)

    def exertion(source: FloatArray) -> FloatArray:
        return value({"x_N": source})

    behind = inverse_of(exertion, range_of(flat, "x_N"), "the exertion of the blocked port", "x_N")
    outputs = {"f_T": substituted(held, {"x_N": f"({flat.source.outputs['x_N']})"})}
    source = equations_of(outputs, flat.source.rates, [flat.source, flat.connection])
    whole = _by_source(network, form, source, behind, ("x_N", "f_T"))
    blocked = {"source": f"f_T is what the port exerts that is blocked at {place:g} rad"}
    return replace(whole, provenance={**whole.provenance, **blocked})
