"""What every network can do, whichever it is: exertion under a motion, motion under an exertion, both with a load."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks import linear, nonlinear
from norton_bench.networks.equivalents import equivalent
from norton_bench.networks.kinds import Form, Kind, Load, Motion
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.motor import as_equations
from norton_bench.networks.nonlinear import NonlinearNetwork

Network = LinearNetwork | NonlinearNetwork | NortonNetwork


@dataclass(frozen=True)
class Coupled:
    """What every network can do, whichever it is: exertion under a motion, motion under an exertion, both with a load.

    What a load does on the port, at the ticks: angle [rad] and exertion [N m], each (n,).

    The exertion is None where a step of the command would be a blow, which has no value at a tick.
    """

    position_rad: FloatArray
    exertion_nm: FloatArray | None


def kind_of(network: Network) -> Kind:
    """Thévenin or Norton."""
    return Kind.NORTON if isinstance(network, NortonNetwork) else network.kind


def form_of(network: Network) -> Form:
    """Impedance or admittance."""
    return Form.IMPEDANCE if isinstance(network, NortonNetwork) else network.form


def commands_of(network: Network) -> dict[str, str]:
    """The unit of each command, by name."""
    match network:
        case NortonNetwork():
            return {"c": network.command_unit}
        case NonlinearNetwork():
            return dict(network.command_units)
    return network.commands


def exertion(network: Network, command: npt.ArrayLike, motion: Motion, tick_s: float) -> FloatArray:
    """f [N m] at the ticks, shape (n,), of an impedance form under a motion, from rest.

    ``command`` is (n,) or (n, m), held from tick to tick. Raises UsageError, in a sentence, for an admittance form.
    """
    if form_of(network) is not Form.IMPEDANCE:
        raise UsageError("an admittance form takes exertion in and puts motion out; convert it, or call motion()")
    commands = _commands(network, command, motion.position_rad.size)
    match network:
        case NortonNetwork():
            return network.torque(commands[:, 0], motion.position_rad, tick_s)
        case LinearNetwork():
            return linear.respond(linear.joint(network), commands, motion.derivatives(), tick_s)
    port = dict(zip(("x", "v", "a"), motion.derivatives(), strict=True))
    return nonlinear.respond(network, commands, port, tick_s)["f"]


def motion(network: Network, command: npt.ArrayLike, exertion_nm: npt.ArrayLike, tick_s: float) -> FloatArray:
    """x [rad] at the ticks, shape (n,), of an admittance form under an exertion, from rest.

    Raises UsageError, in a sentence, for an impedance form.
    """
    given = np.asarray(exertion_nm, dtype=float)
    if form_of(network) is not Form.ADMITTANCE or isinstance(network, NortonNetwork):
        raise UsageError("an impedance form takes motion in and puts exertion out; convert it, or call exertion()")
    commands = _commands(network, command, given.size)
    if isinstance(network, LinearNetwork):
        return linear.respond(linear.joint(network), commands, given[None, :], tick_s)
    return nonlinear.respond(network, commands, {"f": given}, tick_s)["x"]


def coupled(network: Network, command: npt.ArrayLike, load: Load, tick_s: float) -> Coupled:
    """The port with a load on it, from rest. Raises UsageError, in a sentence, where no motion follows."""
    commands = _commands(network, command, None)
    if isinstance(network, LinearNetwork):
        return Coupled(*linear.coupled(network, commands, load, tick_s))
    written = as_equations(network) if isinstance(network, NortonNetwork) else network
    result = nonlinear.coupled(written, commands, load, tick_s)
    return Coupled(result["x"], result["f"])


def converted(network: Network, kind: Kind, form: Form) -> Network:
    """The equivalent of another type or form: exact, or by a table whose error its provenance tells.

    Raises NoConversionError, in a sentence that says why there is none.
    """
    if (kind, form) == (kind_of(network), form_of(network)):
        return network
    match network:
        case LinearNetwork():
            return network.converted(kind, form)
        case NortonNetwork():
            return as_equations(network, kind, form)
    return equivalent(network, kind, form)


def _commands(network: Network, command: npt.ArrayLike, ticks: int | None) -> FloatArray:
    commands = linear.as_commands(command, len(commands_of(network)))
    if not len(commands) or (ticks is not None and len(commands) != ticks):
        raise UsageError(f"{len(commands)} commands for {ticks or 'no'} ticks; give one for each tick")
    return commands
