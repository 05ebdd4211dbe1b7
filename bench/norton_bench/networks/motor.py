"""The identified motor among its family: its network in all four shapes, as the equations of sections III and IV.

Norton, impedance form: the source carries what the free rotor does, its friction contact included; the connection
carries that contact for either motion. With D the friction of a contact along a path, Km i cancels between the two:

    f = Im (a_N − a) + B (v_N − v) + D[v_N] − D[v]

a nonlinear connection, zero at x = x_N, that needs no command and is no function of x_N − x alone. Thévenin: f_T = Km i
joined linearly to Z(x) = Im a + B v + D[v], or to its inverse (Fig. 1), which the rotor's inertia provides. These are
the same motor, but a blocked port does not show f_T: what the contact holds, ± τc, depends on how it came to rest.
"""

from norton_bench.models.network import NortonNetwork
from norton_bench.networks.expressions import Equations
from norton_bench.networks.kinds import Form, Kind
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
    """The motor's network in one of its four shapes, written out: the same motor, only slower to simulate."""
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
