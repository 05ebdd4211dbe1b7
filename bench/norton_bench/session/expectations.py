"""What a session file expects of its result, judged: each as a sentence that says whether it came true."""

from collections.abc import Sequence
from math import isfinite

from norton_bench.errors import UsageError
from norton_bench.models.parameter_result import ExpectationResult, ParameterResult, allowed_deviation, parameter_result
from norton_bench.models.parameters import BY_NAME
from norton_bench.result import Result
from norton_bench.rig.rig import Rig
from norton_bench.session.items import Expectation
from norton_bench.units import parse_quantity


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
