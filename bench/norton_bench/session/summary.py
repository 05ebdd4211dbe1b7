"""The last event of a session, from its result or from the error that ended it."""

from collections.abc import Collection, Iterator, Sequence
from math import isfinite
from pathlib import Path

from norton_bench.errors import exit_code_of, sentence_of
from norton_bench.events import Ended
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.table_conditions import two_ports
from norton_bench.identification.trials import TrialFigures, last_driven, settled
from norton_bench.report.facts_tables import line_facts, ports_facts, source_facts
from norton_bench.report.words import Facts
from norton_bench.result import Result


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
        trials=tuple(of_trials(result)),
        tables=tabulated(result),
        conditions=tuple(map(str, result.conditions)),
    )


def of_trials(result: Result) -> Iterator[str]:
    """The results of repeated movements, in sentences."""
    if result.in_situ is not None and result.in_situ.trials:
        yield in_situ_sentence(result.in_situ)
    if result.trials:
        yield trials_sentence(result.trials)


def tabulated(result: Result) -> tuple[Facts, ...]:
    """The tables of source and impedance, in short: without single readings."""
    tables = []
    if result.source is not None:
        tables.append(source_facts(result.source, result.units))
    if result.exertion is not None:
        tables.append(line_facts(result.exertion, result.units))
    rows = two_ports(result.source, result.exertion)
    return (*tables, ports_facts(rows, result.units)) if rows else tuple(tables)


def ended_by(error: BaseException, recordings: Collection[Path]) -> Ended:
    """The last event of a session that ``error`` ended; ``recordings`` are those that it has written."""
    return Ended(exit_code_of(error), sentence_of(error), recording=max(recordings, default=None))


def in_situ_sentence(result: InSituResult) -> str:
    """The trials in situ, in one sentence."""
    last = last_driven(result.trials)
    end = "; ".join(result.reasons) or "what is left is no more than the scatter of movements"
    return (
        f"In situ, {len(result.trials)} trials: in the last one the actuator exerted {1e3 * last.with_noise_nm:.2f} "
        f"mN·m, at least {last.below_db(result.trials[0]):.0f} dB below the first; {end}."
    )


def trials_sentence(trials: Sequence[TrialFigures]) -> str:
    """The trials of zero torque under a repeated command, in one sentence."""
    last = trials[-1]
    end = "noise hides what is left" if settled(trials) else "not converged"
    return (
        f"Zero torque, {len(trials)} trials: {1e3 * last.with_noise_nm:.2f} mN·m at the port, at least "
        f"{last.below_db(trials[0]):.0f} dB below the undriven load; {end}."
    )


def _finite(number: float) -> float | None:
    return float(number) if isfinite(number) else None
