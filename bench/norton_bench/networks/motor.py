"""The identified motor with its terms as equations, in all four shapes (paper, sections III and IV).

Norton, impedance form: the source has what the free rotor does, its friction contact included; the connection has that
contact for either motion. With D the friction of a contact along a path, Km i cancels between the two:

    f = Im (a_N − a) + B (v_N − v) + D[v_N] − D[v]

a nonlinear connection, zero at x = x_N, that needs no command and is no function of x_N − x alone. Thévenin:
f_T = Km i joined to Z(x) = Im a + B v + D[v], or to its inverse (Fig. 1), which the rotor's inertia provides. These are
the same motor, but a blocked port does not show f_T: what the contact holds, ± τc, depends on how it came to rest.

The terms of :mod:`norton_bench.models.terms` change these equations where they act:

- strength γ: the contact of D slides by s/γ instead of s; at the free source the port's torque is zero;
- damping b: b·B instead of B;
- saturation: of the source's Km i, before it goes to the port;
- ripple: Km i is more or less at some places. The connection of a Norton network takes Km i from the source's motion at
  the source's place, and has it at the port's place;
- cogging: a torque beside Km i, at the source's place or at the port's;
- what drifts in time has no part: a network holds for the middle of its session.

A motor behind a joint is a Thévenin network: a torque source at the motor, and a connection that has the motor,

    f = τ_j − J a,     Im q̈ = Km i − B q̇ − D[q] − τ_j,     τ_j = k (q − x) + d (q̇ − v)

It has no Norton network of equations: its connection would have to know Km i from the motion of the free port, and that
takes the fourth derivative of it, while a source puts out two. (The identified network itself computes free motion and
torque, both from the command.)

A Thévenin connection is linear in f_T as long as nothing there multiplies it: ripple does, and so does friction that
grows with the torque at the port. In impedance form, that torque is what comes out; friction is then reckoned from the
torque without the presliding damper's share σ1·φ̇, which is zero in steady sliding.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import LEAST_STRENGTH, LIGHTEST_OUTPUT, Factor, NetworkTerm, waves_of
from norton_bench.networks.expressions import Equations
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.nonlinear import NonlinearNetwork

# The contact relaxes at s·|ω|. Beyond this velocity [rad/s] it does so no faster: it has long yielded there, and the
# steps of an integration can follow it at any speed. Its steady deflection is the same.
FASTEST_RAD_S = 100.0
HELD = f"max(min(v{{0}}, {FASTEST_RAD_S}), -{FASTEST_RAD_S})"
LONGEST_STEP_S = 1e-4


def as_equations(network: NortonNetwork, kind: Kind = Kind.NORTON, form: Form = Form.IMPEDANCE) -> NonlinearNetwork:
    """The motor's network in one of its four shapes, written out: the same motor, only slower to simulate.

    A motor behind a joint is written as Thévenin's where Norton's impedance is asked for: what goes in and out is the
    same. Raises NoConversionError, in a sentence, for Norton's admittance of it, and for a servo.
    """
    if network.servo is not None:
        raise NoConversionError(
            "a servo's loop acts on where the shaft was before, for which these equations have no words; "
            "use its torque() and free_motion(), or export it --to mujoco"
        )
    motor = _Motor(network)
    if network.joint is not None:
        return _behind_joint(motor, network.joint, kind, form)
    joined_linearly = kind is Kind.THEVENIN and not motor.multiplies_source
    return NonlinearNetwork(
        kind,
        form,
        _source(motor, kind),
        _norton(motor, form) if kind is Kind.NORTON else _thevenin(motor, form, joined_linearly=joined_linearly),
        {"c": network.command_unit},
        joined_linearly=joined_linearly,
        step_s=min(LONGEST_STEP_S, motor.least_strength / (motor.s * FASTEST_RAD_S), _contact_step(network)),
        provenance=dict(network.provenance),
    )


@dataclass(frozen=True)
class _Motor:
    """The parts of the motor's equations as text; ``at`` is "_N", "_w", "_r" or "": whose x, v, a and phi they are of.

    ``port`` is the torque at the port as text, "0" at the free source.
    """

    network: NortonNetwork

    @property
    def s(self) -> float:
        return self.network.presliding_stiffness_nm_rad / self.network.coulomb_torque_nm

    @property
    def amplifier(self) -> dict[str, float]:
        saturation = {"kappa": self._terms["saturation"].values[0]} if "saturation" in self._terms else {}
        return {"beta": self.network.amplifier_bandwidth_rad_s, "gain": self.network.torque_gain, **saturation}

    @cached_property
    def mechanics(self) -> dict[str, float]:
        """Parameters by name: those of the plain motor, and those of the terms that it has."""
        return {
            "Im": self.network.inertia_kgm2,
            "B": self.network.viscous_damping_nms_rad,
            "s": self.s,
            "sigma_0": self.network.presliding_stiffness_nm_rad,
            "sigma_1": self.network.presliding_damping_nms_rad,
            **{
                f"{term.name}_{place}": value
                for term in self.network.relative_terms
                if term.name != "saturation" and not term.term.in_time and term.term.factor is not Factor.JOINT
                for place, value in enumerate(term.values)
            },
            **{
                f"cogging_{number}_{place}": value
                for number, (_, *values) in self._waves
                for place, value in enumerate(values)
            },
        }

    @cached_property
    def _terms(self) -> dict[str, NetworkTerm]:
        return {term.name: term for term in self.network.relative_terms}

    @property
    def _waves(self) -> Iterator[tuple[int, list[float]]]:
        return enumerate(waves_of(self.network.terms).tolist())

    @property
    def multiplies_source(self) -> bool:
        """Whether a Thévenin connection is not linear in f_T."""
        return "ripple" in self._terms or "load" in self._terms

    @property
    def rests_on_place(self) -> bool:
        """Whether anything but Km i depends on the position: friction or a torque of its own."""
        return "friction_by_position" in self._terms or any(self._waves)

    @property
    def rippled(self) -> bool:
        return "ripple" in self._terms

    @cached_property
    def least_strength(self) -> float:
        """The least that γ may become: the contact relaxes the quicker."""
        least = 1.0 + min(self._value("stribeck"), 0.0) - abs(self._value("asymmetry"))
        position = self._terms.get("friction_by_position")
        least -= sum(value**2 for value in position.values) ** 0.5 if position else 0.0
        return min(max(least, LEAST_STRENGTH), 1.0)

    def _value(self, name: str) -> float:
        return self._terms[name].values[0] if name in self._terms else 0.0

    def strength(self, at: str, port: str) -> str:
        """γ of the contact; "" where it is 1."""
        parts = {
            "stribeck": f"stribeck_0*exp(-(v{at}/stribeck_1)**2)",
            "asymmetry": f"asymmetry_0*sign(v{at})",
            "load": "" if port == "0" else f"load_0*abs({port})",
            "friction_by_position": self._wave("friction_by_position", f"x{at}"),
        }
        chosen = [text for name, text in parts.items() if name in self._terms and text]
        return f"max({' + '.join(['1', *chosen])}, {LEAST_STRENGTH})" if chosen else ""

    def slip(self, at: str, port: str) -> str:
        """φ̇ of the contact."""
        held, strength = HELD.format(at), self.strength(at, port)
        relaxation = f"s*abs({held})*phi{at}"
        return f"{held} - {relaxation}/{strength}" if strength else f"{held} - {relaxation}"

    def friction(self, at: str, port: str) -> str:
        """D, the torque of the contact."""
        return f"(sigma_0*phi{at} + sigma_1*({self.slip(at, port)}))"

    def damping(self, at: str) -> str:
        """b·B·v."""
        return f"B*v{at}*(1 + drag_0*abs(v{at}))" if "drag" in self._terms else f"B*v{at}"

    def cogging(self, at: str) -> str:
        """The torque beside Km i, with a plus before each part; "" where there is none."""
        return "".join(
            f" + cogging_{number}_0*cos({periods}*x{at}) + cogging_{number}_1*sin({periods}*x{at})"
            for number, (periods, *_) in self._waves
        )

    def ripple(self, at: str) -> str:
        """The factor of Km i at a place."""
        return f"(1 + {self._wave('ripple', f'x{at}')})"

    def _wave(self, name: str, angle: str) -> str:
        if name not in self._terms:
            return ""
        phase = f"{self._terms[name].periods_per_turn}*{angle}"
        return f"{name}_0*cos({phase}) + {name}_1*sin({phase})"

    def exerted(self, torque: str, at: str) -> str:
        """What moves the rotor at a place, of Km i without its ripple."""
        return (f"{torque}*{self.ripple(at)}" if self.rippled else torque) + self.cogging(at)

    @property
    def saturated(self) -> str:
        """Km i without its ripple, from the lagged command's torque ``tau``."""
        return "tau/(1 + kappa*(tau/gain)**2)" if "saturation" in self._terms else "tau"

    def own(self, at: str, port: str) -> str:
        """What inertia, damping and friction take at a motion."""
        return f"Im*a{at} + {self.damping(at)} + {self.friction(at, port)}"

    @property
    def _drive(self) -> str:
        """Km i at the free source's place, as the source's motion tells it."""
        taken, cogging = self.own("_N", "0"), self.cogging("_N")
        return f"{taken} - ({cogging.removeprefix(' + ')})" if cogging else taken

    def drive(self, at: str) -> str:
        """Km i and the cogging at the place ``at`` of the port, from the source's motion."""
        if not self.rippled:
            return self._drive + self.cogging(at)
        return f"({self._drive})/{self.ripple('_N')}*{self.ripple(at)}{self.cogging(at)}"

    def places(self, *names: str) -> tuple[str, ...]:
        """Those of ``names`` that the connection must know: positions only where something depends on them."""
        needed = self.rippled or self.rests_on_place
        return tuple(name for name in names if needed or not name.startswith("x"))


def _source(motor: _Motor, kind: Kind) -> Equations:
    lag = {"tau": "beta*(gain*c - tau)"}
    if kind is Kind.THEVENIN:
        return Equations(inputs=("c",), outputs={"f_T": motor.saturated}, rates=lag, parameters=motor.amplifier)
    exerted = motor.exerted(motor.saturated, "_w")
    acceleration = f"({exerted} - {motor.damping('_w')} - {motor.friction('_w', '0')})/Im"
    return Equations(
        inputs=("c",),
        outputs={"x_N": "x_w", "v_N": "v_w", "a_N": acceleration},
        rates={**lag, "x_w": "v_w", "v_w": acceleration, "phi_w": motor.slip("_w", "0")},
        parameters={**motor.amplifier, **motor.mechanics},
    )


def _norton(motor: _Motor, form: Form) -> Equations:
    """Of source and port: of the port's motion in impedance form, with a rotor of its own in admittance form."""
    contact = {"phi_N": motor.slip("_N", "0")}
    if form is Form.IMPEDANCE:
        drive = motor.drive("")
        port = f"{drive} - Im*a - {motor.damping('')} - sigma_0*phi"
        outputs, rates = {"f": f"{drive} - ({motor.own('', port)})"}, {**contact, "phi": motor.slip("", port)}
        return Equations(motor.places("x_N", "v_N", "a_N", "x", "v", "a"), outputs, rates, parameters=motor.mechanics)
    moved = _moved(motor, f"{motor.drive('_r')} - f", "f")
    return Equations(motor.places("x_N", "v_N", "a_N", "f"), *_rotor(motor, moved, contact), parameters=motor.mechanics)


def _thevenin(motor: _Motor, form: Form, *, joined_linearly: bool) -> Equations:
    """Of f_T and the port; of the port alone, or of f_T − f, where the connection is linear in f_T."""
    if form is Form.ADMITTANCE:
        driven = f"df{motor.cogging('_r')}" if joined_linearly else f"{motor.exerted('f_T', '_r')} - f"
        taken = ("df",) if joined_linearly else ("f_T", "f")
        return Equations(taken, *_rotor(motor, _moved(motor, driven, "f"), {}), parameters=motor.mechanics)
    exerted = motor.exerted("f_T", "")
    port = f"{exerted} - Im*a - {motor.damping('')} - sigma_0*phi"
    rates = {"phi": motor.slip("", port)}
    if joined_linearly:
        cogging = motor.cogging("")
        own = f"{motor.own('', port)} - ({cogging.removeprefix(' + ')})" if cogging else motor.own("", port)
        return Equations(motor.places("x", "v", "a"), {"f_Z": own}, rates, parameters=motor.mechanics)
    inputs = ("f_T", *motor.places("x", "v", "a"))
    return Equations(inputs, {"f": f"{exerted} - ({motor.own('', port)})"}, rates, parameters=motor.mechanics)


NO_NORTON = (
    "a motor behind a joint has no Norton network of equations: to regain the motor's torque from the free port's "
    "motion takes the fourth derivative of it; convert it to thevenin"
)


def _behind_joint(motor: _Motor, joint: tuple[float, float, float, float], kind: Kind, form: Form) -> NonlinearNetwork:
    """Thévenin's network of a motor behind a joint. The state is how far the motor is ahead of the port."""
    if (kind, form) == (Kind.NORTON, Form.ADMITTANCE):
        raise NoConversionError(NO_NORTON)
    network, (stiffness, damper, output_inertia, half) = motor.network, joint
    output_inertia = max(output_inertia, LIGHTEST_OUTPUT * network.inertia_kgm2)
    port = "" if form is Form.IMPEDANCE else "_r"
    pull = f"(k*{{}} + d*(v_q - v{port}))"
    if half:
        beyond = [pull.format(f"(ahead {sign} half)") for sign in "-+"]
        carried = f"({beyond[0]} if half < ahead else ({beyond[1]} if ahead < -half else 0))"
    else:
        carried = pull.format("ahead")
    turned = f"({motor.exerted('f_T', '_q')} - {motor.damping('_q')} - {motor.friction('_q', carried)} - {carried})/Im"
    rates = {"ahead": f"v_q - v{port}", "v_q": turned, "phi_q": motor.slip("_q", carried)}
    if form is Form.IMPEDANCE:
        inputs, outputs = ("f_T", *motor.places("x"), "v", "a"), {"f": f"{carried} - J*a"}
    else:
        inputs, moved = ("f_T", "f"), f"({carried} - f)/J"
        outputs, rates = {"x": "x_r", "v": "v_r", "a": moved}, {"x_r": "v_r", "v_r": moved, **rates}
    # The motor's own place, of which some terms are functions.
    rates = {name: text.replace("x_q", f"(x{port} + ahead)") for name, text in rates.items()}
    parameters = {
        **motor.mechanics,
        "k": stiffness,
        "d": damper,
        "J": output_inertia,
        **({"half": half} if half else {}),
    }
    swing = sum((stiffness / each) ** 0.5 + damper / each for each in (network.inertia_kgm2, output_inertia))
    return NonlinearNetwork(
        Kind.THEVENIN,
        form,
        _source(motor, Kind.THEVENIN),
        Equations(inputs, outputs, rates, parameters=parameters),
        {"c": network.command_unit},
        step_s=min(
            LONGEST_STEP_S, motor.least_strength / (motor.s * FASTEST_RAD_S), 0.5 / swing, _contact_step(network)
        ),
        provenance=dict(network.provenance),
    )


def _moved(motor: _Motor, driven: str, port: str) -> str:
    """The acceleration of a rotor under ``driven``."""
    return f"({driven} - {motor.damping('_r')} - {motor.friction('_r', port)})/Im"


def _rotor(motor: _Motor, acceleration: str, contact: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Outputs and rates of a connection with a rotor of its own."""
    rates = {**contact, "x_r": "v_r", "v_r": acceleration, "phi_r": motor.slip("_r", "f")}
    return {"x": "x_r", "v": "v_r", "a": acceleration}, rates


def _contact_step(network: NortonNetwork) -> float:
    """A step [s] that resolves the rotor on its contact: its natural frequency and its damping."""
    natural = (network.presliding_stiffness_nm_rad / network.inertia_kgm2) ** 0.5
    damped = (network.viscous_damping_nms_rad + network.presliding_damping_nms_rad) / network.inertia_kgm2
    return float(0.5 / (natural + damped + network.amplifier_bandwidth_rad_s))
