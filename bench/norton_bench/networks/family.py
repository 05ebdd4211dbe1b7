"""What every network can do, whichever it is: exertion under a motion, motion under an exertion, both with a load."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks import linear, nonlinear
from norton_bench.networks.expressions import Equations
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork

# The contact relaxes at s·|ω|. Beyond this velocity [rad/s] it does so no faster: it has long yielded there, and the
# steps of an integration can follow it at any speed. Its steady deflection is the same.
FASTEST_RAD_S = 100.0
HELD = f"max(min(v{{0}}, {FASTEST_RAD_S}), -{FASTEST_RAD_S})"
SLIP = f"{HELD} - s*abs({HELD})*phi{{0}}"
FRICTION = f"(sigma_0*phi{{0}} + sigma_1*({SLIP}))"
# What the free rotor is told of through its motion alone: Km i, from the source's.
DRIVE = f"Im*a_N + B*v_N + {FRICTION.format('_N')}"
LONGEST_STEP_S = 1e-4


def as_equations(network: NortonNetwork, kind: Kind = Kind.NORTON, form: Form = Form.IMPEDANCE) -> NonlinearNetwork:
    """The identified motor among its family: its network in all four shapes, as the equations of sections III and IV.

    Norton, impedance form: the source carries what the free rotor does, its friction contact included; the
    connection carries that contact for either motion. With D the friction of a contact along a path, Km i cancels
    between the two:

    f = Im (a_N − a) + B (v_N − v) + D[v_N] − D[v]

    a nonlinear connection, zero at x = x_N, that needs no command and is no function of x_N − x alone. Thévenin:
    f_T = Km i joined linearly to Z(x) = Im a + B v + D[v], or to its inverse (Fig. 1), which the rotor's inertia
    provides. These are the same motor, but a blocked port does not show f_T: what the contact holds, ± τc, depends
    on how it came to rest.

    The motor's network in one of its four shapes, written out: the same motor, only slower to simulate.
    """
    s = network.presliding_stiffness_nm_rad / network.coulomb_torque_nm
    mechanics = {
        "Im": network.inertia_kgm2,
        "B": network.viscous_damping_nms_rad,
        "s": s,
        "sigma_0": network.presliding_stiffness_nm_rad,
        "sigma_1": network.presliding_damping_nms_rad,
    }
    amplifier = {"beta": network.amplifier_bandwidth_rad_s, "gain": network.torque_gain}
    return NonlinearNetwork(
        kind,
        form,
        _source(kind, amplifier, mechanics),
        _connection(kind, form, mechanics),
        {"c": network.command_unit},
        joined_linearly=kind is Kind.THEVENIN,
        step_s=min(LONGEST_STEP_S, 1.0 / (s * FASTEST_RAD_S), _contact_step(network)),
        provenance=dict(network.provenance),
    )


def _source(kind: Kind, amplifier: dict[str, float], mechanics: dict[str, float]) -> Equations:
    lag = {"tau": "beta*(gain*c - tau)"}
    if kind is Kind.THEVENIN:
        return Equations(inputs=("c",), outputs={"f_T": "tau"}, rates=lag, parameters=amplifier)
    acceleration = f"(tau - B*v_w - {FRICTION.format('_w')})/Im"
    return Equations(
        inputs=("c",),
        outputs={"x_N": "x_w", "v_N": "v_w", "a_N": acceleration},
        rates={**lag, "x_w": "v_w", "v_w": acceleration, "phi_w": SLIP.format("_w")},
        parameters={**amplifier, **mechanics},
    )


def _connection(kind: Kind, form: Form, mechanics: dict[str, float]) -> Equations:
    """Of the port's motion in impedance form; with a rotor of its own in admittance form."""
    norton = kind is Kind.NORTON
    contact = {"phi_N": SLIP.format("_N")} if norton else {}
    if form is Form.IMPEDANCE:
        own = f"Im*a + B*v + {FRICTION.format('')}"
        outputs = {"f": f"{DRIVE} - ({own})"} if norton else {"f_Z": own}
        inputs: tuple[str, ...] = ("v_N", "a_N", "v", "a") if norton else ("v", "a")
        return Equations(inputs, outputs, {**contact, "phi": SLIP.format("")}, parameters=mechanics)
    driven = f"{DRIVE} - f" if norton else "df"
    acceleration = f"({driven} - B*v_r - {FRICTION.format('_r')})/Im"
    return Equations(
        inputs=("v_N", "a_N", "f") if norton else ("df",),
        outputs={"x": "x_r", "v": "v_r", "a": acceleration},
        rates={**contact, "x_r": "v_r", "v_r": acceleration, "phi_r": SLIP.format("_r")},
        parameters=mechanics,
    )


def _contact_step(network: NortonNetwork) -> float:
    """A step [s] that resolves the rotor on its contact: its natural frequency and its damping."""
    natural = (network.presliding_stiffness_nm_rad / network.inertia_kgm2) ** 0.5
    damped = (network.viscous_damping_nms_rad + network.presliding_damping_nms_rad) / network.inertia_kgm2
    return float(0.5 / (natural + damped + network.amplifier_bandwidth_rad_s))


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
    """The unit of each command, by name (c, or c1, c2, … where names are not given)."""
    match network:
        case NortonNetwork():
            return {"c": network.command_unit}
        case NonlinearNetwork():
            return dict(network.command_units)
    units = network.command_units
    return {f"c{place}" if len(units) > 1 else "c": unit for place, unit in enumerate(units, start=1)}


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
    """The exact equivalent of another type or form. Raises NoConversionError, in a sentence that says why."""
    if (kind, form) == (kind_of(network), form_of(network)):
        return network
    match network:
        case LinearNetwork():
            return network.converted(kind, form)
        case NortonNetwork():
            return as_equations(network, kind, form)
    raise NoConversionError(
        "a nonlinear network obeys no superposition, so source and connection cannot be exchanged or inverted in "
        f"general; keep it {kind_of(network).value}, in {form_of(network).value} form"
    )


def _commands(network: Network, command: npt.ArrayLike, ticks: int | None) -> FloatArray:
    commands = linear.as_commands(command, len(commands_of(network)))
    if not len(commands) or (ticks is not None and len(commands) != ticks):
        raise UsageError(f"{len(commands)} commands for {ticks or 'no'} ticks; give one for each tick")
    return commands
