"""Networks of equations joined and geared: the equations of all, put into one (paper, sections III and IV.C).

One of the networks lends its type and its source; the sources of the others go into the connection, which then takes
their commands in, as π. Thévenin networks that share motion, and Norton networks that share exertion, keep their linear
connection: their sources add.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from norton_bench.networks.composing import MOTION_SOURCE, Names, distinct, equations_of, folded, joined, own_names
from norton_bench.networks.expressions import Equations
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.nonlinear import DEVIATIONS, EXERTIONS, MOTIONS, NonlinearNetwork
from norton_bench.networks.rewriting import names_in, slope_of, substituted

Range = tuple[float, float]
# What is the same at both ports, and the form in which outputs add.
COMMON = {Kind.THEVENIN: ("motion", Form.IMPEDANCE), Kind.NORTON: ("exertion", Form.ADMITTANCE)}


def summed(networks: Sequence[NonlinearNetwork], kind: Kind) -> NonlinearNetwork:
    """Networks of common motion (``kind`` Thévenin: exertions add) or of common exertion (Norton: motions add).

    Raises NoConversionError, in a sentence, where an algebraic loop would have to be solved.
    """
    own = distinct(networks)
    _, adding = COMMON[kind]
    if all(each.joined_linearly and each.kind is kind and each.form is adding for each in own):
        return _of_sources(own)
    keeper = next((each for each in own if each.command_units), own[0])
    rest = [joined(each) for each in own]
    parts = [each.connection if one is keeper else folded(each) for one, each in zip(own, rest, strict=True)]
    added = [part for part, each in zip(parts, own, strict=True) if each.form is adding]
    others = [part for part, each in zip(parts, own, strict=True) if each.form is not adding]
    if len(others) > 1:
        raise NoConversionError(_undecided(kind))
    base = replace(keeper, command_units=_units(own))
    connection = _added(added) if added else others[0]
    if added and others:
        connection = _closed(connection, others[0], kind)
    form = own[[each.form is adding for each in own].index(False)].form if others else adding
    return replace(
        base,
        form=form,
        connection=connection,
        joined_linearly=False,
        step_s=min(each.step_s for each in own),
        domain=_domain(own, kind, keeper),
        provenance=_provenance(own),
    )


def _undecided(kind: Kind) -> str:
    common, adding = COMMON[kind]
    taken, name = ("exertion", "admittance") if kind is Kind.THEVENIN else ("motion", "impedance")
    return (
        f"two networks in {name} form take {taken} in, and how it divides between them, at one {common}, would have to "
        f"be solved at every instant; convert all but one of them to {adding.value} form first"
    )


def _units(networks: Sequence[NonlinearNetwork]) -> dict[str, str]:
    return {name: unit for each in networks for name, unit in each.command_units.items()}


def _provenance(networks: Sequence[NonlinearNetwork]) -> dict[str, str]:
    return {name: text for each in reversed(networks) for name, text in each.provenance.items()}


def _of_sources(networks: Sequence[NonlinearNetwork]) -> NonlinearNetwork:
    """Sources and connections of one linear connection add, each for itself."""
    base = replace(networks[0], command_units=_units(networks))
    return replace(
        base,
        source=_added([each.source for each in networks]),
        connection=_added([each.connection for each in networks]),
        step_s=min(each.step_s for each in networks),
        domain=_domain(networks, base.kind, base),
        provenance=_provenance(networks),
    )


def _added(parts: Sequence[Equations]) -> Equations:
    """The sum of those outputs that all have."""
    common = [name for name in parts[0].outputs if all(name in part.outputs for part in parts)]
    outputs = {name: " + ".join(f"({part.outputs[name]})" for part in parts) for name in common}
    rates = {name: text for part in parts for name, text in part.rates.items()}
    return equations_of(outputs, rates, parts)


def _closed(adding: Equations, other: Equations, kind: Kind) -> Equations:
    """``other`` takes in what the sum leaves of the port's input, and gives what all have in common.

    Common motion: x = Y(f − Z(x)), with its admittance. Common exertion: f = Z(x − Y(f)), with its impedance.
    There is no loop where one of the two does not put out, at an instant, what it takes in then.
    """
    common, divided = (MOTIONS, EXERTIONS) if kind is Kind.THEVENIN else (EXERTIONS, MOTIONS)
    back = {name: f"({text})" for name, text in other.outputs.items() if name in common}
    share = {name: f"({name} - ({text}))" for name, text in adding.outputs.items() if name in divided}
    needs = [(names_in([*part.outputs.values(), *part.rates.values()])) for part in (adding, other)]
    wanted, taken = needs[0] & set(common), needs[1] & set(divided)
    for lacking in sorted((wanted - set(back)) | (taken - set(share))):
        raise NoConversionError(f'one of the networks must know "{lacking}", which the other does not put out there')
    if not names_in(back[name] for name in wanted) & set(divided):
        share = {name: substituted(text, back) for name, text in share.items()}
    elif names_in(share[name] for name in taken) & set(common):
        raise NoConversionError(_looped(kind))
    outputs = {name: substituted(text, share) for name, text in other.outputs.items()}
    rates = {name: substituted(text, share) for name, text in other.rates.items()}
    back = {name: f"({outputs[name]})" for name in back}
    rates |= {name: substituted(text, back) for name, text in adding.rates.items()}
    return equations_of(outputs, rates, [adding, other])


def _looped(kind: Kind) -> str:
    common, adding = COMMON[kind]
    return (
        f"both networks answer at once to what the other puts out, so their common {common} would have to be solved at "
        f"every instant (an algebraic loop); convert both to {adding.value} form first"
    )


def _domain(networks: Sequence[NonlinearNetwork], kind: Kind, keeper: NonlinearNetwork) -> dict[str, Range]:
    """Of what is common: where all hold; of the commands: their own; of the source: its own."""
    common = MOTIONS if kind is Kind.THEVENIN else EXERTIONS
    result: dict[str, Range] = {}
    for each in networks:
        for name, (low, high) in each.domain.items():
            if name in each.command_units or (each is keeper and name in each.source_out):
                result[name] = (low, high)
            elif name in common:
                before = result.get(name, (low, high))
                result[name] = (max(low, before[0]), min(high, before[1]))
                if not result[name][0] < result[name][1]:
                    raise NoConversionError(f"the networks hold for no {name} in common; look at their domains")
    return result


def geared(network: NonlinearNetwork, ratio: float) -> NonlinearNetwork:
    """Motion divided by ``ratio``, exertion multiplied by it; the connection stays linear where it is."""
    name = Names(own_names(network)).give("ratio")
    inner = {each: f"({name}*{each})" for each in (*MOTIONS, *MOTION_SOURCE, *DEVIATIONS)}
    inner |= {each: f"({each}/{name})" for each in ("f", "f_T", "df")}
    source, connection = (_geared(part, inner, name, ratio) for part in (network.source, network.connection))
    factors = dict.fromkeys((*MOTIONS, *MOTION_SOURCE, *DEVIATIONS), 1.0 / ratio) | {"f": ratio, "f_T": ratio}
    domain = {
        each: _range(low * factors.get(each, 1.0), high * factors.get(each, 1.0))
        for each, (low, high) in network.domain.items()
    }
    return replace(network, source=source, connection=connection, domain=domain)


def _range(one: float, other: float) -> Range:
    return min(one, other), max(one, other)


def _geared(part: Equations, inner: Mapping[str, str], name: str, ratio: float) -> Equations:
    outputs = {
        each: f"{name}*({substituted(text, inner)})" if each[0] == "f" else f"({substituted(text, inner)})/{name}"
        for each, text in part.outputs.items()
    }
    rates = {each: substituted(text, inner) for each, text in part.rates.items()}
    return replace(part, outputs=outputs, rates=rates, parameters={**part.parameters, name: ratio})


def linked(network: NonlinearNetwork, angle: str, parameters: Mapping[str, float]) -> NonlinearNetwork:
    """An impedance whose motion is a map of the new port's: exertion times its slope n(x), motion through it."""
    names = Names(own_names(network))
    own = {name: names.give(name, value) for name, value in parameters.items()}
    inner = substituted(Equations(("x",), {"x": angle}, parameters=parameters).outputs["x"], own)
    ratio = slope_of(inner, "x")
    bend = slope_of(ratio, "x")
    moved = {"x": f"({inner})", "v": f"(({ratio})*v)", "a": f"(({ratio})*a + ({bend})*v**2)"}
    flat = joined(network).connection
    outputs = {"f": f"({ratio})*({substituted(flat.outputs['f'], moved)})"}
    rates = {name: substituted(text, moved) for name, text in flat.rates.items()}
    values = Equations((), {}, parameters={own[name]: value for name, value in parameters.items()})
    return replace(
        network,
        connection=equations_of(outputs, rates, [flat, values]),
        joined_linearly=False,
        domain={name: bounds for name, bounds in network.domain.items() if name not in MOTIONS},
    )


def opposed(network: NonlinearNetwork, kind: Kind) -> NonlinearNetwork:
    """What takes the network away again: −f at the same motion (``kind`` Thévenin), or −x at the same exertion."""
    form = COMMON[kind][1]
    if network.form is not form:
        raise NoConversionError(
            f"to be taken away where {COMMON[kind][0]} is common, an element must be in {form.value} form; convert it"
        )
    flat = joined(network)
    outputs = {name: f"-({text})" for name, text in flat.connection.outputs.items()}
    return replace(flat, connection=replace(flat.connection, outputs=outputs))
