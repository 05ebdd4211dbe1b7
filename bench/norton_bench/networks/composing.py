"""Networks of equations made ready to be put together: names of which each stands for one thing, one expression."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from norton_bench.networks.expressions import CONSTANTS, FUNCTIONS, Equations
from norton_bench.networks.nonlinear import DEVIATIONS, MOTIONS, NonlinearNetwork
from norton_bench.networks.rewriting import names_in, substituted

MOTION_SOURCE = ("x_N", "v_N", "a_N")
SIGNALS = (*MOTION_SOURCE, "f_T", *DEVIATIONS, "df", *MOTIONS, "f")
TAKEN = (*FUNCTIONS, *CONSTANTS, *SIGNALS, "f_Z", "x_Y", "v_Y", "a_Y")
T = TypeVar("T")


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
    whole = equations_of(outputs, rates, [connection])
    return replace(network, connection=whole, joined_linearly=False)


def equations_of(outputs: Mapping[str, str], rates: Mapping[str, str], parts: Sequence[Equations]) -> Equations:
    """Equations with what ``parts`` have of initial values, parameters and tables, as far as it is used.

    All other names are inputs: the signals of source and port, and commands.
    """
    used = names_in([*outputs.values(), *rates.values()])
    parameters = {name: value for part in parts for name, value in part.parameters.items() if name in used}
    tables = {name: table for part in parts for name, table in part.tables.items() if name in used}
    initial = {name: value for part in parts for name, value in part.initial.items() if name in rates}
    taken = used - {*parameters, *tables, *rates, *FUNCTIONS, *CONSTANTS}
    inputs = sorted(taken, key=lambda name: (SIGNALS.index(name) if name in SIGNALS else len(SIGNALS), name))
    return Equations(tuple(inputs), outputs, rates, initial, parameters, tables)


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


def own_names(network: NonlinearNetwork) -> list[str]:
    """All that the equations of both parts call their own, and the commands."""
    parts = (network.source, network.connection)
    return [*network.command_units, *(name for each in parts for name in (*each.rates, *each.parameters, *each.tables))]


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
    return equations_of(outputs, {**source.rates, **rates}, [source, connection])
