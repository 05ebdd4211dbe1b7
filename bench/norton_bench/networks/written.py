"""Any network as equations: an identified motor, and one of linear operators."""

from collections.abc import Iterable, Mapping, Sequence

from norton_bench.models.network import NortonNetwork
from norton_bench.networks.composing import MOTION_SOURCE
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import Network
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.motor import as_equations
from norton_bench.networks.nonlinear import DEVIATIONS, MOTIONS, NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.rewriting import names_in

# A linear network's poles are followed by steps of this part of the fastest one's time constant.
PART_OF_TIME_CONSTANT = 0.1
LONGEST_STEP_S = 1e-3


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
    if deviates and len(source.outputs) <= network.connection.derivatives:
        raise NoConversionError(
            f"the connection answers to derivative {network.connection.derivatives} of the source, where the command "
            "enters as a derivative, for which equations have no name; convert the network to admittance form first"
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
