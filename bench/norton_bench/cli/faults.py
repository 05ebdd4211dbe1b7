"""``faults``: every fault on every rig, and how it ended."""

import os
from collections.abc import Iterator, Sequence
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Jobs, Json, Quiet, RigFile, Seed
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode, UsageError
from norton_bench.shipped import shipped_folder

if TYPE_CHECKING:
    from norton_bench.faults.campaign import FaultTrial
    from norton_bench.faults.case import Case, CaseResult

# The rigs that are tried where none is named: one for each family of drives.
FAMILIES = (
    "sim-odrive",
    "sim-cia402",
    "sim-vesc",
    "sim-mit",
    "sim-damiao",
    "sim-robstride",
    "sim-cubemars",
    "sim-moteus",
    "sim-odrive-uart",
    "sim-vesc-uart",
    "sim-simplefoc",
    "sim-dynamixel",
    "sim-feetech",
)

Quick = Annotated[bool, Parameter(help="A selection of the faults; takes a minute or two.")]
Only = Annotated[str | None, Parameter(help="Only faults with this text in their name, kind or place.")]


def faults(
    *rig_files: RigFile,
    quick: Quick = False,
    only: Only = None,
    jobs: Jobs = None,
    seed: Seed = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Inject faults on simulated rigs. For each: what detected it, how soon both drives were off, and the true
    motion."""
    from norton_bench.cli.progress import counting  # noqa: PLC0415
    from norton_bench.faults.campaign import run_campaign  # noqa: PLC0415

    output = Output(json, quiet)
    paths = rig_files or [shipped_folder() / "rigs" / f"{name}.toml" for name in FAMILIES]
    trials = [_trial(path, quick, only, losses=not (quick and number)) for number, path in enumerate(paths)]
    count = sum(trial.count for trial in trials)
    if not count:
        raise UsageError(f'--only "{only}": no fault has this text in its name, kind or place; leave it out to see all')
    output.say(f"{count} faults on {', '.join(trial.rig.name for trial in trials)}; each rig is calibrated first")
    with counting(output, count) as done:
        outcomes = run_campaign(trials, jobs or os.cpu_count() or 1, seed, lambda outcome: done(_remark(outcome)))
    output.result(faults_data(outcomes), faults_text(outcomes))
    return ExitCode.EXPERIMENT_FAILED if any(each.verdict.fails for each in outcomes) else ExitCode.OK


def _trial(path: Path, quick: bool, only: str | None, losses: bool) -> "FaultTrial":
    """``losses``: also simulate the loss of the host, which takes wall time."""
    from norton_bench.faults.campaign import (  # noqa: PLC0415
        FaultTrial,
        cases,
        host_losses,
    )
    from norton_bench.rig.load import load_rig  # noqa: PLC0415

    rig = load_rig(path, backend="simulated")

    def chosen(all_cases: Sequence["Case"]) -> list["Case"]:
        return [case for case in all_cases if (case.quick or not quick) and _named(case, only)]

    return FaultTrial(rig, chosen(cases(rig)), chosen(host_losses()) if losses else ())


def _named(case: "Case", only: str | None) -> bool:
    return only is None or any(only.lower() in text.lower() for text in (case.name, case.table["kind"], case.on))


def _remark(outcome: "CaseResult") -> str:
    return f"{outcome.family}: {outcome.fault} ({outcome.on}): {outcome.verdict.value}"


# ---- What is printed -----------------------------------------------------------------------------------------------


def faults_data(outcomes: Sequence["CaseResult"]) -> dict[str, Any]:
    """What ``--json`` prints: ``passed`` is what the exit code says; whether all is safe is another question."""
    from norton_bench.faults.case import Verdict  # noqa: PLC0415

    verdicts = [outcome.verdict for outcome in outcomes]
    tried = [verdict for verdict in verdicts if verdict.tried]
    return {
        "passed": not any(verdict.fails for verdict in verdicts),
        "safe": all(verdict.safe for verdict in tried) if tried else None,
        "no_watchdog": verdicts.count(Verdict.NO_WATCHDOG),
        "skipped": verdicts.count(Verdict.SKIPPED),
        "cases": [
            {
                **vars(outcome),
                "peak": outcome.peak._asdict(),
                "peak_after": outcome.peak_after._asdict(),
                "safe": outcome.verdict.safe if outcome.verdict.tried else None,
                "evidence": outcome.evidence,
            }
            for outcome in outcomes
        ],
    }


def faults_text(outcomes: Sequence["CaseResult"]) -> str:
    """The same for a terminal: a line of figures for each fault; below it what detected it, or why it is no danger.
    Times and peaks count from the fault on."""
    from norton_bench.faults.case import Verdict  # noqa: PLC0415

    lines: list[str] = []
    for (family, rig), group in groupby(outcomes, key=lambda outcome: (outcome.family, outcome.rig)):
        lines += [*_family_lines(family, rig, list(group)), ""]
    safe = sum(outcome.verdict.safe for outcome in outcomes)
    skipped, going_on = (
        sum(outcome.verdict is ends for outcome in outcomes) for ends in (Verdict.SKIPPED, Verdict.NO_WATCHDOG)
    )
    left_out = f", {skipped} skipped" if skipped else ""
    last = f"{safe} of {len(outcomes) - skipped} faults end safely{left_out}."
    if going_on:
        last += f" In {going_on} a drive goes on until its supply is switched off, because it has no watchdog."
    return "\n".join([*lines, last])


def _family_lines(family: str, rig: str, outcomes: Sequence["CaseResult"]) -> Iterator[str]:
    allowed_ms = outcomes[0].allowed_s * 1e3
    period = "its watchdog's period and two ticks"
    if not outcomes[0].watchdogs:
        period = "and longer only while no limit is exceeded: it has no watchdog"
    yield f"{family} ({rig}): a drive may run on for {allowed_ms:g} ms, {period}"
    headings = ("noticed", "off", "torque", "speed")
    yield f"  {'fault':<34}{'on':<15}{'ends':<16}{''.join(f'{heading:>12}' for heading in headings)}  drives"
    for outcome in outcomes:
        figures = (
            _figure(outcome.detected_s, 1e3, "ms"),
            _figure(outcome.off_s, 1e3, "ms"),
            _figure(outcome.peak.torque_nm, 1.0, "N*m"),
            _figure(outcome.peak.velocity_rad_s, 1.0, "rad/s"),
        )
        columns = "".join(f"{figure:>12}" for figure in figures)
        drives = ", ".join(dict.fromkeys(outcome.drives.values()))
        yield f"  {outcome.fault:<34}{outcome.on:<15}{outcome.verdict.value:<16}{columns}  {drives}"
        yield f"      {outcome.guard or (outcome.evidence if outcome.verdict.safe else 'not detected')}"


def _figure(value: float | None, scale: float, unit: str) -> str:
    if value is None or not isfinite(value):
        return "–"
    scaled = value * scale
    return f"{scaled:.0f} {unit}" if abs(scaled) >= 10 else f"{scaled:.2g} {unit}"
