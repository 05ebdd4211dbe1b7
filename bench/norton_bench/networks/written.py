"""Any network as equations with names that are its own, ready to be put together with others."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from norton_bench.models.network import NortonNetwork
from norton_bench.networks.expressions import CONSTANTS, FUNCTIONS, Equations
from norton_bench.networks.family import Network
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.motor import as_equations
from norton_bench.networks.nonlinear import DEVIATIONS, MOTIONS, NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.rewriting import names_in, substituted

MOTION_SOURCE = ("x_N", "v_N", "a_N")
TAKEN = (*FUNCTIONS, *CONSTANTS, *MOTIONS, "f", *MOTION_SOURCE, "f_T", *DEVIATIONS, "df", "f_Z", "x_Y", "v_Y", "a_Y")
# A linear network's poles are followed by steps of this part of the fastest one's time constant.
PART_OF_TIME_CONSTANT = 0.1
LONGEST_STEP_S = 1e-3
T = TypeVar("T")


def written(network: Network) -> NonlinearNetwork:
    """The network as equations. Raises NoConversionError, in a sentence, where these have no words for it."""
    match network:
        case NonlinearNetwork():
            return network
        case NortonNetwork():
            return as_equations(network)
    return _of_operators(network)


def _of_operators(network: LinearNetwork) -> NonlinearNetwork:
    outputs = MOTION_SOURCE if network.kind is Kind.NORTON else ("f_T",)
    source = _equations(network.source, {name: [name] for name in network.commands}, outputs, "w", "the source")
    deviates = (network.kind is Kind.NORTON) == (network.form is Form.IMPEDANCE)
    inputs = MOTIONS if network.form is Form.IMPEDANCE else ("f",)
    if deviates:
        inputs = DEVIATIONS if network.kind is Kind.NORTON else ("df",)
    ends = ("f",) if network.form is Form.IMPEDANCE else MOTIONS
    suffix = "" if deviates else "_Z" if network.form is Form.IMPEDANCE else "_Y"
    connection = _equations(
        network.connection, {"port": list(inputs)}, [name + suffix for name in ends], "z", "the connection"
    )
    poles = [abs(pole) for part in (network.source, network.connection) for pole in part.poles()]
    step_s = min(LONGEST_STEP_S, PART_OF_TIME_CONSTANT / max([*poles, 1e-3]))
    return NonlinearNetwork(
        network.kind, network.form, source, connection, network.commands, True, step_s, provenance=network.provenance
    )


def _equations(
    operator: Operator, inputs: Mapping[str, Sequence[str]], outputs: Iterable[str], state: str, what: str
) -> Equations:
    """``inputs`` have the names of each input and of its derivatives; ``outputs`` are the output and its derivatives.

    As many of the outputs are written as the inputs' known derivatives allow.
    """
    states = [f"{state}{place}" for place in range(1, operator.order + 1)]
    known = list(inputs.values())
    firsts = [names[0] for names in known]
    rates = {
        name: _sum([*zip(row, states, strict=True), *zip(entry, firsts, strict=True)])
        for name, row, entry in zip(states, operator.state, operator.entry, strict=True)
    }
    texts: dict[str, str] = {}
    for output in outputs:
        direct = [(gain, place, order) for order, row in enumerate(operator.direct) for place, gain in enumerate(row)]
        if any(gain and order >= len(known[place]) for gain, place, order in direct):
            break
        own = [(gain, known[place][order]) for gain, place, order in direct if gain]
        texts[output] = _sum([*zip(operator.exit, states, strict=True), *own])
        operator = operator.differentiated()
    if not texts:
        raise NoConversionError(
            f"{what} answers to derivative {operator.derivatives} of what goes in, for which equations have no name; "
            "convert the network to another type or form first"
        )
    used = names_in([*texts.values(), *rates.values()])
    return Equations(tuple(name for names in known for name in names if name in used), texts, rates)


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    text = " + ".join(f"({float(gain)!r})*{name}" for gain, name in terms if gain)
    return text or "0"


def joined(network: NonlinearNetwork) -> NonlinearNetwork:
    """The same network, written as one that is joined nonlinearly: f = Z(x_N, x) and the like."""
    if not network.joined_linearly:
        return network
    connection, suffix = network.connection, network.suffix
    pairs = [*zip(DEVIATIONS, MOTION_SOURCE, MOTIONS, strict=True), ("df", "f_T", "f")]
    instead = {deviation: f"({far} - {near})" for deviation, far, near in pairs} if network.deviates else {}
    outputs = {name: substituted(text, instead) for name, text in connection.outputs.items()}
    if suffix:
        far = dict(zip(network.port_out, network.source_out, strict=True))
        outputs = {
            name: f"{far[name]} - ({outputs[name + suffix]})"
            for name in network.port_out
            if name + suffix in outputs and far[name] in network.source.outputs
        }
    rates = {name: substituted(text, instead) for name, text in connection.rates.items()}
    whole = equations_of(network, outputs, rates, [connection])
    return replace(network, connection=whole, joined_linearly=False)


def equations_of(
    network: NonlinearNetwork, outputs: Mapping[str, str], rates: Mapping[str, str], parts: Sequence[Equations]
) -> Equations:
    """Equations with what ``parts`` have of initial values, parameters and tables, as far as it is used."""
    used = names_in([*outputs.values(), *rates.values()])
    parameters = {name: value for part in parts for name, value in part.parameters.items() if name in used}
    tables = {name: table for part in parts for name, table in part.tables.items() if name in used}
    initial = {name: value for part in parts for name, value in part.initial.items() if name in rates}
    known = {*parameters, *tables, *rates, *FUNCTIONS, *CONSTANTS}
    order = [*network.source_out, *DEVIATIONS, "df", *MOTIONS, "f", *network.command_units]
    inputs = tuple(name for name in [*order, *sorted(used - set(order))] if name in used - known)
    return Equations(inputs, outputs, rates, initial, parameters, tables)


class Names:
    """Gives every content a name of its own: that wanted, or with a number where it stands for something else."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._contents: dict[str, object] = dict.fromkeys([*TAKEN, *taken])

    def give(self, wanted: str, content: object = None) -> str:
        """The name. The same ``content`` (a parameter's value, a table) has it already, and shares it."""
        name, number = wanted, 2
        while name in self._contents and (content is None or self._contents[name] != content):
            name, number = f"{wanted}_{number}", number + 1
        self._contents[name] = content
        return name

    def given_to(self, part: Equations, commands: Mapping[str, str]) -> Equations:
        """The part with its commands' new names, and such of its own."""
        instead = {name: self.give(name) for name in part.rates}
        instead |= {name: self.give(name, value) for name, value in part.parameters.items()}
        instead |= {name: self.give(name, table) for name, table in part.tables.items()}
        return renamed(part, {**instead, **commands})


def renamed(part: Equations, names: Mapping[str, str]) -> Equations:
    """The same equations under other names."""

    def moved(texts: Mapping[str, str]) -> dict[str, str]:
        return {names.get(name, name): substituted(text, names) for name, text in texts.items()}

    def under(contents: Mapping[str, T]) -> dict[str, T]:
        return {names.get(name, name): content for name, content in contents.items()}

    inputs = tuple(names.get(name, name) for name in part.inputs)
    return Equations(
        inputs, moved(part.outputs), moved(part.rates), under(part.initial), under(part.parameters), under(part.tables)
    )


def distinct(networks: Sequence[NonlinearNetwork]) -> list[NonlinearNetwork]:
    """The networks under names of which none stands for two things; a command that two have gets a number."""
    names, result = Names(), []
    for network in networks:
        commands = {name: names.give(name) for name in network.command_units}
        source, connection = (names.given_to(part, commands) for part in (network.source, network.connection))
        result.append(
            replace(
                network,
                source=source,
                connection=connection,
                command_units={commands[name]: unit for name, unit in network.command_units.items()},
                domain={commands.get(name, name): bounds for name, bounds in network.domain.items()},
            )
        )
    return result


def folded(network: NonlinearNetwork) -> Equations:
    """Of a network that is joined nonlinearly: the connection with the source in it, of commands and port alone."""
    source, connection = network.source, network.connection
    instead = {name: f"({text})" for name, text in source.outputs.items()}
    outputs = {name: substituted(text, instead) for name, text in connection.outputs.items()}
    rates = {name: substituted(text, instead) for name, text in connection.rates.items()}
    return equations_of(network, outputs, {**source.rates, **rates}, [source, connection])
