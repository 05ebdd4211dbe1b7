"""``fit RECORDING RECORDING...``: what several sessions say together, for programs and for people."""

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from norton_bench.cli.output import plain_table
from norton_bench.cli.results import file_table, parameter, parameter_table
from norton_bench.identification.statistics import Combined
from norton_bench.session.several import OneOf, Several


def several_identification(found: Several) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "parameters": {estimate.name: parameter(estimate) for estimate in found.together.estimates},
        "sessions": [_session(one) for one in found.sessions],
        "between_sessions": {name: _spread(spread) for name, spread in found.together.spreads.items()},
        "validation": None,
        "without_model": None,
        "residuals": None,
        "verdict": list(found.together.verdict),
        "converged": found.together.combined,
        "recording": None,
        "network": found.network,
        "report": found.report,
    }


def _session(one: OneOf) -> dict[str, Any]:
    return {
        "recording": one.recording,
        "parameters": {estimate.name: parameter(estimate) for estimate in one.fit.estimates},
        "converged": one.fit.converged,
        "network": one.conclusion.network,
        "report": one.conclusion.report,
    }


def _spread(spread: Combined) -> dict[str, Any]:
    return {
        "within_std": spread.within_std,
        "shared_std": spread.shared_std,
        "between_std": spread.between_std,
        "between_std_upper": spread.between_std_upper,
        "q": spread.q,
        "p": spread.p,
        "sessions": len(spread.weights),
    }


def several_summary(found: Several) -> RenderableType:
    """The same for a terminal."""
    parts: list[RenderableType] = [parameter_table(found.together.estimates)]
    if found.together.combined:
        parts += ["", _spread_table(found)]
    parts += [f"· {remark}" for remark in found.together.verdict]
    parts.append(file_table((("network", found.network), ("report", found.report))))
    return Group(*parts)


def _spread_table(found: Several) -> Table:
    """One row a parameter: deviation of a session's own value, between sessions, the most it may be, chance."""
    table = plain_table()
    table.add_column("spread of", no_wrap=True)
    for heading in ("within", "between", "at most"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("p", justify="right", no_wrap=True)
    for estimate in found.together.estimates:
        spread = found.together.spreads.get(estimate.name)
        if spread is not None:
            stds = (spread.within_std, spread.between_std, spread.between_std_upper)
            table.add_row(estimate.name, *(f"{std:.2g}" for std in stds), estimate.unit, f"{spread.p:.2g}")
    return table
