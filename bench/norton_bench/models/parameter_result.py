"""What a fit says of one parameter, and whether that is what is expected of it."""

from dataclasses import dataclass
from math import inf, isfinite, nan

from norton_bench.errors import UsageError, nearest
from norton_bench.models.parameters import BY_NAME, HALF_INTERVAL, Estimate, Status
from norton_bench.units import parse_quantity


@dataclass(frozen=True)
class ExpectationResult:
    """Something expected of a result: whether it came true, and the sentence that says so."""

    name: str
    met: bool
    sentence: str


NUMBERS = (Status.VALID, Status.UNEXCITED)


@dataclass(frozen=True)
class ParameterResult:
    """One parameter as far as it is known; ``value`` is NaN and ``interval`` infinite where nothing is.

    ``interval`` is half of the 95 % interval over the value; ``std`` is in ``unit``, as ``value`` is.
    """

    name: str
    unit: str
    value: float = nan
    std: float = inf
    status: Status = Status.UNEXCITED

    @property
    def interval(self) -> float:
        if self.status not in NUMBERS or not isfinite(self.std) or not self.value:
            return inf
        return HALF_INTERVAL * self.std / abs(self.value)

    def __str__(self) -> str:
        if not isfinite(self.value):
            return f"{self.name} is not known ({self.status.value})"
        return f"{self.name} = {self.value:.5g} ± {HALF_INTERVAL * self.std:.2g} {self.unit} ({self.status.value})"

    def is_within(self, tolerance: str, reference: str) -> ExpectationResult:
        """Whether the value is valid, and at most ``tolerance`` ("2 %", "1 mN*m") from ``reference``.

        Raises ValueError, in a sentence, for what is no quantity of the kind.
        """
        expected = parse_quantity(reference, self.unit)
        allowed = allowed_deviation(tolerance, expected, self.unit)
        away = abs(self.value - expected)
        met = self.status is Status.VALID and away <= allowed
        off = f", but {100 * away / abs(expected):.3g} % off" if expected and away > allowed else ""
        return ExpectationResult(
            self.name, met, f"{self}: {'is' if met else 'is not'} within {tolerance} of {reference}{off}"
        )

    def is_known_within(self, interval: str) -> ExpectationResult:
        """Whether it is valid and half of its 95 % interval is at most ``interval`` ("1 %") of the value.

        Raises ValueError, in a sentence, for what is no share.
        """
        met = self.status is Status.VALID and self.interval <= parse_quantity(interval, "")
        width = f"±{100 * self.interval:.2g} %" if isfinite(self.interval) else "without bounds"
        return ExpectationResult(
            self.name, met, f"{self}: its 95 % interval, {width}, {'is' if met else 'is not'} within ±{interval}"
        )


def allowed_deviation(tolerance: str, expected: float, unit: str) -> float:
    """``tolerance`` in ``unit``: a quantity of it, or a share of ``expected``. Raises ValueError, in a sentence."""
    try:
        return parse_quantity(tolerance, "") * abs(expected)
    except ValueError:
        return parse_quantity(tolerance, unit)


def parameter_result(estimates: tuple[Estimate, ...], name: str, command_unit: str) -> ParameterResult:
    """What ``estimates`` say of ``name``. Raises UsageError where there is no such parameter."""
    check_name(name)
    for estimate in estimates:
        if estimate.name == name:
            return ParameterResult(name, estimate.unit, float(estimate.value), float(estimate.std), estimate.status)
    return ParameterResult(name, BY_NAME[name].unit_for(command_unit))


def check_name(name: str) -> None:
    """Raises UsageError where there is no such parameter."""
    if name not in BY_NAME:
        raise UsageError(f'"{name}" is no parameter; {nearest(name, BY_NAME)}')
