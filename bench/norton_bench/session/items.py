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
from norton_bench.procedures.options import STEPS, Listed, Options
from norton_bench.result import Result
from norton_bench.rig.rig import Rig
from norton_bench.session.script import SoFar
from norton_bench.units import parse_quantity, quantity_in

COMPARISONS = {"<=": le, ">=": ge, "<": lt, ">": gt}
COMPARED = re.compile(r"\s*(<=|>=|<|>)?\s*(.+?)\s*")
NOT = "not "


@dataclass(frozen=True)
class Comparison:
    """ "> 2 %": compares a number with a quantity, which stays as text until its unit is known."""

    sign: str
    quantity: str

    def holds(self, number: float, unit: str) -> bool:
        return bool(COMPARISONS[self.sign](number, parse_quantity(self.quantity, unit)))

    def __str__(self) -> str:
        return f"{self.sign} {self.quantity}"


@dataclass(frozen=True)
class Condition:
    """All parts must hold. ``interval`` is half of the 95 % interval over the value; infinite while nothing is known.

    ``status`` may begin with "not ". ``answer`` names a prompt, whose answer must be ``expected``.
    """

    parameter: str = ""
    value: Comparison | None = None
    interval: Comparison | None = None
    status: str = ""
    answer: str = ""
    expected: str = ""

    def holds(self, so_far: SoFar) -> bool:
        """Fits the data (seconds) if it names a parameter. Raises UsageError where a prompt has no answer yet."""
        if self.answer:
            return self._answered(so_far)
        return self.holds_of(so_far.parameter(self.parameter))

    def holds_of(self, result: ParameterResult) -> bool:
        """Whether it holds for this parameter."""
        return (
            (self.value is None or self.value.holds(result.value, result.unit))
            and (self.interval is None or self.interval.holds(result.interval, ""))
            and (not self.status or self._has_status(result.status.value))
        )

    def check(self, command_unit: str) -> None:
        """Raises ValueError where the value is not a quantity in the parameter's unit."""
        if self.value is not None:
            parse_quantity(self.value.quantity, BY_NAME[self.parameter].unit_for(command_unit))

    def _answered(self, so_far: SoFar) -> bool:
        if self.answer not in so_far.answers:
            raise UsageError(f'prompt "{self.answer}" has no answer yet; put a step do = "ask" of that name before')
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
    """Parse ``"> 2 %"``. ``alone`` is the operator of a quantity that has none; empty: an operator is required.

    Raises ValueError for anything else.
    """
    match = COMPARED.fullmatch(written) if isinstance(written, str) else None
    sign = match and (match[1] or alone)
    if match is None or not sign:
        raise ValueError(f'{written!r} is no comparison; write it like "< 2 %", with one of <, <=, >, >=')
    return Comparison(sign, match[2])


def share(written: object) -> Comparison:
    """A comparison of a share such as "1 %", which means "<= 1 %". Raises ValueError for anything else."""
    comparison = compared(written, alone="<=")
    parse_quantity(comparison.quantity, "")
    return comparison


def parameter_name(name: str) -> str:
    """``name``. Raises ValueError where no parameter is called so."""
    try:
        check_name(name)
    except UsageError as error:
        raise ValueError(str(error)) from None
    return name


def status_name(written: str) -> str:
    """``written``. Raises ValueError where it is neither a status nor "not " and a status."""
    known = [status.value for status in Status]
    if written.removeprefix(NOT) not in known:
        raise ValueError(f'"{written}" is no status; {nearest(written.removeprefix(NOT), known)}')
    return written


class AskOptions(Options):
    """A prompt: its name, its question, and the answers allowed (empty: any)."""

    name: str = Field(pattern=r"^[\w.-]+$", examples=["fixture"])
    text: str = Field(min_length=1, examples=["Which fixture is mounted?"])
    choices: Annotated[tuple[str, ...], Listed] = Field((), examples=[["A", "B"]])


@dataclass(frozen=True)
class Step:
    """One procedure to run, or a prompt: its name and its options.

    It runs if the condition ``when`` holds. ``label`` distinguishes it from other steps of that name, ``where`` is its
    place in the file. It runs under each of ``modulations``, quantities in the unit of the rig's modulator.
    """

    do: str
    options: Options
    when: Condition | None = None
    label: str = ""
    where: str = ""
    modulations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Block:
    """Steps that run in order if ``when`` holds, and are repeated until ``until`` holds, ``at_most`` times."""

    steps: tuple["Step | Block", ...]
    when: Condition | None = None
    until: Condition | None = None
    at_most: int = 1
    where: str = ""


Item = Step | Block


@dataclass(frozen=True)
class Expectation:
    """What is expected of the result: of a parameter, or of the prediction of data kept apart from the fit.

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
    """A fault to inject: the table that the simulator reads, and the step during which it happens, if it names one."""

    table: Mapping[str, Any]
    during: str | None = None


@dataclass(frozen=True)
class Session:
    """The steps of a session, in order. ``place`` is its file or name; ``rig`` the rig file, if the session names one.

    ``always`` are the steps that run at the end even after a failure. ``parameters`` are those of the file, with the
    values of ``--set``. ``arguments`` are the options of ``identify`` that made this built-in session. ``faults`` are
    for a simulated bench.
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
        """All steps in the order of the file, each once; those that always run come last."""
        return flat((*self.steps, *self.always))


def flat(items: Sequence[Item]) -> Iterator[Step]:
    """All steps in ``items``, without the blocks around them."""
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
    """Base of the tables of a session file beside the options of steps: conditions, expectations, repetitions."""

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
                'is empty; write { parameter = "coulomb_torque", interval = "1 %" } (or value, or status), '
                'or { answer = "fixture", is = "A" }'
            )
        if (self.answer and asked) or (self.parameter and self.expected):
            raise ValueError("names both a parameter and an answer; leave one of them out")
        return self

    def condition(self) -> Condition:
        return Condition(self.parameter, self.value, self.interval, self.status, self.answer, self.expected)


class RepeatUntilModel(ConditionModel):
    """A condition, and the greatest number of repetitions."""

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
                'is empty; write parameter = "coulomb_torque" with value and within, interval, or status, '
                'or validation = "torque" with at_most'
            )
        if self.validation and (self.at_most is None or of_parameter or self.within):
            raise ValueError('validation = "..." goes with at_most = "5 %", and with nothing else')
        if self.parameter and self.at_most is not None:
            raise ValueError('at_most goes with validation = "torque"; for a parameter write within or interval')
        if self.within and not self.value:
            raise ValueError('within needs a value; add value = "0.02 N*m"')
        return self

    def expectation(self, where: str) -> Expectation:
        compares = None if self.within or not self.value else compared(self.value)
        condition = Condition(self.parameter, compares, self.interval, self.status)
        if self.validation:
            return Expectation(where, validation=self.validation, at_most=self.at_most or 0.0)
        return Expectation(where, condition, self.value if self.within else "", self.within)


class ControlModel(StepModel):
    """The keys that every step may have beside its own options."""

    when: ConditionModel | None = None
    repeat: int = Field(1, ge=1, le=1000, examples=[3])
    repeat_until: RepeatUntilModel | None = None
    sweep: dict[str, Any] = Field(default_factory=dict, alias="for", examples=[{"speed": ["10 rad/s", "20 rad/s"]}])
    always: bool = Field(default=False, examples=[True])


CONTROL = frozenset(info.alias or name for name, info in ControlModel.model_fields.items())


def judge(expectations: Sequence[Expectation], result: Result, command_unit: str) -> tuple[ExpectationResult, ...]:
    """The result of each expectation, in order."""
    return tuple(_judged(expectation, result, command_unit) for expectation in expectations)


def _judged(expectation: Expectation, result: Result, command_unit: str) -> ExpectationResult:
    if expectation.condition is None:
        return _prediction(expectation, result)
    estimates = result.fit.estimates if result.fit is not None else ()
    return _parameter(expectation, parameter_result(estimates, expectation.condition.parameter, command_unit))


def _parameter(expectation: Expectation, result: ParameterResult) -> ExpectationResult:
    """A value within a tolerance, or a condition, or both."""
    condition = expectation.condition
    assert condition is not None
    near = result.is_within(expectation.within, expectation.reference) if expectation.within else None
    holds = condition.holds_of(result)
    asked = str(condition).partition(": ")[2]
    sentences = [] if near is None else [near.sentence]
    if asked:
        sentences.append(f"{result}: {'as expected' if holds else 'not as expected'}, {asked}")
    return ExpectationResult(result.name, holds and (near is None or near.met), "; ".join(sentences))


def _prediction(expectation: Expectation, result: Result) -> ExpectationResult:
    what, checked = expectation.validation, result.validation
    error = float("nan")
    if checked is not None:
        error = float(checked.torque_relative if what == "torque" else checked.velocity_relative)
    name, met = f"validation {what}", isfinite(error) and error <= expectation.at_most
    if not isfinite(error):
        return ExpectationResult(
            name, False, f"{what} was not predicted: the session has no step 'validate' that measures it"
        )
    verb = "is" if met else "is not"
    return ExpectationResult(
        name, met, f"{what} predicted to {100 * error:.2g} %: {verb} within {100 * expectation.at_most:g} %"
    )


def check_expectation(expectation: Expectation, rig: Rig, place: str) -> None:
    """Raises UsageError where its quantities are not in a unit of the parameter."""
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
