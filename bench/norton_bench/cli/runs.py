"""``runs``: the catalogue of past runs."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import RUNS, Json
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import UsageError
from norton_bench.models.parameters import HALF_INTERVAL

if TYPE_CHECKING:
    from rich.table import Table

    from norton_bench.models.parameters import Estimate
    from norton_bench.session.catalogue import Comparison, Difference, Run, Trend

Folder = Annotated[Path, Parameter(name="FOLDER", help="The folder of your runs.")]
OfRig = Annotated[str | None, Parameter(name="--rig", help="Only runs of the rig of this name.")]
Compare = Annotated[tuple[Path, Path] | None, Parameter(help="Compare two runs, given by their folders or recordings.")]
Over = Annotated[str | None, Parameter(name="--trend", help="Show a parameter, such as coulomb_torque, over all runs.")]


def runs(
    folder: Folder = RUNS,
    /,
    *,
    rig: OfRig = None,
    compare: Compare = None,
    trend: Over = None,
    json: Json = False,
) -> None:
    """List past runs with date, rig and result; or compare two; or follow a parameter over time."""
    from norton_bench.session import catalogue  # noqa: PLC0415

    output = Output(json)
    if compare is not None:
        first, second = (catalogue.run_of(place) for place in compare)
        found = catalogue.compare(first, second)
        output.result(_comparison(found), *_compared(first, second, found))
        return
    found_runs = [run for run in catalogue.runs_in(folder) if rig is None or run.rig == rig]
    if trend is not None:
        known = sorted({name for run in found_runs for name in run.estimates})
        if trend not in known:
            there = f"there are: {', '.join(known)}" if known else "no run there has identified any"
            raise UsageError(f"--trend {trend}: no run in {folder} has this parameter; {there}")
        of_it = [run for run in found_runs if trend in run.estimates]
        line = catalogue.trend_of(trend, of_it)
        output.result(
            _trend_data(trend, of_it, line), _values(trend, of_it), _trend_words(line, of_it[0].estimates[trend])
        )
        return
    output.result(
        [_run(run) for run in found_runs], _listed(found_runs) if found_runs else f"{folder}: holds no recording"
    )


def _run(run: "Run") -> dict[str, Any]:
    """A run as ``--json`` prints it."""
    estimates = {name: _value(each) for name, each in run.estimates.items()}
    return {**asdict(run), "started": _iso(run), "estimates": estimates}


def _iso(run: "Run") -> str | None:
    return None if run.started is None else run.started.isoformat()


def _listed(runs: Sequence["Run"]) -> "Table":
    table = plain_table()
    for heading in ("started", "rig", "session", "result", "recording"):
        table.add_column(heading, overflow="fold")
    for run in runs:
        table.add_row(_when(run), run.rig, run.session, run.ending, str(run.recording))
    return table


def _when(run: "Run") -> str:
    return "?" if run.started is None else f"{run.started.astimezone():%Y-%m-%d %H:%M}"


def _comparison(found: "Comparison") -> list[dict[str, Any]]:
    """What is in different units has no difference."""
    left_out = [
        {
            "parameter": first.name,
            "unit": first.unit,
            "second_unit": second.unit,
            "first": first.value,
            "second": second.value,
            **dict.fromkeys(("difference", "std", "differs")),
        }
        for first, second in found.left_out
    ]
    return [*map(_difference, found.differences), *left_out]


def _difference(difference: "Difference") -> dict[str, Any]:
    return {
        "parameter": difference.first.name,
        "unit": difference.first.unit,
        "first": difference.first.value,
        "second": difference.second.value,
        "difference": difference.value,
        "std": difference.std,
        "differs": difference.shows,
    }


def _compared(first: "Run", second: "Run", found: "Comparison") -> tuple["Table", str]:
    from norton_bench.cli.results import with_digits  # noqa: PLC0415

    table = plain_table()
    for heading in ("parameter", "first", "second", "difference", "± 95 %", "unit", ""):
        table.add_column(heading, justify="left" if heading in ("parameter", "unit", "") else "right")
    for each in found.differences:
        change, half = with_digits(each.value, HALF_INTERVAL * each.std)
        values = (with_digits(estimate.value, estimate.std)[0] for estimate in (each.first, each.second))
        table.add_row(each.first.name, *values, change, half, each.first.unit, "differs" if each.shows else "")
    words = (
        f"First: {first.recording}, {_when(first)}. Second: {second.recording}, {_when(second)}. "
        f'"differs": at 95 %, corrected for {len(found.differences)} parameters.'
    )
    if found.left_out:
        names = ", ".join(f"{one.name} ({one.unit}, {other.unit})" for one, other in found.left_out)
        words += f" Left out, because the units differ: {names}."
    return table, words


def _trend_data(name: str, runs: Sequence["Run"], line: "Trend") -> dict[str, Any]:
    values = [{"recording": run.recording, "started": _iso(run), **_value(run.estimates[name])} for run in runs]
    return {
        "parameter": name,
        "runs": values,
        "mean": line.combined.value,
        "mean_std": line.combined.std,
        "between_std": line.combined.between_std,
        "p": line.combined.p,
        "slope_per_month": line.slope_per_month,
        "slope_per_month_std": line.slope_std,
    }


def _value(estimate: "Estimate") -> dict[str, Any]:
    return {"value": estimate.value, "std": estimate.std, "unit": estimate.unit, "status": estimate.status.value}


def _values(name: str, runs: Sequence["Run"]) -> "Table":
    from norton_bench.cli.results import with_digits  # noqa: PLC0415

    table = plain_table()
    for heading in ("started", "rig", name, "± 95 %", "unit", "status", "recording"):
        table.add_column(heading, justify="right" if heading in (name, "± 95 %") else "left", overflow="fold")
    for run in runs:
        each = run.estimates[name]
        value, half = with_digits(each.value, HALF_INTERVAL * each.std)
        table.add_row(_when(run), run.rig, value, half, each.unit, each.status.value, str(run.recording))
    return table


def _trend_words(line: "Trend", estimate: "Estimate") -> str:
    from norton_bench.cli.results import with_digits  # noqa: PLC0415

    unit, both = estimate.unit, line.combined
    mean, half = with_digits(both.value, HALF_INTERVAL * both.std)
    words = f"Mean {mean} ± {half} {unit} (95 %). "
    if both.p < 0.05:
        words += f"Runs differ by more than their own errors (p = {both.p:.2g}): by {both.between_std:.2g} {unit} rms. "
    else:
        words += f"Runs differ by no more than their own errors (p = {both.p:.2g}). "
    if line.slope_per_month is None or line.slope_std is None:
        return words + "All were made at the same time: no trend."
    slope, half = with_digits(line.slope_per_month, HALF_INTERVAL * line.slope_std)
    shows = "a trend" if abs(line.slope_per_month) > HALF_INTERVAL * line.slope_std else "no significant trend"
    return words + f"In 30 days {slope} ± {half} {unit} (95 %): {shows}."
