"""How a session ended, in the form that is told to whoever watches."""

from collections.abc import Collection
from math import isfinite
from pathlib import Path

from bench.errors import ExitCode
from bench.session.conclusion import Conclusion
from bench.session.failure import exit_code_of, sentence_of
from bench.session.progress import Judged, Summary


def summary_of(recording: Path, found: Conclusion, expected: tuple[Judged, ...] = ()) -> Summary:
    """Of a session that came to its end."""
    fit, checked = found.fit, found.validation
    return Summary(
        exit_code_of_result(found, expected),
        recording=recording,
        report=found.report,
        network=found.network,
        estimates=fit.estimates if fit else (),
        verdict=fit.verdict if fit else (),
        torque_relative=None if checked is None else _finite(checked.torque_relative),
        velocity_relative=None if checked is None else _finite(checked.velocity_relative),
        expectations=expected,
    )


def summary_of_failure(error: BaseException, recordings: Collection[Path]) -> Summary:
    """Of one that ``error`` ended; ``recordings`` are those that it left."""
    return Summary(exit_code_of(error), sentence_of(error), recording=max(recordings, default=None))


def exit_code_of_result(found: Conclusion, expected: tuple[Judged, ...] = ()) -> ExitCode:
    """A fit that is no result is a failure, and so is an expectation that was not met; nothing to fit is none."""
    if not all(judged.met for judged in expected):
        return ExitCode.EXPERIMENT_FAILED
    if found.fit is not None and (not found.fit.converged or found.fit.doubtful):
        return ExitCode.EXPERIMENT_FAILED
    return ExitCode.OK


def _finite(number: float) -> float | None:
    return float(number) if isfinite(number) else None
