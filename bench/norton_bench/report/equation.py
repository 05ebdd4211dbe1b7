"""The identified model as equations, once in symbols and once with its values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from norton_bench.identification.results import FitResult
from norton_bench.models.derived import Figure, derived
from norton_bench.models.parameters import BY_NAME, Estimate, Status
from norton_bench.report.words import Facts, between, number, pretty_unit

# Of these a value is put into the equation; of all others the symbol stays.
TOLD = (Status.VALID, Status.LEARNING, Status.RATIO_ONLY)
# Enough digits to predict with; the table has them all.
DIGITS = 4


@dataclass(frozen=True)
class Equation:
    """One line of the model: what it says, in symbols, and with the values in it."""

    meaning: str
    symbols: str
    values: str


@dataclass(frozen=True)
class Model:
    """The lines of the model, and what its variables are, as (symbol, meaning)."""

    lines: tuple[Equation, ...]
    variables: tuple[tuple[str, str], ...]
    remark: str = ""


# The torque motor with Dahl friction (paper, section IV.D); {name} stands for a parameter of the table.
_LINES = (
    ("The amplifier follows the command with a lag:", "dτm/dt = {amplifier_bandwidth}·({torque_gain}·c − τm)"),
    (
        "The friction contact deflects, and slides when it is fully deflected:",
        "dφ/dt = ω − ({presliding_stiffness} / {coulomb_torque})·|ω|·φ",
    ),
    (
        "What is left of the motor's torque reaches the output shaft (the impedance):",
        "τ = τm − {inertia}·dω/dt − {viscous_damping}·ω − {presliding_stiffness}·φ − {presliding_damping}·dφ/dt",
    ),
    (
        "With no torque at the shaft it settles at this speed (the motion source), and rests where friction holds it:",
        "ωN = ({torque_gain}·c ∓ {coulomb_torque}) / {viscous_damping}",
    ),
)
_RATIOS = (
    "No measured torque tells the scale: the values are known up to one common factor, and torques here are in the "
    "unit of the command."
)


def model_of(fit: FitResult, command_unit: str) -> Model:
    """The model that ``fit`` found; parameters that it does not tell stay symbols."""
    symbols = {name: parameter.symbol for name, parameter in BY_NAME.items()}
    values = {**symbols, **_values(fit.estimates)}
    lines = tuple(Equation(said, form.format(**symbols), form.format(**values)) for said, form in _LINES)
    torque = "N·m" if not fit.ratios_only else pretty_unit(command_unit) or "N·m"
    variables = (
        ("c", f"command [{pretty_unit(command_unit) or 'N·m'}]"),
        ("τm", f"torque of the motor [{torque}]"),
        ("τ", f"torque that the actuator exerts on its load [{torque}]"),
        ("ω", "velocity of the output shaft [rad/s]"),
        ("φ", "deflection of the friction contact [rad]"),
        ("ωN", "steady free velocity [rad/s]; − for c > 0, + for c < 0, and 0 where Km·Ka·|c| is below τc"),
    )
    return Model(lines, variables, _RATIOS if fit.ratios_only else "")


def _values(estimates: Sequence[Estimate]) -> Mapping[str, str]:
    """Numbers that can stand in a product: a negative one in brackets."""
    told = {each.name: number(each.value, DIGITS) for each in estimates if each.status in TOLD}
    return {name: f"({text})" if text.startswith("−") else text for name, text in told.items()}


HEAD = ("figure", "value", "95 % interval", "unit", "meaning")
# Those that say most of how the actuator feels, and that no operating point belongs to.
SHOWN = ("breakaway_command", "free_speed_per_command", "mechanical_time_constant", "presliding_displacement")


def derived_facts(fit: FitResult) -> Facts | None:
    """A few figures that follow from the network at once; ``norton-bench datasheet`` has them all.

    A row for each figure whose parameters are known; None where there is none.
    """
    statuses = {each.name: each.status for each in fit.estimates}
    figures = {each.row.name: each for each in derived(fit.network, (), statuses=statuses)}
    rows = tuple(_row(figures[name]) for name in SHOWN if name in figures and figures[name].status is Status.VALID)
    return Facts(HEAD, rows) if rows else None


def _row(figure: Figure) -> tuple[str, ...]:
    value, interval = between(figure.value, figure.interval)
    return figure.words, value, interval, pretty_unit(figure.unit), figure.row.meaning
