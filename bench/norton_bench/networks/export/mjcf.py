"""A network as a MuJoCo model (MJCF): a hinge with armature, damping and friction, and an actuator with a lag.

Attributes are those of MuJoCo's XML reference (joint: armature, damping, stiffness, frictionloss; actuator/general:
dyntype filterexact, gainprm). What MJCF has no words for is said in the file and beside it, with what it costs
(:mod:`norton_bench.networks.left_out`).

There are two forms. The first has dry friction, which any MuJoCo knows. The second has the actuator ``dcmotor`` of
newer ones for the friction contact: LuGre's friction (Canudas de Wit et al. 1995, IEEE Trans. Autom. Control 40:419)
with σ2 = 0 is Dahl's, its Stribeck curve included; each wave of cogging is a ``dcmotor`` with nothing else. Its
``motorconst`` and ``resistance`` are such that no back-EMF is left, and its inputs are none.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, hypot
from xml.sax.saxutils import quoteattr

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import TERM_BY_NAME, waves_of
from norton_bench.networks.export.mjcf_servo import following_costs, slow_servo
from norton_bench.networks.family import Network
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.left_out import (
    ExportedModel,
    presliding_sentence,
    standard_motion,
    term_sentences,
)
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.operator import Operator
from norton_drivers.servo import Servo

TIMESTEP_S = 5e-4
# MuJoCo's friction gives way within this many steps; fewer than two it does not allow.
STEPS_OF_FRICTION = 2
# The part of the inertia that the body carries, for MuJoCo wants every body to have some; the rest is armature.
BODY_SHARE = 0.01
# Terms that a dcmotor and a joint with a polynomial of damping have words for.
DCMOTOR_TERMS = ("stribeck", "drag", "cogging")
# Its back-EMF is motorconst²/resistance times the velocity: 1e-27 N m s/rad.
NO_BACK_EMF = 'motorconst="1e-9" resistance="1e9" input="none"'


@dataclass(frozen=True)
class _Loop:
    """A servo's: its ``damping``, and its ``greatest`` torque, 0 where nobody knows."""

    holds_position: bool
    damping: float
    greatest: float


@dataclass(frozen=True)
class _Joint:
    """What MJCF can say of an actuator; ``lag_s`` of zero is no lag.

    With ``loop`` it is a servo, and the gain that of its error.
    ``drag`` is in N m s²/rad². ``contact`` are dcmotor's ``lugre``: σ0, σ1, sliding friction, friction at rest, and
    Stribeck's velocity. ``waves`` are rows of periods a turn and the torques that go with cosine and sine.
    """

    gain: float
    lag_s: float
    inertia: float
    damping: float
    stiffness: float = 0.0
    friction: float = 0.0
    drag: float = 0.0
    contact: tuple[float, ...] = ()
    waves: tuple[tuple[float, ...], ...] = ()
    timestep_s: float = TIMESTEP_S
    loop: _Loop | None = None


def export_mjcf(network: Network, name: str, *, dcmotor: bool = False) -> ExportedModel:
    """``dcmotor`` chooses the form with that actuator, which only an identified motor has.

    Raises UsageError, in a sentence, for a network that a joint and an actuator of MuJoCo's cannot be.
    """
    match network:
        case NortonNetwork(servo=Servo() as servo):
            if dcmotor:
                raise UsageError("MuJoCo's dcmotor takes no goals; export a servo --to mujoco")
            joint, left_out = _servo(network, servo)
        case NortonNetwork():
            joint, left_out = _dcmotor(network) if dcmotor else _motor(network)
        case LinearNetwork() if not dcmotor:
            joint, left_out = _linear(network), ()
        case _ if dcmotor:
            raise UsageError(
                "MuJoCo's dcmotor is for an identified motor with friction; export this network --to mujoco"
            )
        case _:
            raise UsageError(
                "MJCF has no words for a nonlinear network's equations; export it as C or as an FMU, or step it beside "
                "the engine"
            )
    if not joint.inertia > 0.0:
        raise UsageError("the network has no inertia of its own, and MuJoCo moves nothing without; put it on the load")
    return ExportedModel(_model(joint, name, left_out), left_out)


def _motor(network: NortonNetwork) -> tuple[_Joint, tuple[str, ...]]:
    joint = _Joint(
        network.torque_gain,
        1.0 / network.amplifier_bandwidth_rad_s,
        network.rigid.inertia_kgm2,
        network.viscous_damping_nms_rad,
        friction=network.coulomb_torque_nm,
    )
    presliding = f"{presliding_sentence(network)} The form mujoco-dcmotor keeps it."
    return joint, (presliding, *term_sentences(network, tuple(TERM_BY_NAME)))


def _servo(network: NortonNetwork, servo: Servo) -> tuple[_Joint, tuple[str, ...]]:
    slow = slow_servo(network, servo)
    joint = _Joint(
        slow.gain,
        1.0 / network.amplifier_bandwidth_rad_s,
        slow.inertia,
        network.viscous_damping_nms_rad,
        friction=network.coulomb_torque_nm,
        loop=_Loop(servo.holds_position, slow.damping, network.torque_limit_nm or 0.0),
    )
    sentence = (
        f"The servo's loop acts at once here: kv = {slow.damping:.4g} N m s/rad and an inertia of {slow.inertia:.4g} "
        f"kg m², instead of {network.inertia_kgm2:.4g}, stand for what its delay and the amplifier's lag do to slow "
        f"motion. Presliding is left out. Together that costs {following_costs(network, slow)}."
    )
    unlimited = "" if network.torque_limit_nm else "The actuator has no forcerange: the servo's limit was not reached."
    names = tuple(dict.fromkeys(term.name for term in network.terms))
    terms = f"Terms are left out: {', '.join(names)}." if names else ""
    return joint, tuple(filter(None, (sentence, unlimited, terms)))


def _dcmotor(network: NortonNetwork) -> tuple[_Joint, tuple[str, ...]]:
    """Steps so short that the contact relaxes by no more than its own length in each, at the greatest velocity."""
    terms = {term.name: term.values for term in network.terms}
    more_at_rest, stribeck_rad_s = terms.get("stribeck", (0.0, 1.0))
    coulomb, stiffness = network.coulomb_torque_nm, network.presliding_stiffness_nm_rad
    joint = _Joint(
        network.torque_gain,
        1.0 / network.amplifier_bandwidth_rad_s,
        network.rigid.inertia_kgm2,
        network.viscous_damping_nms_rad,
        drag=terms.get("drag", (0.0,))[0],
        contact=(stiffness, network.presliding_damping_nms_rad, coulomb, coulomb + more_at_rest, stribeck_rad_s),
        waves=tuple(map(tuple, waves_of(network.terms).tolist())),
        timestep_s=min(TIMESTEP_S, coulomb / (stiffness * standard_motion(network).fastest_rad_s)),
    )
    return joint, term_sentences(network, [name for name in TERM_BY_NAME if name not in DCMOTOR_TERMS])


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
    drag = f" {joint.drag!r}" if joint.drag else ""
    # Implicit steps take the contact's derivatives amiss; Euler's are implicit in the joint's damping alone.
    integrator = "Euler" if joint.contact else "implicitfast"
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        "  <!-- An equivalent network exported by norton-bench. SI; the control is the network's command. -->",
        *(f"  <!-- {sentence.replace('--', '- -')} -->" for sentence in left_out),
        *_on_timestep(joint),
        f'  <option timestep="{joint.timestep_s!r}" integrator="{integrator}"/>',
        "  <worldbody>",
        '    <body name="output">',
        f'      <joint name="port" type="hinge" axis="0 0 1" armature="{joint.inertia - body!r}"'
        f' damping="{joint.damping!r}{drag}"{_springs(joint)}/>',
        "      <!-- The axis has a hundredth of the inertia, the armature the rest; what is moved goes in here. -->",
        f'      <inertial pos="0 0 0" mass="{max(1e-3, body)!r}" diaginertia="{body!r} {body!r} {body!r}"/>',
        "    </body>",
        "  </worldbody>",
        "  <actuator>",
        _actuator(joint),
        *_dcmotors(joint),
        "  </actuator>",
        "</mujoco>",
        "",
    ]
    return "\n".join(lines)


def _actuator(joint: _Joint) -> str:
    if joint.loop is not None:
        return _servo_actuator(joint, joint.loop)
    dynamics = f' dyntype="filterexact" dynprm="{joint.lag_s!r}"' if joint.lag_s else ""
    return f'    <general name="command" joint="port" gainprm="{joint.gain!r}"{dynamics}/>'


def _servo_actuator(joint: _Joint, loop: _Loop) -> str:
    """MuJoCo's ``position``, or its ``velocity`` written out, whose control has no lag there."""
    limit = f' forcerange="{-loop.greatest!r} {loop.greatest!r}"' if loop.greatest else ""
    if loop.holds_position:
        gains = f'kp="{joint.gain!r}" kv="{loop.damping!r}" timeconst="{joint.lag_s!r}"'
        return f'    <position name="command" joint="port" {gains}{limit}/>'
    lag = f'dyntype="filterexact" dynprm="{joint.lag_s!r}"'
    gains = f'gainprm="{joint.gain!r}" biastype="affine" biasprm="0 0 {-loop.damping!r}"'
    return f'    <general name="command" joint="port" {lag} {gains}{limit}/>'


def _springs(joint: _Joint) -> str:
    friction = (
        f' frictionloss="{joint.friction!r}" solreffriction="{STEPS_OF_FRICTION * TIMESTEP_S!r} 1"'
        if joint.friction
        else ""
    )
    return (f' stiffness="{joint.stiffness!r}"' if joint.stiffness else "") + friction


def _dcmotors(joint: _Joint) -> Iterator[str]:
    if joint.contact:
        lugre = " ".join(map(repr, joint.contact))
        yield f'    <dcmotor name="friction" joint="port" {NO_BACK_EMF} lugre="{lugre}"/>'
    for place, (periods, cosine, sine) in enumerate(joint.waves, start=1):
        # MuJoCo's wave is A·sin(pθ + φ).
        wave = f"{hypot(cosine, sine)!r} {periods!r} {atan2(cosine, sine)!r}"
        yield f'    <dcmotor name="cogging{place}" joint="port" {NO_BACK_EMF} cogging="{wave}"/>'


def _on_timestep(joint: _Joint) -> Iterator[str]:
    if joint.contact:
        yield (
            f"  <!-- The timestep lets the friction contact relax by no more than its own length, "
            f"sigma_0 |v| h / tau_c = 1, at {joint.contact[2] / (joint.contact[0] * joint.timestep_s):.3g} rad/s; "
            "shorten it for more. -->"
        )
