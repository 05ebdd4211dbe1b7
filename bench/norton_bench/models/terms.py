"""The terms that a network may have beside the paper's motor: factors on the motor's parameters, and a torque.

    τ = g·Km·Ka·lag(c) − Im·ω̇ − b·B·ω − σ0·φ − σ1·φ̇ + τ(θ),     φ̇ = ω − σ0/(γ·τc)·|ω|·φ

The factors g, b and γ are 1 for the paper's motor (section IV.D), and τ(θ) is none. A term changes one of them; the
friction contact keeps its stiffness σ0, and slides towards the strength γ·τc that it has there and then. A joint is
another kind of term: it puts the whole motor, whose angle is then q, behind something that gives (section VI). The
table below is the only list of terms: the fit, the network file, its prediction, the report and the documents follow
from it. What the terms do there and then is computed in :mod:`norton_bench.models.network_steps`, what a joint does in
:mod:`norton_bench.models.joint_steps`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import inf

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.parameters import Parameter


class Factor(Enum):
    """What a term changes."""

    GAIN = "gain"  # g, of the torque gain
    DAMPING = "damping"  # b, of the viscous damping
    STRENGTH = "strength"  # γ, of the Coulomb torque
    TORQUE = "torque"  # τ(θ): added, not multiplied
    JOINT = "joint"  # between motor and port


@dataclass(frozen=True)
class TermParameter(Parameter):
    """One parameter of a term. The factors are computed from its value over that of the parameter ``over``.

    ``column`` is its place in the row of factors. The search goes on between ``low`` and ``high``, which are of the
    value over ``over``; over its logarithm where ``logarithmic``, which holds for what cannot be zero.
    """

    column: int = 0
    over: str = ""
    low: float = -inf
    high: float = inf
    logarithmic: bool = False


@dataclass(frozen=True)
class Term:
    """One line of the table. ``equation`` is for readers; ``periodic`` terms repeat p times a turn.

    ``excitation`` says what motion or command tells its parameters. A term ``in_time`` is of the session that was
    fitted, with t = 0 in its middle: predictions are for then.
    """

    name: str
    factor: Factor
    equation: str
    meaning: str
    excitation: str
    parameters: tuple[TermParameter, ...]
    periodic: bool = False
    in_time: bool = False


# Columns of a row of factors. The periods have a column of their own beside the cosine's and the sine's.
STRIBECK, STRIBECK_VELOCITY, ASYMMETRY, LOAD, SATURATION, DRAG = range(6)
FRICTION_COSINE, FRICTION_SINE, FRICTION_PERIODS, RIPPLE_COSINE, RIPPLE_SINE, RIPPLE_PERIODS = range(6, 12)
GAIN_DRIFT, GAIN_BEND, DAMPING_DRIFT, DAMPING_BEND, FRICTION_DRIFT, FRICTION_BEND = range(12, 18)
JOINT_STIFFNESS, JOINT_DAMPING, OUTPUT_INERTIA, BACKLASH_WIDTH = range(18, 22)
COLUMNS = 22
# A contact without any strength has no equation; no friction that is asked for comes near to it.
LEAST_STRENGTH = 0.02
# A share of a factor that adds to 1 may take most of it, not all: a factor of nothing would leave no torque to fit.
MOST_SHARE = 0.9
# Of the motor's inertia. A lighter output follows its joint at once; it is moved as if it had this much.
LIGHTEST_OUTPUT = 1e-3
PERIODS = {"friction_by_position": FRICTION_PERIODS, "ripple": RIPPLE_PERIODS}
# All over the motor's inertia: the square of the frequency at which it would swing on the joint, a rate, and a share.
JOINT_PARAMETERS = (
    TermParameter("joint_stiffness", "k", "N*m/rad", "torque of the joint per deflection", JOINT_STIFFNESS, "inertia",
                  logarithmic=True),
    TermParameter("joint_damping", "d", "N*m*s/rad", "torque of the joint per rate of its deflection", JOINT_DAMPING,
                  "inertia", low=0.0),
    TermParameter("output_inertia", "J", "kg*m^2", "inertia of what turns with the port, beyond the joint",
                  OUTPUT_INERTIA, "inertia", low=0.0),
)  # fmt: skip


def _wave(name: str, what: str, column: int) -> tuple[TermParameter, TermParameter]:
    """Cosine and sine of a factor; ``column`` is the cosine's, and the next the sine's."""
    cosine, sine = (
        TermParameter(
            f"{name}_{wave}",
            symbol,
            "1",
            f"share of {what} that goes with {function}(pθ)",
            column + place,
            low=-MOST_SHARE,
            high=MOST_SHARE,
        )
        for place, (wave, symbol, function) in enumerate((("cosine", "a", "cos"), ("sine", "b", "sin")))
    )
    return cosine, sine


TERMS = (
    Term(
        "stribeck",
        Factor.STRENGTH,
        "γ = 1 + (Δτ/τc)·exp(−(ω/v_s)²)",
        "friction in slow sliding differs from that in fast sliding (Stribeck)",
        "slow sliding, at several speeds around v_s",
        (
            TermParameter("stribeck_torque", "Δτ", "N*m", "Coulomb torque at rest less that in fast sliding", STRIBECK,
                          "coulomb_torque", -MOST_SHARE),
            TermParameter("stribeck_velocity", "v_s", "rad/s", "velocity over which the Stribeck torque fades",
                          STRIBECK_VELOCITY, logarithmic=True),
        ),
    ),
    Term(
        "asymmetry",
        Factor.STRENGTH,
        "γ = 1 + a·sgn ω",
        "friction differs between the two directions",
        "sliding in both directions",
        (TermParameter("coulomb_asymmetry", "a", "1", "share by which the Coulomb torque is greater forwards, and less "
                       "backwards", ASYMMETRY, low=-MOST_SHARE, high=MOST_SHARE),),
    ),
    Term(
        "load",
        Factor.STRENGTH,
        "γ = 1 + (μ/τc)·|τ|",
        "friction grows with the torque at the port",
        "sliding while different torques act at the port",
        (TermParameter("load_friction", "μ", "1", "Coulomb torque per torque at the port", LOAD, "coulomb_torque"),),
    ),
    Term(
        "friction_by_position",
        Factor.STRENGTH,
        "γ = 1 + a·cos(pθ) + b·sin(pθ)",
        "friction changes with the position",
        "sliding over whole turns",
        _wave("friction", "the Coulomb torque", FRICTION_COSINE),
        periodic=True,
    ),
    Term(
        "saturation",
        Factor.GAIN,
        "g = 1/(1 + κ·lag(c)²)",
        "torque is not proportional to the command",
        "large and small commands",
        (TermParameter("gain_saturation", "κ", "1/({command})^2", "how much less the torque gain is at great commands",
                       SATURATION),),
    ),
    Term(
        "ripple",
        Factor.GAIN,
        "g = 1 + a·cos(pθ) + b·sin(pθ)",
        "the torque gain changes with the position",
        "large commands over whole turns",
        _wave("ripple", "the torque gain", RIPPLE_COSINE),
        periodic=True,
    ),
    Term(
        "drag",
        Factor.DAMPING,
        "b = 1 + (D/B)·|ω|",
        "damping torque grows with the square of the velocity",
        "motion at high speed",
        (TermParameter("quadratic_drag", "D", "N*m*s^2/rad^2", "torque per square of the velocity", DRAG,
                       "viscous_damping"),),
    ),
    *(
        Term(
            f"{name}_drift",
            factor,
            f"{symbol} = 1 + d·t + e·t²",
            f"{what} changed during the session",
            "the same motion early and late",
            (
                TermParameter(f"{name}_drift", "d", "1/s", f"share of {what} that it gains in a second, in the middle "
                              "of the session", column),
                TermParameter(f"{name}_drift_rate", "e", "1/s^2", f"half of the change of {name}_drift in a second",
                              column + 1),
            ),
            in_time=True,
        )
        for name, factor, symbol, what, column in (
            ("gain", Factor.GAIN, "g", "the torque gain", GAIN_DRIFT),
            ("damping", Factor.DAMPING, "b", "the viscous damping", DAMPING_DRIFT),
            ("friction", Factor.STRENGTH, "γ", "the Coulomb torque", FRICTION_DRIFT),
        )
    ),
    Term(
        "cogging",
        Factor.TORQUE,
        "τ(θ) = a·cos(pθ) + b·sin(pθ)",
        "a torque acts that depends on the position",
        "slow motion over whole turns",
        (
            TermParameter("cogging_cosine", "a", "N*m", "torque that goes with cos(pθ)"),
            TermParameter("cogging_sine", "b", "N*m", "torque that goes with sin(pθ)"),
        ),
        periodic=True,
    ),
    Term(
        "compliance",
        Factor.JOINT,
        "τ = τ_j − J·ω̇, τ_j = k·(q − θ) + d·(q̇ − ω)",
        "a spring gives between motor and port",
        "fast changes of the torque at the port",
        JOINT_PARAMETERS,
    ),
    Term(
        "backlash",
        Factor.JOINT,
        "τ = τ_j − J·ω̇, τ_j = k·(q − θ ∓ w/2) + d·(q̇ − ω) where |q − θ| > w/2, else 0",
        "there is play between motor and port, and a spring at either end of it",
        "reversals of the torque at the port, and fast changes of it",
        (
            *JOINT_PARAMETERS,
            TermParameter("backlash_width", "w", "rad", "play between the two ends of the joint", BACKLASH_WIDTH,
                          logarithmic=True),
        ),
    ),
)  # fmt: skip
TERM_BY_NAME = {term.name: term for term in TERMS}
TERM_PARAMETERS = {parameter.name: parameter for term in TERMS for parameter in term.parameters}


def _plain(value: float) -> str:
    return f"{value:.4g}"


@dataclass(frozen=True)
class NetworkTerm:
    """A term with its values, in the order and the units of the table; ``periods_per_turn`` is 0 where it has none.

    A network may have several of cogging, whose periods a turn need not be whole, one of each other, and one joint.
    """

    name: str
    values: tuple[float, ...]
    periods_per_turn: float = 0

    @property
    def term(self) -> Term:
        """Its line of the table."""
        return TERM_BY_NAME[self.name]

    def named(self) -> dict[str, float]:
        """Values by the names of the parameters."""
        return {each.name: value for each, value in zip(self.term.parameters, self.values, strict=True)}

    def with_values(self, values: Mapping[str, float]) -> "NetworkTerm":
        """The same with those of ``values``, by the names of parameters; what these do not have stays."""
        return replace(self, values=tuple(values.get(name, value) for name, value in self.named().items()))

    def text(self, command_unit: str, number: Callable[[float], str] = _plain, unit: Callable[[str], str] = str) -> str:
        """Its values with units, and its periods a turn; ``number`` and ``unit`` say how these are written."""
        texts = [
            f"{each.symbol} = {number(value)} {unit(each.unit_for(command_unit))}".removesuffix(" 1")
            for each, value in zip(self.term.parameters, self.values, strict=True)
        ]
        return ", ".join([*texts, *([f"p = {number(self.periods_per_turn)}"] if self.term.periodic else [])])

    def relative_to(self, motor: Mapping[str, float]) -> "NetworkTerm":
        """The same with every value over that of the table's ``over``; ``motor`` has these by name."""
        pairs = zip(self.term.parameters, self.values, strict=True)
        return replace(
            self, values=tuple(_over(value, motor[each.over]) if each.over else value for each, value in pairs)
        )


def parameters_of(terms: Sequence[NetworkTerm]) -> tuple[TermParameter, ...]:
    """All of them, in the order of the terms."""
    return tuple(parameter for each in terms for parameter in each.term.parameters)


def _over(value: float, base: float) -> float:
    """Nothing where the motor lacks what the term is a factor of."""
    return value / base if base else 0.0


def factors_of(terms: Sequence[NetworkTerm]) -> tuple[NetworkTerm, ...]:
    """Those that are factors."""
    return tuple(each for each in terms if each.term.factor is not Factor.TORQUE)


def joint_of(terms: Sequence[NetworkTerm]) -> NetworkTerm | None:
    """What is between motor and port; None where the motor is at the port."""
    return next((each for each in terms if each.term.factor is Factor.JOINT), None)


def joint_values(row: FloatArray, inertia_kgm2: float) -> tuple[float, float, float, float]:
    """k [N m/rad], d [N m s/rad], J [kg m²] and w/2 [rad] of a row of factors; ``inertia_kgm2`` is the motor's."""
    stiffness, damping, output = (float(value) for value in inertia_kgm2 * row[JOINT_STIFFNESS:BACKLASH_WIDTH])
    return stiffness, damping, output, 0.5 * float(row[BACKLASH_WIDTH])


def waves_of(terms: Sequence[NetworkTerm]) -> FloatArray:
    """Those that are torques, shape (waves, 3): periods a turn, and the torques [N m] that go with cosine and sine."""
    waves = [(each.periods_per_turn, *each.values) for each in terms if each.term.factor is Factor.TORQUE]
    return np.array(waves, dtype=float).reshape(-1, 3)


def row_of(terms: Sequence[NetworkTerm]) -> FloatArray:
    """The row that the factors are computed from, shape (COLUMNS,), of terms with relative values."""
    row = np.zeros(COLUMNS)
    row[STRIBECK_VELOCITY] = 1.0
    for each in factors_of(terms):
        for parameter, value in zip(each.term.parameters, each.values, strict=True):
            row[parameter.column] = value
        if each.term.periodic:
            row[PERIODS[each.name]] = each.periods_per_turn
    return row
