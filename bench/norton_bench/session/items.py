"""A session as plain data: its steps, the conditions they depend on, and what is expected of the result."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from operator import ge, gt, le, lt
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from norton_bench.errors import UsageError, nearest
from norton_bench.models.parameter_result import (
    ExpectationResult,
    ParameterResult,
    allowed_deviation,
    check_name,
    parameter_result,
)
from norton_bench.models.parameters import BY_NAME, Status
from norton_bench.procedures.options import STEPS, Options, Texts
from norton_bench.result import Result
from norton_bench.rig.rig import Rig
from norton_bench.session.script import SoFar
from norton_bench.units import parse_quantity, quantity_in

COMPARISONS = {"<=": le, ">=": ge, "<": lt, ">": gt}
COMPARED = re.compile(r"\s*(<=|>=|<|>)?\s*(.+?)\s*")
NOT = "not "


@dataclass(frozen=True)
class Comparison:
    """ "> 2 %": a number on one side of a quantity, which is kept as it was written until its unit is known."""

    sign: str
    quantity: str

    def holds(self, number: float, unit: str) -> bool:
        return bool(COMPARISONS[self.sign](number, parse_quantity(self.quantity, unit)))

    def __str__(self) -> str:
        return f"{self.sign} {self.quantity}"


@dataclass(frozen=True)
class Condition:
    """Everything in it must hold. ``interval`` is half of the 95 % interval over the value; nothing known is endless.

    ``status`` may begin with "not ". ``answer`` names a prompt, whose answer must be ``expected``.
    """

    parameter: str = ""
    value: Comparison | None = None
    interval: Comparison | None = None
    status: str = ""
    answer: str = ""
    expected: str = ""

    def holds(self, so_far: SoFar) -> bool:
        """Takes a fit, seconds, where it asks for a parameter. Raises UsageError for an answer nobody gave."""
        if self.answer:
            return self._answered(so_far)
        return self.holds_of(so_far.parameter(self.parameter))

    def holds_of(self, found: ParameterResult) -> bool:
        """The same, of a parameter at hand."""
        return (
            (self.value is None or self.value.holds(found.value, found.unit))
            and (self.interval is None or self.interval.holds(found.interval, ""))
            and (not self.status or self._has_status(found.status.value))
        )

    def check(self, command_unit: str) -> None:
        """Raises ValueError, in a sentence, where the value is no quantity in the parameter's unit."""
        if self.value is not None:
            parse_quantity(self.value.quantity, BY_NAME[self.parameter].unit_for(command_unit))

    def _answered(self, so_far: SoFar) -> bool:
        if self.answer not in so_far.answers:
            raise UsageError(f'nobody was asked "{self.answer}" yet; put a step do = "ask" with that name before it')
        return so_far.answers[self.answer] == self.expected

    def _has_status(self, status: str) -> bool:
        if self.status.startswith(NOT):
            return status != self.status.removeprefix(NOT)
        return status == self.status

    def __str__(self) -> str:
        if self.answer:
            return f'the answer to "{self.answer}" is "{self.expected}"'
        parts = [
            f"{what} {asked}"
            for what, asked in (("value", self.value), ("interval", self.interval), ("status", self.status))
            if asked
        ]
        return f"{self.parameter}: {' and '.join(parts)}"


def compared(written: object, *, alone: str = "") -> Comparison:
    """``"> 2 %"`` read; ``alone`` is the sign of a quantity without one, none: it must have one.

    Raises ValueError, in a sentence.
    """
    match = COMPARED.fullmatch(written) if isinstance(written, str) else None
    sign = match and (match[1] or alone)
    if match is None or not sign:
        raise ValueError(f'{written!r} compares nothing; write it like "< 2 %", with one of <, <=, >, >=')
    return Comparison(sign, match[2])


def share(written: object) -> Comparison:
    """A share, at most that where there is no sign. Raises ValueError, in a sentence."""
    comparison = compared(written, alone="<=")
    parse_quantity(comparison.quantity, "")
    return comparison


def parameter_name(name: str) -> str:
    """``name``, where there is such a parameter. Raises ValueError, in a sentence."""
    try:
        check_name(name)
    except UsageError as error:
        raise ValueError(str(error)) from None
    return name


def status_name(written: str) -> str:
    """``written``, where it is a status, or "not " and one. Raises ValueError, in a sentence."""
    known = [status.value for status in Status]
    if written.removeprefix(NOT) not in known:
        raise ValueError(f'"{written}" is no status; {nearest(written.removeprefix(NOT), known)}')
    return written


class AskOptions(Options):
    """A prompt: what it is called, what is asked, and the answers allowed (none: any)."""

    name: str = Field(pattern=r"^[\w.-]+$", examples=["fixture"])
    text: str = Field(min_length=1, examples=["Which fixture is mounted?"])
    choices: Annotated[tuple[str, ...], Texts] = Field((), examples=[["A", "B"]])


@dataclass(frozen=True)
class Step:
    """One procedure to run, or a prompt: its name and its options.

    It runs ``when`` that holds. ``label`` tells it from its like, and ``where`` is its place in the file.
    ``modulations`` are those it runs under, one after the other, as quantities in the unit of the rig's modulator.
    """

    do: str
    options: Options
    when: Condition | None = None
    label: str = ""
    where: str = ""
    modulations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Block:
    """Steps that run one after the other ``when`` that holds, and again until ``until`` does, ``at_most`` times."""

    steps: tuple["Step | Block", ...]
    when: Condition | None = None
    until: Condition | None = None
    at_most: int = 1
    where: str = ""


Item = Step | Block


@dataclass(frozen=True)
class Expectation:
    """What is expected of the result: of a parameter, or of the prediction of what no fit has seen.

    ``reference`` and ``within`` go together. ``validation`` is "torque" or "velocity", ``at_most`` its relative error.
    """

    where: str
    condition: Condition | None = None
    reference: str = ""
    within: str = ""
    validation: str = ""
    at_most: float = 0.0


@dataclass(frozen=True)
class WrittenFault:
    """A fault to rehearse: what the simulator reads of it, and the step during which it is to happen, if one."""

    table: Mapping[str, Any]
    during: str | None = None


@dataclass(frozen=True)
class Session:
    """What to do, in order. ``place`` names where it came from; ``rig`` is the rig file, if the session names one.

    ``always`` are the steps that run at the end however it comes. ``parameters`` are those of the file with what was
    set instead. ``arguments`` are those of ``identify`` that made a built-in session what it is. ``faults`` are for a
    simulation.
    """

    steps: tuple[Item, ...]
    place: str
    rig: Path | None = None
    seed: int | None = None
    text: str = ""
    arguments: str = ""
    faults: tuple[WrittenFault, ...] = ()
    always: tuple[Item, ...] = ()
    expectations: tuple[Expectation, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def every_step(self) -> Iterator[Step]:
        """All of them in the order of the file, whatever repeats them; the last ones are those that always run."""
        return flat((*self.steps, *self.always))


def flat(items: Sequence[Item]) -> Iterator[Step]:
    """The steps in ``items``, each as often as it stands there."""
    for item in items:
        if isinstance(item, Step):
            yield item
        else:
            yield from flat(item.steps)


def _quantity_text(written: object) -> str:
    if not isinstance(written, str):
        raise ValueError(f'expected a quantity in quotes such as "0.02 N*m", not {written!r}')  # noqa: TRY004
    return written


Fraction = Annotated[float, quantity_in("")]
ParameterName = Annotated[str, AfterValidator(parameter_name)]
StatusName = Annotated[str, AfterValidator(status_name)]
Compared = Annotated[Comparison, BeforeValidator(compared)]
Share = Annotated[Comparison, BeforeValidator(share)]


class StepModel(BaseModel):
    """What may stand in a session file's tables beside the options of the steps: conditions, expectations, what
    repeats.

    Base of what may stand beside a step's own options.
    """

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", arbitrary_types_allowed=True)


ASK = "ask"
GROUP = "group"
MODELS: Mapping[str, type[Options]] = {**STEPS, ASK: AskOptions}


class ConditionModel(StepModel):
    """``{ parameter = ..., value | interval | status = ... }`` or ``{ answer = ..., is = ... }``."""

    parameter: ParameterName = Field("", examples=["coulomb_torque"], validate_default=False)
    value: Compared | None = Field(None, examples=["< 0.03 N*m"])
    interval: Share | None = Field(None, examples=["1 %"])
    status: StatusName = Field("", examples=["valid"], validate_default=False)
    answer: str = Field("", examples=["fixture"])
    expected: str = Field("", alias="is", examples=["A"])

    @model_validator(mode="after")
    def _complete(self) -> "ConditionModel":
        asked = self.value is not None or self.interval is not None or bool(self.status)
        answered = bool(self.answer) and bool(self.expected)
        if (
            bool(self.parameter) == bool(self.answer)
            or (self.parameter and not asked)
            or (self.answer and not answered)
        ):
            raise ValueError(
                'asks for nothing; write { parameter = "coulomb_torque", interval = "1 %" } (or value, or status), '
                'or { answer = "fixture", is = "A" }'
            )
        if (self.answer and asked) or (self.parameter and self.expected):
            raise ValueError("asks for a parameter and for an answer at once; leave one of them out")
        return self

    def condition(self) -> Condition:
        return Condition(self.parameter, self.value, self.interval, self.status, self.answer, self.expected)


class RepeatUntilModel(ConditionModel):
    """The same, with how often at most."""

    at_most: int = Field(ge=1, le=1000, examples=[5])


class ExpectModel(StepModel):
    """One ``[[expect]]``."""

    parameter: ParameterName = Field("", examples=["coulomb_torque"], validate_default=False)
    value: Annotated[str, BeforeValidator(_quantity_text)] = Field("", examples=["0.02 N*m"], validate_default=False)
    within: Annotated[str, BeforeValidator(_quantity_text)] = Field("", examples=["5 %"], validate_default=False)
    interval: Share | None = Field(None, examples=["1 %"])
    status: StatusName = Field("", examples=["valid"], validate_default=False)
    validation: Literal["torque", "velocity", ""] = Field("", examples=["torque"])
    at_most: Fraction | None = Field(None, gt=0, examples=["5 %"])

    @model_validator(mode="after")
    def _complete(self) -> "ExpectModel":
        of_parameter = bool(self.value) or self.interval is not None or bool(self.status)
        if bool(self.parameter) == bool(self.validation) or (self.parameter and not of_parameter):
            raise ValueError(
                'expects nothing; write parameter = "coulomb_torque" with value and within, interval, or status, '
                'or validation = "torque" with at_most'
            )
        if self.validation and (self.at_most is None or of_parameter or self.within):
            raise ValueError('validation = "..." goes with at_most = "5 %", and with nothing else')
        if self.parameter and self.at_most is not None:
            raise ValueError('at_most goes with validation = "torque"; for a parameter write within or interval')
        if self.within and not self.value:
            raise ValueError('within lacks the value it is about; add value = "0.02 N*m"')
        return self

    def expectation(self, where: str) -> Expectation:
        compares = None if self.within or not self.value else compared(self.value)
        condition = Condition(self.parameter, compares, self.interval, self.status)
        if self.validation:
            return Expectation(where, validation=self.validation, at_most=self.at_most or 0.0)
        return Expectation(where, condition, self.value if self.within else "", self.within)


class ControlModel(StepModel):
    """What any step may have beside its own options."""

    when: ConditionModel | None = None
    repeat: int = Field(1, ge=1, le=1000, examples=[3])
    repeat_until: RepeatUntilModel | None = None
    sweep: dict[str, Any] = Field(default_factory=dict, alias="for", examples=[{"speed": ["10 rad/s", "20 rad/s"]}])
    always: bool = Field(default=False, examples=[True])


CONTROL = frozenset(info.alias or name for name, info in ControlModel.model_fields.items())


def judge(expectations: Sequence[Expectation], result: Result, command_unit: str) -> tuple[ExpectationResult, ...]:
    """All of them, in order."""
    return tuple(_judged(expectation, result, command_unit) for expectation in expectations)


def _judged(expectation: Expectation, result: Result, command_unit: str) -> ExpectationResult:
    if expectation.condition is None:
        return _prediction(expectation, result)
    estimates = result.fit.estimates if result.fit is not None else ()
    return _parameter(expectation, parameter_result(estimates, expectation.condition.parameter, command_unit))


def _parameter(expectation: Expectation, found: ParameterResult) -> ExpectationResult:
    """A value within a tolerance, or a condition, or both."""
    condition = expectation.condition
    assert condition is not None
    near = found.is_within(expectation.within, expectation.reference) if expectation.within else None
    holds = condition.holds_of(found)
    asked = str(condition).partition(": ")[2]
    said = [] if near is None else [near.sentence]
    if asked:
        said.append(f"{found}: {'as expected' if holds else 'not as expected'}, {asked}")
    return ExpectationResult(found.name, holds and (near is None or near.met), "; ".join(said))


def _prediction(expectation: Expectation, result: Result) -> ExpectationResult:
    what, checked = expectation.validation, result.validation
    error = float("nan")
    if checked is not None:
        error = float(checked.torque_relative if what == "torque" else checked.velocity_relative)
    name, met = f"validation {what}", isfinite(error) and error <= expectation.at_most
    if not isfinite(error):
        return ExpectationResult(
            name, False, f"{what} was not predicted: the session has no step 'validate' that shows it"
        )
    verb = "is" if met else "is not"
    return ExpectationResult(
        name, met, f"{what} predicted to {100 * error:.2g} %: {verb} within {100 * expectation.at_most:g} %"
    )


def check_expectation(expectation: Expectation, rig: Rig, place: str) -> None:
    """Raises UsageError where its quantities are none of the parameter's unit."""
    condition = expectation.condition
    if condition is None:
        return
    unit = BY_NAME[condition.parameter].unit_for(rig.command.unit)
    try:
        condition.check(rig.command.unit)
        if expectation.within:
            allowed_deviation(expectation.within, parse_quantity(expectation.reference, unit), unit)
    except ValueError as error:
        raise UsageError(f"{place}: [{expectation.where}]: {error}") from None
