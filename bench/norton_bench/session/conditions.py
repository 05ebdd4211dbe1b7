"""Conditions on what is known by now: all that `when`, `repeat_until` and `[[expect]]` can say."""

import re
from dataclasses import dataclass
from operator import ge, gt, le, lt

from norton_bench.errors import UsageError, nearest
from norton_bench.models.parameter_result import ParameterResult, check_name
from norton_bench.models.parameters import BY_NAME, Status
from norton_bench.session.script import SoFar
from norton_bench.units import parse_quantity

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
