"""The other form of a network of equations, where one follows: impedance from admittance, and back.

An exertion that is linear in the port's highest derivative is solved for it, exactly: f = P(x, v) − I a gives
a = (P − f)/I, and position and velocity become states of the admittance, which starts at rest at zero (or, where the
deviation from the source is what the connection takes in, at the source). The way back takes these states out again.
A map without memory is inverted, exactly where it is linear, else by a table over its domain.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.networks.composing import MOTION_SOURCE, Names, equations_of, own_names
from norton_bench.networks.expressions import Equations, Table
from norton_bench.networks.inverses import Inverse, Range, inverse_beside, inverse_of
from norton_bench.networks.kinds import Form, NoConversionError
from norton_bench.networks.nonlinear import DEVIATIONS, EXERTIONS, MOTIONS, NonlinearNetwork
from norton_bench.networks.rewriting import linear_in, names_in, solved, substituted

# What the provenance calls a table, with its name.
TABLE = "table "
# Of the fastest mode's time constant: the longest step of integration; and the change of a state that shows the modes.
RESOLVED = 0.5
NUDGE = 1e-6
WORDS = ("position", "velocity", "acceleration")


def in_form(network: NonlinearNetwork, form: Form) -> NonlinearNetwork:
    """The network in the form. Raises NoConversionError, in a sentence that says why, where none follows."""
    if form is network.form:
        return network
    return _admittance(network) if form is Form.ADMITTANCE else _impedance(network)


def _admittance(network: NonlinearNetwork) -> NonlinearNetwork:
    motions = DEVIATIONS if network.deviates else MOTIONS
    connection, first = network.connection, network.first_output
    text = connection.outputs[first]
    used = names_in([text])
    order = max((place for place, name in enumerate(motions) if name in used), default=-1)
    if order < 0:
        raise NoConversionError("the port's exertion does not depend on its motion, so no motion follows from it")
    split = linear_in(text, motions[order])
    if split is None and order == 0:
        return _tabulated(network, motions[0])
    slope, rest = _sound(network, split, WORDS[order])
    given = "df" if network.suffix else "f"
    highest = solved(given, slope, rest)
    names = Names(own_names(network))
    states = [names.give(f"{motion}_r") for motion in MOTIONS[:order]]
    motion = dict(zip(motions, [*states, highest], strict=False))
    beyond = names_in(connection.rates.values()) & set(motions[order + 1 :])
    if beyond:
        raise NoConversionError(
            f'the connection\'s states need "{min(beyond)}", which does not follow from the exertion; only '
            f"{WORDS[order]} does"
        )
    inward = {
        name: substituted(solved_text, dict(zip(motions, states, strict=False))) for name, solved_text in motion.items()
    }
    rates = {name: substituted(each, inward) for name, each in connection.rates.items()}
    rates |= {state: inward[motions[place + 1]] for place, state in enumerate(states)}
    suffix = "_Y" if network.deviates else ""
    outputs = {f"{name}{suffix}": inward[far] for name, far in zip(MOTIONS, motions, strict=True) if far in inward}
    whole = replace(network, form=Form.ADMITTANCE, connection=equations_of(outputs, rates, [connection]))
    return replace(whole, step_s=min(network.step_s, _step_s(whole)))


def _sound(network: NonlinearNetwork, split: tuple[str, str] | None, what: str) -> tuple[str, str]:
    """Slope and rest; refuses where there is no such sum, or the slope is a number and zero."""
    if split is None:
        raise NoConversionError(
            f"its equations are not linear in {what}, so they are not solved for it; write them as a sum with one part "
            f"times {what}"
        )
    known = network.connection.parameters
    if names_in([split[0]]) <= set(known) and not map_of(network, split[0])({}):
        raise NoConversionError(
            f"the part of its equations that is times {what} is zero, so they have no solution for it"
        )
    return split


def map_of(network: NonlinearNetwork, text: str) -> Callable[[Mapping[str, Any]], FloatArray]:
    """An expression of the connection's names, as a function of the values of those that are no parameters."""
    equations = equations_of({"y": text}, {}, [network.connection])

    def value(names: Mapping[str, Any]) -> FloatArray:
        with np.errstate(all="ignore"):
            return np.asarray(equations.work_out(names)["y"], dtype=float)

    return value


def _step_s(network: NonlinearNetwork) -> float:
    """A step [s] that resolves the connection's modes, linearised where it starts, without exertion."""
    commands = {name: float(np.mean(network.domain.get(name, (0.0, 0.0)))) for name in network.command_units}
    start = {name: float(value) for name, value in network.start.items()}
    own = list(network.connection.rates)

    def rates(states: dict[str, float]) -> FloatArray:
        source = network.source_values(states, commands)
        free = {"f": source["f_T"] if network.deviates else 0.0}
        found = network.connection_rates(source, states, commands, free)
        return np.array([found[name] for name in own], dtype=float)

    with np.errstate(all="ignore"):
        columns = [(rates({**start, name: start[name] + NUDGE}) - rates(start)) / NUDGE for name in own]
    slopes = np.array(columns).T
    if not own or not np.isfinite(slopes).all():
        return network.step_s
    return float(RESOLVED / max(np.abs(np.linalg.eigvals(slopes)).max(), 1e-300))


def _impedance(network: NonlinearNetwork) -> NonlinearNetwork:
    connection, first = network.connection, network.first_output
    given = "df" if network.deviates else "f"
    motions = DEVIATIONS if network.suffix else MOTIONS
    instead: dict[str, str] = {}
    text, order = connection.outputs[first].strip(), 0
    while text in connection.rates and order < 2:
        instead[text] = motions[order]
        text, order = connection.rates[text].strip(), order + 1
    if given not in names_in([text]):
        raise NoConversionError(
            "its motion does not follow from the exertion by one rate or two, so the exertion cannot be solved for"
        )
    split = linear_in(text, given)
    if split is None and order == 0:
        return _tabulated(network, given)
    slope, rest = _sound(network, split, "the exertion")
    exertion = f"({substituted(solved(motions[order], slope, rest), instead)})"
    inward = {**instead, given: exertion}
    rates = {name: substituted(each, inward) for name, each in connection.rates.items() if name not in instead}
    outputs = {"f_Z" if network.deviates else "f": exertion}
    return replace(network, form=Form.IMPEDANCE, connection=equations_of(outputs, rates, [connection]))


def _tabulated(network: NonlinearNetwork, argument: str) -> NonlinearNetwork:
    """The other form of a connection without memory that is no line, by a table."""
    connection, text = network.connection, network.connection.outputs[network.first_output]
    names = names_in([text]) & {*connection.inputs, *connection.rates}
    beside = sorted(names - {argument})
    sources = [name for name in beside if name in network.source.outputs]
    if sources != beside or len(beside) > 1:
        other = next(name for name in beside if name not in sources[:1])
        raise NoConversionError(
            f'its connection is not linear in "{argument}" and depends on "{other}" too, so there is no table of it'
        )
    what = "the exertion" if network.form is Form.IMPEDANCE else "the motion"
    bounds = range_of(network, argument)

    value = map_of(network, text)

    def values(*arguments: FloatArray) -> FloatArray:
        return value(dict(zip([*beside, argument], arguments, strict=True)))

    if beside:
        found = inverse_beside(values, range_of(network, beside[0]), bounds, what, argument)
    else:
        found = inverse_of(values, bounds, what, argument)
    form = Form.ADMITTANCE if network.form is Form.IMPEDANCE else Form.IMPEDANCE
    return _with_table(network, form, found, beside)


def _with_table(network: NonlinearNetwork, form: Form, found: Inverse, beside: list[str]) -> NonlinearNetwork:
    ends, taken = (MOTIONS, "f") if form is Form.ADMITTANCE else (EXERTIONS, "x")
    given = {"_Z": "df", "_Y": "dx"}.get(network.suffix, taken)
    suffix = ("_Y" if form is Form.ADMITTANCE else "_Z") if network.deviates else ""
    name = Names(own_names(network)).give("inverse")
    outputs = {f"{ends[0]}{suffix}": f"{name}({', '.join([*beside, given])})"}
    whole = equations_of(outputs, {}, [with_table(network, name, found.table)])
    domain = {**network.domain, given: found.domain}
    unit = "rad" if form is Form.ADMITTANCE else "N m"
    return replace(
        network,
        form=form,
        connection=whole,
        domain=domain,
        provenance={**network.provenance, **told(name, found, unit, given)},
    )


def with_table(network: NonlinearNetwork, name: str, table: Table) -> Equations:
    """The connection with one table more."""
    return replace(network.connection, tables={**network.connection.tables, name: table})


def told(name: str, found: Inverse, unit: str, argument: str) -> dict[str, str]:
    """What the table of a name is good for, for the provenance."""
    low, high = found.domain
    return {
        f"{TABLE}{name}": f"an inverse to within {found.error:.2g} {unit}, for {argument} from {low:.4g} to {high:.4g}"
    }


def range_of(network: NonlinearNetwork, name: str) -> Range:
    """The declared domain of a name. Raises NoConversionError where there is none, and nothing that it follows from."""
    domain = network.domain
    if name in domain:
        return domain[name]
    if name in MOTION_SOURCE and name[0] in domain:
        return domain[name[0]]
    if name == "dx" and "x" in domain:
        low, high = domain["x"]
        first, last = domain.get("x_N", (low, high))
        return first - high, last - low
    needed = {"dx": "x", "df": "f_T"}.get(name, name)
    raise NoConversionError(
        f'declare the domain of "{needed}": what has no closed form is inverted over that range alone'
    )
