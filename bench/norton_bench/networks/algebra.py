"""Networks put together at their ports, and taken apart again (paper, sections II, III and IV.C).

Of two elements the paper knows two connections (section III): common motion, where exertions add, and common exertion,
where motions add. Mechanics calls the first parallel and the second series, as with springs; in the electric circuit of
the same element (exertion for voltage, motion for current) the words are exchanged.

What is linear is exact, by operators. Networks of equations are put together by their equations; an identified motor
takes part as the Thévenin network that it is, whose connection stays linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks import equation_couplings, linear_couplings
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import Network, commands_of, converted, form_of, kind_of
from norton_bench.networks.forms import TABLE
from norton_bench.networks.kinds import Form, Kind, NoConversionError, told_as_no_conversion
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.written import written


@dataclass(frozen=True)
class Carried:
    """What moves with the port and takes a part of the exertion: a load, with its weight (Z_G, section IV.C)."""

    element: Network


@dataclass(frozen=True)
class Yielding:
    """What bears the exertion of the port and gives a part of its motion: a spring in series."""

    element: Network


@dataclass(frozen=True)
class Gear:
    """A gear or lever: the outer port has 1/``ratio`` of the motion, and ``ratio`` times the exertion."""

    ratio: float


Between = Carried | Yielding | Gear


def element(impedance: Operator | str, **parameters: float) -> Network:
    """A network without a source, as a spring, a mass or a load is one: it exerts −Z(x) on what moves it.

    ``impedance`` is an operator [N m/rad], or an expression of x [rad], v and a, as ``"K*x + G*sin(x)"`` with its
    parameters. Raises UsageError, in a sentence, for what is no expression of these.
    """
    if isinstance(impedance, Operator):
        return linear_couplings.without_source(impedance)
    try:
        connection = Equations(("x", "v", "a"), {"f_Z": impedance}, parameters=parameters)
    except ValueError as error:
        raise UsageError(f"element: {error}") from None
    return NonlinearNetwork(
        Kind.THEVENIN, Form.IMPEDANCE, Equations((), {"f_T": "0"}), connection, {}, joined_linearly=True
    )


def in_parallel(*networks: Network) -> Network:
    """One network for several that have one motion: their exertions add, Z = Z₁ + Z₂.

    Two motors on one shaft. The commands are those of all, one after the other. Raises NoConversionError, in a
    sentence, where the sum does not exist (a motion source without an impedance) or equations would have to be solved.
    """
    return _summed(networks, Kind.THEVENIN)


def in_series(*networks: Network) -> Network:
    """One network for several that have one exertion: their motions add, Y = Y₁ + Y₂.

    A motor that carries another, or a spring. Raises NoConversionError as :func:`in_parallel` does.
    """
    return _summed(networks, Kind.NORTON)


def _summed(networks: Sequence[Network], kind: Kind) -> Network:
    if len(networks) < 2:
        raise UsageError("one network alone has nothing to be joined to; give two or more")
    linear = [each for each in networks if isinstance(each, LinearNetwork)]
    if len(linear) == len(networks):
        by = linear_couplings.of_common_motion if kind is Kind.THEVENIN else linear_couplings.of_common_exertion
        return by(linear)
    form = equation_couplings.COMMON[kind][1]
    known: list[Network] = [
        converted(each, Kind.THEVENIN, form) if isinstance(each, NortonNetwork) else each for each in networks
    ]
    attempts = (known, _in_form_that_adds(known, form, but=1), _in_form_that_adds(known, form, but=0))
    for attempt in attempts[:-1]:
        try:
            return _put_together(attempt, kind)
        except NoConversionError:
            continue
    return _put_together(attempts[-1], kind)


def _put_together(networks: Sequence[Network], kind: Kind) -> Network:
    with told_as_no_conversion():
        return equation_couplings.summed([written(each) for each in networks], kind)


def _in_form_that_adds(networks: Sequence[Network], form: Form, but: int) -> list[Network]:
    """All but so many, as far as they have it exactly; those with inertia first, which do not answer at once."""
    result = list(networks)
    for place in sorted(range(len(result)), key=lambda place: not _has_inertia(result[place])):
        if sum(form_of(each) is not form for each in result) > but:
            result[place] = _exactly_in_form(result[place], form)
    return result


def _has_inertia(network: Network) -> bool:
    if isinstance(network, LinearNetwork):
        return network.form is Form.IMPEDANCE and network.connection.derivatives > 1
    return isinstance(network, NonlinearNetwork) and bool({"a", "da"} & set(network.connection.inputs))


def _exactly_in_form(network: Network, form: Form) -> Network:
    """The network in another form, where it has that without a table; else as it is."""
    try:
        other = converted(network, kind_of(network), form)
    except NoConversionError:
        return network
    return network if any(name.startswith(TABLE) for name in set(other.provenance) - set(network.provenance)) else other


def geared(network: Network, ratio: float) -> Network:
    """The network seen beyond a gear, lever or other transformer: motion over ``ratio``, exertion times ``ratio``.

    Z becomes ratio² Z, f_T ratio f_T, and x_N x_N/ratio; a negative ratio turns the direction. Raises UsageError for a
    ratio of zero.
    """
    if not isfinite(ratio) or ratio == 0.0:
        raise UsageError(f"ratio {ratio}: a gear needs a finite ratio that is not zero")
    if isinstance(network, LinearNetwork):
        return linear_couplings.geared(network, ratio)
    whole = converted(network, Kind.THEVENIN, Form.IMPEDANCE) if isinstance(network, NortonNetwork) else network
    with told_as_no_conversion():
        return equation_couplings.geared(written(whole), ratio)


def linked(network: Network, angle: str, **parameters: float) -> Network:
    """The network beyond a linkage, whose ratio changes with the place: ``angle`` is its own angle, of the outer ``x``.

    A crank, an elliptic gear: ``"x + e*sin(x)"`` with its parameters. The exertion of the outer port is the network's
    times the slope n(x) of this map (its Jacobian). Gives a Thévenin impedance. Raises UsageError, in a sentence, for
    an expression without a derivative, NoConversionError for a network that is no Thévenin impedance.
    """
    whole = written(converted(network, Kind.THEVENIN, Form.IMPEDANCE))
    try:
        return equation_couplings.linked(whole, angle, parameters)
    except ValueError as error:
        raise UsageError(f"linkage: {error}") from None


def outward(network: Network, *between: Between) -> Network:
    """The network as it is seen at an outer port, through what lies between, from the inner port on (section IV.C).

    An actuator of impedance Z_A that carries a load of Z_G has Z_P at the outer port. Raises NoConversionError as
    :func:`in_parallel` does.
    """
    for part in between:
        match part:
            case Carried(each):
                network = in_parallel(network, _sourceless(each))
            case Yielding(each):
                network = in_series(network, _sourceless(each))
            case Gear(ratio):
                network = geared(network, ratio)
    return network


def inward(network: Network, *between: Between) -> Network:
    """The network at the inner port, from that at the outer port: what lies between is taken away.

    ``between`` are those of :func:`outward`, in the same order.
    """
    for part in reversed(between):
        match part:
            case Carried(each):
                network = in_parallel(network, _opposed(_sourceless(each), Kind.THEVENIN))
            case Yielding(each):
                network = in_series(network, _opposed(_sourceless(each), Kind.NORTON))
            case Gear(ratio):
                network = geared(network, 1.0 / ratio if ratio else ratio)
    return network


def _sourceless(network: Network) -> Network:
    if commands_of(network):
        raise UsageError(
            "what lies between two ports has no commands of its own; join a network that has some by in_parallel or "
            "in_series"
        )
    return network


def _opposed(network: Network, kind: Kind) -> Network:
    if isinstance(network, LinearNetwork):
        return linear_couplings.opposed(network, kind)
    with told_as_no_conversion():
        return equation_couplings.opposed(written(network), kind)


def exertion_shares(*impedances: Operator) -> tuple[Operator, ...]:
    """What each of several elements of one motion takes of their exertion: Zᵢ/ΣZ, which together are 1.

    Raises NoConversionError where together they are zero.
    """
    return linear_couplings.shares(impedances)


def motion_shares(*admittances: Operator) -> tuple[Operator, ...]:
    """What each of several elements of one exertion takes of their motion: Yᵢ/ΣY, which together are 1.

    Raises NoConversionError where together they are zero.
    """
    return linear_couplings.shares(admittances)
