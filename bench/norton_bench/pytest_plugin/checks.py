"""Assertions on what a session found. Each raises AssertionError, in a sentence, where it does not come true."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from norton_bench.models.parameter_result import ExpectationResult, ParameterResult
from norton_bench.models.parameters import HALF_INTERVAL
from norton_bench.result import Result
from norton_bench.units import parse_quantity


def _assert(judged: ExpectationResult) -> bool:
    __tracebackhide__ = True
    if not judged.met:
        raise AssertionError(judged.sentence)
    return True


@dataclass(frozen=True)
class Within:
    """A tolerance that waits for its reference."""

    found: ParameterResult
    tolerance: str

    def of(self, reference: str) -> bool:
        """Raises ValueError, in a sentence, where reference or tolerance is no quantity of the parameter's kind."""
        __tracebackhide__ = True
        return _assert(self.found.is_within(self.tolerance, reference))


@dataclass(frozen=True)
class CheckedParameter:
    """A parameter as the session found it: ``value`` and ``std`` in ``unit``, ``interval`` relative."""

    found: ParameterResult

    @property
    def value(self) -> float:
        return self.found.value

    @property
    def std(self) -> float:
        return self.found.std

    @property
    def unit(self) -> str:
        return self.found.unit

    @property
    def status(self) -> str:
        return self.found.status.value

    @property
    def interval(self) -> float:
        return self.found.interval

    def within(self, tolerance: str) -> Within:
        """``.within("2 %").of("0.02 N*m")``, or a tolerance with a unit: the value must be valid, too."""
        return Within(self.found, tolerance)

    def known_within(self, interval: str) -> bool:
        """Half of the 95 % interval is at most this share of the value, which is valid."""
        __tracebackhide__ = True
        return _assert(self.found.is_known_within(interval))

    def covers(self, reference: str) -> bool:
        """The 95 % interval holds ``reference``."""
        __tracebackhide__ = True
        result, expected = self.found, parse_quantity(reference, self.found.unit)
        met = isfinite(result.std) and abs(result.value - expected) <= HALF_INTERVAL * result.std
        message = f"{result}: its 95 % interval {'holds' if met else 'does not hold'} {reference}"
        return _assert(ExpectationResult(result.name, met, message))

    def has_status(self, status: str) -> bool:
        """As it says it: "valid", "ratio only", ..."""
        __tracebackhide__ = True
        return _assert(
            ExpectationResult(self.found.name, self.status == status, f"{self.found}: its status is not {status}")
        )


@dataclass(frozen=True, repr=False)
class SessionOutcome:
    """What came of a session. ``result`` has all of it."""

    result: Result

    def __repr__(self) -> str:
        return f"<what {self.recording} tells>"

    def parameter(self, name: str) -> CheckedParameter:
        """Raises UsageError for a name that no parameter has."""
        return CheckedParameter(self.result.parameter(name))

    @property
    def recording(self) -> Path:
        assert self.result.recording is not None
        return self.result.recording

    @property
    def report(self) -> Path | None:
        return self.result.report_file

    def converged(self) -> bool:
        """The fit is a result: the data do not contradict themselves, and the actuator does what the model has."""
        __tracebackhide__ = True
        fit = self.result.fit
        met = fit is not None and not fit.shortcoming
        message = "nothing was measured to fit" if fit is None else "; ".join(fit.verdict) or "the fit did not converge"
        return _assert(ExpectationResult("fit", met, message))

    def predicts(self, what: str, *, within: str) -> bool:
        """``what`` ("torque" or "velocity") under what no fit has seen, to this share of its rms."""
        __tracebackhide__ = True
        checked = self.result.validation
        error = float("nan") if checked is None else float(getattr(checked, f"{what}_relative"))
        met = isfinite(error) and error <= parse_quantity(within, "")
        return _assert(
            ExpectationResult(what, met, f"{what} is predicted to {100 * error:.2g} %, which is not within {within}")
        )

    def as_expected(self) -> bool:
        """Everything that the session file itself expects (``[[expect]]``) came true."""
        __tracebackhide__ = True
        missed = [judged.sentence for judged in self.result.expectations if not judged.met]
        return _assert(ExpectationResult("expectations", not missed, "; ".join(missed)))
