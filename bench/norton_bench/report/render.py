"""The report: one HTML file that needs no other; the same data give the same bytes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from norton_bench.errors import ExperimentError
from norton_bench.identification.results import FitResult
from norton_bench.models.derived import Figure, derived
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME, Estimate, Status
from norton_bench.models.terms import Factor, NetworkTerm
from norton_bench.report.sections import sections
from norton_bench.report.streams import stream_qualities
from norton_bench.report.svg import style
from norton_bench.report.words import (
    TERMS,
    Facts,
    between,
    interval,
    number,
    parameter_named,
    percent,
    pretty_unit,
    symbol,
    to_its_digits,
    within,
)
from norton_bench.result import Result
from norton_drivers.servo import Servo

# With these statuses the value is shown in the equation, with all others the symbol.
SHOWN_AS_NUMBER = (Status.VALID, Status.LEARNING, Status.RATIO_ONLY)
# Enough digits for predictions; the table has all.
DIGITS = 4


@dataclass(frozen=True)
class EquationLine:
    """One line of the model: its meaning, in symbols, and with values."""

    meaning: str
    symbols: str
    values: str


@dataclass(frozen=True)
class ModelEquations:
    """The lines of the model, and its variables as (symbol, meaning)."""

    lines: tuple[EquationLine, ...]
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
# With a servo's loop: what it leaves of the command, and where the source is.
_ASKED = {True: "(c − θ − T·ω)", False: "(c − ω)"}
_SERVO_SOURCES = {
    True: (
        "With no torque at the shaft it goes to its goal, as near as friction lets it:",
        "θN = c ± {coulomb_torque} / {torque_gain}",
    ),
    False: (_LINES[-1][0], "ωN = ({torque_gain}·c ∓ {coulomb_torque}) / ({viscous_damping} + {torque_gain})"),
}
_RATIOS = (
    "Without a measured torque the scale is unknown: the values are known up to one common factor, and torques are "
    "in the unit of the command."
)


def model_of(fit: FitResult, command_unit: str) -> ModelEquations:
    """The model of ``fit``; parameters without a value remain symbols."""
    symbols = {name: parameter.symbol for name, parameter in BY_NAME.items()}
    values = {**symbols, **_values(fit.estimates)}
    lines = (
        *(EquationLine(said, form.format(**symbols), form.format(**values)) for said, form in _lines_of(fit.network)),
        *(_term_line(term, command_unit) for term in fit.network.terms),
    )
    torque = "N·m" if not fit.ratios_only else pretty_unit(command_unit) or "N·m"
    variables = (
        ("c", f"command [{pretty_unit(command_unit) or 'N·m'}]"),
        ("τm", f"torque of the motor [{torque}]"),
        ("τ", f"torque that the actuator exerts on its load [{torque}]"),
        ("ω", "velocity of the output shaft [rad/s]"),
        ("φ", "deflection of the friction contact [rad]"),
        *_variables_of(fit.network.servo),
    )
    more = tuple(each for each in _variables_of_terms(fit.network.terms) if each[0] not in dict(variables))
    remarks = (_RATIOS if fit.ratios_only else "", _amplitudes(fit))
    return ModelEquations(lines, variables + more, " ".join(filter(None, remarks)))


def _lines_of(network: NortonNetwork) -> tuple[tuple[str, str], ...]:
    servo = network.servo
    if servo is None:
        return _LINES
    (amplifier, lag), *others, _ = _LINES
    asked = lag.replace("·c ", f"·{_ASKED[servo.holds_position]} ")
    return (
        (amplifier.replace("command", "error that the drive's own loop sees"), asked),
        *others,
        _SERVO_SOURCES[servo.holds_position],
    )


def _variables_of(servo: Servo | None) -> tuple[tuple[str, str], ...]:
    late = "" if servo is None else f"; the loop has it {1e3 * (servo.delay_s + 0.5 * servo.window_s):.3g} ms later"
    if servo is not None and servo.holds_position:
        return (
            ("θ", f"angle of the output shaft [rad]{late}"),
            ("T", f"damping of the loop over its stiffness, as set: {1e3 * servo.of_velocity:.4g} ms"),
            ("θN", "free angle at rest [rad]"),
        )
    return (("ωN", f"steady free velocity [rad/s]; − for c > 0, + for c < 0, and 0 where Km·Ka·|c| is below τc{late}"),)


# How it is written in the equations of terms, and what it is.
_OF_TERMS = (
    ("θ", "θ", "angle of the output shaft [rad]"),
    ("pθ", "p", "periods in a turn of the output shaft"),
    ("lag(c)", "lag(c)", "command behind the amplifier's lag, in the unit of the command"),
    ("·t", "t", "time from the middle of the session [s]"),
    ("q", "q", "angle of the motor, in front of the joint [rad]"),
    ("τ_j", "τ_j", "torque of the joint [N·m]"),
)


def _variables_of_terms(terms: Sequence[NetworkTerm]) -> Iterator[tuple[str, str]]:
    written = " ".join(each.term.equation for each in terms)
    return ((symbol, meaning) for sign, symbol, meaning in _OF_TERMS if sign in written)


def _amplitudes(fit: FitResult) -> str:
    """Of the waves of cogging, whose cosine and sine stand in the equation: empty where there are none."""
    if not fit.cogging:
        return ""
    unit = "of the command's unit" if fit.ratios_only else "mN·m"
    scale = 1.0 if fit.ratios_only else 1e3
    sizes = (within(scale * each.amplitude_nm, scale * each.half_interval_nm) for each in fit.cogging)
    waves = [
        f"{size} {unit} at {each.periods_per_turn:g} periods a turn"
        for size, each in zip(sizes, fit.cogging, strict=True)
    ]
    return f"Amplitude √(a² + b²) of the torque by position: {', '.join(waves)}."


# What the equation of a term is for.
_USES = {
    Factor.GAIN: "Km·Ka is multiplied by g",
    Factor.DAMPING: "B is multiplied by b",
    Factor.STRENGTH: "in dφ/dt, τc is multiplied by γ",
    Factor.TORQUE: "τ(θ) is added to τ",
    Factor.JOINT: "all else is the motor's, at its own angle q, and gives τ_j",
}


def _term_line(each: NetworkTerm, command_unit: str) -> EquationLine:
    """What a term changes, its equation, and its values."""
    meaning = f"Beside the motor of the paper, because {each.term.meaning}: {_USES[each.term.factor]}."
    return EquationLine(meaning, each.term.equation, each.text(command_unit, number, pretty_unit))


def _values(estimates: Sequence[Estimate]) -> Mapping[str, str]:
    """Numbers that can stand in a product: a negative one in brackets."""
    values = {each.name: number(each.value, DIGITS) for each in estimates if each.status in SHOWN_AS_NUMBER}
    return {name: f"({text})" if text.startswith("−") else text for name, text in values.items()}


HEAD = ("figure", "value", "95 % interval", "unit", "meaning")
# The most useful ones that need no operating point.
SHOWN = ("breakaway_command", "free_speed_per_command", "mechanical_time_constant", "presliding_displacement")


def derived_facts(fit: FitResult) -> Facts | None:
    """A few figures computed from the network; ``norton-bench datasheet`` has all.

    A row for each figure whose parameters are known; None where there is none, and for a servo: they are a motor's.
    """
    if fit.network.servo is not None:
        return None
    statuses = {each.name: each.status for each in fit.estimates}
    figures = {each.row.name: each for each in derived(fit.network, (), statuses=statuses)}
    rows = tuple(
        _derived_row(figures[name]) for name in SHOWN if name in figures and figures[name].status is Status.VALID
    )
    return Facts(HEAD, rows) if rows else None


def _derived_row(figure: Figure) -> tuple[str, ...]:
    value, interval = between(figure.value, figure.interval)
    return figure.words, value, interval, pretty_unit(figure.unit), figure.row.meaning


__all__ = ["Result", "render", "write_report"]


@dataclass(frozen=True)
class ParameterRow:
    """A row of the headline table."""

    symbol: str
    meaning: str
    value: str
    interval: str
    unit: str
    status: str
    settled: bool


@dataclass(frozen=True)
class HeadlineNumber:
    """One number at the top of the page."""

    value: str
    meaning: str


def write_report(path: Path, data: Result) -> Path:
    """Write the report on ``data`` to ``path``, which it returns. Raises ExperimentError where it cannot be written."""
    return write_page(path, render(data))


def write_page(path: Path, text: str) -> Path:
    """Raises ExperimentError where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ExperimentError(f"cannot write the report {path}: {error.strerror}; choose another folder") from error
    return path


def render(data: Result) -> str:
    """The page."""
    with style():
        parts = sections(data)
    return fill(
        data=data,
        headline=headline(data),
        rows=[row(estimate) for estimate in data.fit.estimates] if data.fit is not None else [],
        verdict=verdict(data),
        sections=parts,
        commands=how_to_repeat(data),
        model=None if data.fit is None else model_of(data.fit, data.command_unit),
        derived=None if data.fit is None else derived_facts(data.fit),
        terms=TERMS,
    )


def fill(**parts: object) -> str:
    """Fill the template; without a network of one session the page has no model and no glossary."""
    environment = Environment(
        loader=PackageLoader("norton_bench.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    css = Markup(environment.get_template("report.css").render())
    parts = {"model": None, "derived": None, "terms": (), **parts}
    return environment.get_template("report.html.j2").render(css=css, markup=Markup, **parts)


def row(estimate: Estimate) -> ParameterRow:
    """The row of an estimate; without a number where the data do not determine it."""
    known = estimate.status in (Status.VALID, Status.LEARNING)
    shown = estimate.status is not Status.UNEXCITED
    return ParameterRow(
        symbol=symbol(estimate),
        meaning=estimate.name if (parameter := parameter_named(estimate.name)) is None else parameter.meaning,
        value=to_its_digits(estimate.value, estimate.std) if shown else "–",
        interval=interval(estimate.value, estimate.std) if known else "–",
        unit=pretty_unit(estimate.unit),
        status=estimate.status.value,
        settled=estimate.status is Status.VALID,
    )


def headline(data: Result) -> list[HeadlineNumber]:
    """The few numbers at the top of the page."""
    numbers = []
    if data.fit is not None:
        valid = sum(estimate.status is Status.VALID for estimate in data.fit.estimates)
        numbers.append(HeadlineNumber(f"{valid} of {len(data.fit.estimates)}", "parameters valid"))
    if data.validation is not None:
        numbers.append(HeadlineNumber(percent(data.validation.torque_relative), "torque prediction error"))
        numbers.append(HeadlineNumber(percent(data.validation.velocity_relative), "free velocity prediction error"))
    if data.measured is not None:
        lost = sum(quality.lost for quality in stream_qualities(data.measured))
        numbers.append(HeadlineNumber(str(lost), "readings lost"))
    return numbers


def verdict(data: Result) -> list[str]:
    """Sentences about what the data do not determine."""
    if data.fit is None and (data.source is not None or data.exertion is not None):
        return ["No model was fitted: the actuator is described by its tables.", *data.notes]
    if data.fit is None:
        return [
            "Nothing was fitted: nothing was measured from which a network could be identified.",
            *data.notes,
        ]
    sentences = list(data.fit.verdict)
    if data.validation is None:
        sentences.append("The predictions were not tested: no motion was kept apart from the fit.")
    return [*sentences, *data.notes]


def how_to_repeat(data: Result) -> list[tuple[str, str]]:
    """Commands that repeat the work, each with its effect."""
    known = data.metadata
    commands = []
    seed = f" --seed {known['seed']}" if known.get("seed") else ""
    if known.get("session", "").endswith(".toml"):
        commands.append((f"norton-bench run {known['session']}{seed}", "runs the session again"))
    elif known.get("rig_file"):
        arguments = f" {known['arguments']}" if known.get("arguments") else ""
        commands.append((f"norton-bench identify {known['rig_file']}{arguments}{seed}", "runs the experiment again"))
    if known.get("recording"):
        commands.append((f"norton-bench fit {known['recording']}", "fits this recording again"))
        commands.append((f"norton-bench report {known['recording']}", "writes this report again"))
    return commands
