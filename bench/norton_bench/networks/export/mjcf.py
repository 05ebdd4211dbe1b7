"""A network as a MuJoCo model (MJCF): a hinge with armature, damping and friction, and an actuator with a lag.

Attributes are those of MuJoCo's XML reference (joint: armature, damping, stiffness, frictionloss; actuator/general:
dyntype filterexact, gainprm). What MJCF has no words for is said in the file and by :class:`MuJoCoModel`.
"""

from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.family import Network
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.operator import Operator

TIMESTEP_S = 5e-4
# MuJoCo's friction gives way within this many steps; fewer than two it does not allow.
STEPS_OF_FRICTION = 2
# The part of the inertia that the body carries, for MuJoCo wants every body to have some; the rest is armature.
BODY_SHARE = 0.01


@dataclass(frozen=True)
class MuJoCoModel:
    """``text`` of the MJCF file, and in sentences what it leaves out of the network."""

    text: str
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class _Joint:
    """What MJCF can say of an actuator; ``lag_s`` of zero is no lag."""

    gain: float
    lag_s: float
    inertia: float
    damping: float
    stiffness: float = 0.0
    friction: float = 0.0


def export_mjcf(network: Network, name: str) -> MuJoCoModel:
    """Raises UsageError, in a sentence, for a network that a joint and an actuator of MuJoCo's cannot be."""
    match network:
        case NortonNetwork():
            joint, left_out = _motor(network)
        case LinearNetwork():
            joint, left_out = _linear(network), ()
        case _:
            raise UsageError(
                "MJCF has no words for a nonlinear network's equations; export it as C or as an FMU, or step it beside "
                "the engine"
            )
    if not joint.inertia > 0.0:
        raise UsageError("the network has no inertia of its own, and MuJoCo moves nothing without; put it on the load")
    return MuJoCoModel(_model(joint, name, left_out), left_out)


def _motor(network: NortonNetwork) -> tuple[_Joint, tuple[str, ...]]:
    joint = _Joint(
        network.torque_gain,
        1.0 / network.amplifier_bandwidth_rad_s,
        network.inertia_kgm2,
        network.viscous_damping_nms_rad,
        friction=network.coulomb_torque_nm,
    )
    reach = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
    sentence = (
        f"Presliding is left out: frictionloss holds without a spring, where the contact yields by {reach:.3g} rad "
        f"(sigma_0 = {network.presliding_stiffness_nm_rad:.4g} N m/rad, "
        f"sigma_1 = {network.presliding_damping_nms_rad:.4g} N m s/rad) before it slides."
    )
    return joint, (sentence,)


def _linear(network: LinearNetwork) -> _Joint:
    thevenin = network.converted(Kind.THEVENIN, Form.IMPEDANCE)
    impedance, source = thevenin.connection.minimal(), thevenin.source
    if impedance.order or impedance.derivatives > 2:
        raise UsageError(
            "MJCF's joint is a stiffness, a damping and an inertia, and this impedance has states of its own"
        )
    stiffness, damping, inertia = [*impedance.direct[:, 0].tolist(), 0.0, 0.0][:3]
    if min(stiffness, damping) < 0.0:
        raise UsageError("MJCF's joint has no negative stiffness or damping; export the network as C or as an FMU")
    if source.inputs != 1:
        raise UsageError(f"MJCF's actuator has one control, and this source takes {source.inputs} commands")
    gain, lag_s = _gain_and_lag(source)
    return _Joint(gain, lag_s, inertia, damping, stiffness)


def _gain_and_lag(source: Operator) -> tuple[float, float]:
    direct = float(source.direct[0, 0])
    if not source.derivatives and not source.order:
        return direct, 0.0
    if not source.derivatives and source.order == 1 and direct == 0.0 and source.state[0, 0] < 0.0:
        rate = -float(source.state[0, 0])
        return float(source.exit[0] * source.entry[0, 0]) / rate, 1.0 / rate
    raise UsageError(
        "MJCF's actuator is a gain and at most one lag, and this network's exertion source is more than that; export "
        "it as C or as an FMU"
    )


def _model(joint: _Joint, name: str, left_out: tuple[str, ...]) -> str:
    body = BODY_SHARE * joint.inertia
    dynamics = f' dyntype="filterexact" dynprm="{joint.lag_s!r}"' if joint.lag_s else ""
    friction = (
        f' frictionloss="{joint.friction!r}" solreffriction="{STEPS_OF_FRICTION * TIMESTEP_S!r} 1"'
        if joint.friction
        else ""
    )
    stiffness = f' stiffness="{joint.stiffness!r}"' if joint.stiffness else ""
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        "  <!-- An equivalent network exported by norton-bench. SI; the control is the network's command. -->",
        *(f"  <!-- {sentence.replace('--', '- -')} -->" for sentence in left_out),
        f'  <option timestep="{TIMESTEP_S!r}" integrator="implicitfast"/>',
        "  <worldbody>",
        '    <body name="output">',
        f'      <joint name="port" type="hinge" axis="0 0 1" armature="{joint.inertia - body!r}"'
        f' damping="{joint.damping!r}"{stiffness}{friction}/>',
        "      <!-- The axis has a hundredth of the inertia, the armature the rest; what is moved goes in here. -->",
        f'      <inertial pos="0 0 0" mass="{max(1e-3, body)!r}" diaginertia="{body!r} {body!r} {body!r}"/>',
        "    </body>",
        "  </worldbody>",
        "  <actuator>",
        f'    <general name="command" joint="port" gainprm="{joint.gain!r}"{dynamics}/>',
        "  </actuator>",
        "</mujoco>",
        "",
    ]
    return "\n".join(lines)
