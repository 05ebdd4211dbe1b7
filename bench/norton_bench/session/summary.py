"""How a session ended, in the form that is told to whoever watches."""

from collections.abc import Collection, Iterator, Sequence
from math import isfinite
from pathlib import Path

from norton_bench.errors import ExitCode
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.table_conditions import two_ports
from norton_bench.identification.trials import TrialFigures, last_driven, settled
from norton_bench.report.facts_tables import line_facts, ports_facts, source_facts
from norton_bench.report.words import Facts
from norton_bench.session.conclusion import Conclusion
from norton_bench.session.failure import exit_code_of, sentence_of
from norton_bench.session.progress import Judged, Summary


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
        trials=tuple(of_trials(found)),
        tables=tabulated(found),
        conditions=tuple(map(str, found.conditions)),
    )


def of_trials(found: Conclusion) -> Iterator[str]:
    """What movements that were repeated came to, in sentences."""
    if found.in_situ is not None and found.in_situ.trials:
        yield in_situ_sentence(found.in_situ)
    if found.trials:
        yield trials_sentence(found.trials)


def tabulated(found: Conclusion) -> tuple[Facts, ...]:
    """What was tabulated, in short: without every single reading."""
    tables = []
    if found.source is not None:
        tables.append(source_facts(found.source, found.units))
    if found.exertion is not None:
        tables.append(line_facts(found.exertion, found.units))
    rows = two_ports(found.source, found.exertion)
    return (*tables, ports_facts(rows, found.units)) if rows else tuple(tables)


def summary_of_failure(error: BaseException, recordings: Collection[Path]) -> Summary:
    """Of one that ``error`` ended; ``recordings`` are those that it left."""
    return Summary(exit_code_of(error), sentence_of(error), recording=max(recordings, default=None))


def in_situ_sentence(found: InSituResult) -> str:
    """The actuator in situ, trial by trial, in words."""
    last = last_driven(found.trials)
    end = "; ".join(found.reasons) or "what is left is what movements differ by anyway"
    return (
        f"In situ, {len(found.trials)} trials: the actuator exerted {1e3 * last.with_noise_nm:.2f} mN·m at last, at "
        f"least {last.below_db(found.trials[0]):.0f} dB below the first; {end}."
    )


def trials_sentence(trials: Sequence[TrialFigures]) -> str:
    """Zero torque under a repeated command, in words."""
    last = trials[-1]
    end = "noise hides what is left" if settled(trials) else "not converged"
    return (
        f"Zero torque, {len(trials)} trials: {1e3 * last.with_noise_nm:.2f} mN·m at the port, at least "
        f"{last.below_db(trials[0]):.0f} dB below the undriven load; {end}."
    )


def exit_code_of_result(found: Conclusion, expected: tuple[Judged, ...] = ()) -> ExitCode:
    """A fit that is no result is a failure, and so is an expectation that was not met; nothing to fit is none."""
    if not all(judged.met for judged in expected):
        return ExitCode.EXPERIMENT_FAILED
    if found.fit is not None and found.fit.shortcoming:
        return ExitCode.EXPERIMENT_FAILED
    return ExitCode.OK


def _finite(number: float) -> float | None:
    return float(number) if isfinite(number) else None
