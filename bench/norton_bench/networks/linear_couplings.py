"""Linear networks joined, geared and divided, exactly (paper, sections II and IV.C).

Common motion adds exertions: Z = Z₁ + Z₂, f_T = f_T1 + f_T2.
Common exertion adds motions: Y = Y₁ + Y₂, x_N = x_N1 + x_N2.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np

from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.linear import LinearNetwork, bounded, widened
from norton_bench.networks.operator import Operator


def of_common_motion(networks: Sequence[LinearNetwork]) -> LinearNetwork:
    """Exertions add; of the type and form of the first network. Raises NoConversionError where there is no sum."""
    sources = [each.source if each.kind is Kind.THEVENIN else each.impedance.after(each.source) for each in networks]
    return _summed(networks, sources, [each.impedance for each in networks], Kind.THEVENIN, Form.IMPEDANCE)


def of_common_exertion(networks: Sequence[LinearNetwork]) -> LinearNetwork:
    """Motions add; of the type and form of the first network. Raises NoConversionError where there is no sum."""
    sources = [each.source if each.kind is Kind.NORTON else each.admittance.after(each.source) for each in networks]
    return _summed(networks, sources, [each.admittance for each in networks], Kind.NORTON, Form.ADMITTANCE)


def _summed(
    networks: Sequence[LinearNetwork],
    sources: Sequence[Operator],
    connections: Sequence[Operator],
    kind: Kind,
    form: Form,
) -> LinearNetwork:
    first, inputs = networks[0], [each.inputs for each in sources]
    wide = [
        widened(source, before=sum(inputs[:place]), after=sum(inputs[place + 1 :]))
        for place, source in enumerate(sources)
    ]
    source, connection = reduce(add, wide).minimal(), reduce(add, connections).minimal()
    # A source of the other type may grow on the way to that of the first network, where it does not.
    if first.kind is kind:
        source = bounded(source, kind)
    units = tuple(unit for each in networks for unit in each.command_units)
    provenance = {name: text for each in reversed(networks) for name, text in each.provenance.items()}
    return LinearNetwork(kind, form, source, connection, units, provenance).converted(first.kind, first.form)


def geared(network: LinearNetwork, ratio: float) -> LinearNetwork:
    """Motion divided by ``ratio``, exertion multiplied by it: Z by its square."""
    outer = 1.0 / ratio if network.kind is Kind.NORTON else ratio
    stiffer = ratio**2 if network.form is Form.IMPEDANCE else ratio**-2
    return replace(network, source=scaled(network.source, outer), connection=scaled(network.connection, stiffer))


def opposed(network: LinearNetwork, kind: Kind) -> LinearNetwork:
    """What takes it away again: −f at the same motion (``kind`` Thévenin), or −x at the same exertion (Norton)."""
    source = -network.source if network.kind is kind else network.source
    return replace(network, source=source, connection=-network.connection)


def scaled(operator: Operator, factor: float) -> Operator:
    """y = factor · operator(u)."""
    return Operator(operator.state, operator.entry, factor * operator.exit, factor * operator.direct)


def shares(operators: Sequence[Operator]) -> tuple[Operator, ...]:
    """Each operator over the sum of all. Raises NoConversionError where the sum is zero."""
    try:
        whole = reduce(add, operators).inverse()
    except ZeroDivisionError:
        raise NoConversionError("together the elements are zero, so they have no shares; check their signs") from None
    return tuple(each.after(whole).minimal() for each in operators)


def without_source(connection: Operator, form: Form = Form.IMPEDANCE) -> LinearNetwork:
    """A spring, a mass, a load: f = −Z x, or x = −Y f, and no commands."""
    kind = Kind.THEVENIN if form is Form.IMPEDANCE else Kind.NORTON
    nothing = Operator(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros((1, 0)))
    return LinearNetwork(kind, form, nothing, connection, ())
