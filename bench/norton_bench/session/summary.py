"""The last event of a session, from its result or from the error that ended it."""

from collections.abc import Collection
from math import isfinite
from pathlib import Path

from norton_bench.errors import exit_code_of, sentence_of
from norton_bench.events import Ended
from norton_bench.on_demand import deferred
from norton_bench.result import Result

# Of steps that few sessions have.
of_trials = deferred("norton_bench.report.facts_tables:of_trials")
tabulated = deferred("norton_bench.report.facts_tables:tabulated")


def ended(result: Result) -> Ended:
    """The last event of a session that is complete."""
    fit, checked = result.fit, result.validation
    return Ended(
        result.exit_code,
        recording=result.recording,
        report=result.report_file,
        network=result.network_file,
        estimates=fit.estimates if fit else (),
        verdict=fit.verdict if fit else (),
        torque_relative=None if checked is None else _finite(checked.torque_relative),
        velocity_relative=None if checked is None else _finite(checked.velocity_relative),
        expectations=tuple(result.expectations),
        trials=tuple(of_trials(result)) if result.repeated else (),
        tables=tabulated(result) if result.tabulated else (),
        conditions=tuple(map(str, result.conditions)),
    )


def ended_by(error: BaseException, recordings: Collection[Path]) -> Ended:
    """The last event of a session that ``error`` ended; ``recordings`` are those that it has written."""
    return Ended(exit_code_of(error), sentence_of(error), recording=max(recordings, default=None))


def _finite(number: float) -> float | None:
    return float(number) if isfinite(number) else None
