"""``identify`` and ``run``: an experiment from its files to its result."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Backend, Json, Out, Quiet, RigFile, Seed, run_folder
from norton_bench.cli.output import Output, complain
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from norton_bench.cli.operator import CommandLineOperator
    from norton_bench.events import SessionEvent, Watcher
    from norton_bench.result import Result
    from norton_bench.rig.rig import Rig
    from norton_bench.session.schema import Session

SessionFile = Annotated[Path, Parameter(name="SESSION", help="A session file.")]
AT_MOST = "10 min"
Until = Annotated[
    str | None,
    Parameter(help='Choose excitations until every 95 % interval is within ± this share of its value: "1%".'),
]
AtMost = Annotated[str | None, Parameter(help=f'Limit of the bench time of --until; default "{AT_MOST}".')]
OtherRig = Annotated[Path | None, Parameter(name="--rig", help="A rig file; replaces that of the session.")]
DryRun = Annotated[bool, Parameter(help="Check every step and limit, and print the plan. Opens nothing.")]
Live = Annotated[
    bool,
    Parameter(
        negative="--no-live", show_default=False, help="Identify while it runs, which doubles the time of a simulation."
    ),
]
JUnit = Annotated[Path | None, Parameter(name="--junit", help="Also write a JUnit report to this file.")]
SetValue = Annotated[
    list[str] | None, Parameter(name="--set", help="Set a parameter of the session: --set speed=40. May be repeated.")
]
Answer = Annotated[
    list[str] | None, Parameter(name="--answer", help="The answer to a prompt: --answer fixture=A. May be repeated.")
]
Yes = Annotated[bool, Parameter(help='Answer every other prompt with its first choice, or "yes".')]
Resume = Annotated[
    Path | None,
    Parameter(help="Resume after the last finished step of this recording, or of the newest in this folder."),
]


NUMBER = re.compile(r"\d*\.?\d+(?:[eE][+-]?\d+)?")
PERCENT = re.compile(rf"\s*({NUMBER.pattern})\s*%\s*")


@dataclass(frozen=True)
class RunOptions:
    """The options of a run, beside its rig and its session."""

    out: Path | None = None
    seed: int | None = None
    junit: Path | None = None
    resume: Path | None = None
    answers: dict[str, str] = field(default_factory=dict)
    yes: bool = False
    live: bool = True


def identify(
    rig_file: RigFile,
    /,
    *,
    until: Until = None,
    at_most: AtMost = None,
    backend: Backend = None,
    seed: Seed = None,
    out: Out = None,
    junit: JUnit = None,
    live: Live = True,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Identify the actuator of a rig: tare, calibrate, free, blocked, imposed, validate, as far as the rig allows."""
    from norton_bench.rig.load import load_rig  # noqa: PLC0415
    from norton_bench.session.schema import refining_session, standard_session  # noqa: PLC0415

    if until is None and at_most is not None:
        raise UsageError("--at-most bounds the bench time of --until; add --until 1%, or leave it out")
    asked, at_most_s = _fraction(until), _quantity("--at-most", at_most or AT_MOST, "s")
    rig = load_rig(rig_file, backend=backend)
    session = standard_session(rig) if asked is None else refining_session(rig, asked, at_most_s)
    output = Output(json, quiet)
    if dry_run:
        return show_plan(rig, session, RunOptions(seed=seed), output)
    return perform(rig, session, RunOptions(out, seed, junit, live=live), output)


def run(
    session_file: SessionFile,
    /,
    *,
    rig_file: OtherRig = None,
    set_value: SetValue = None,
    answer: Answer = None,
    yes: Yes = False,
    resume: Resume = None,
    backend: Backend = None,
    seed: Seed = None,
    out: Out = None,
    junit: JUnit = None,
    live: Live = True,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Run the steps of a session file on its rig."""
    from norton_bench.rig.load import load_rig  # noqa: PLC0415
    from norton_bench.session import operator, unroll  # noqa: PLC0415
    from norton_bench.session.schema import load_session  # noqa: PLC0415

    session = load_session(session_file, unroll.parsed(set_value or ()))
    place = rig_file or session.rig
    if place is None:
        raise UsageError(f'{session_file}: has no rig; add rig = "../rigs/my-rig.toml", or give --rig')
    rig, output = load_rig(place, backend=backend), Output(json, quiet)
    seed = session.seed if seed is None else seed
    options = RunOptions(out, seed, junit, resume, operator.parsed(answer or ()), yes, live)
    return (show_plan if dry_run else perform)(rig, session, options, output)


def show_plan(rig: "Rig", session: "Session", options: RunOptions, output: Output) -> int:
    """Check the session, and print its plan."""
    from norton_bench.check.check import refuse_overfull  # noqa: PLC0415
    from norton_bench.cli.plan import plan_data, plan_view  # noqa: PLC0415
    from norton_bench.session import dry_run  # noqa: PLC0415
    from norton_bench.session.operator import Answers  # noqa: PLC0415

    plan = dry_run.dry_run(session, rig, seed=options.seed)
    refuse_overfull(rig, options.seed)
    Answers(options.answers, options.yes).check(plan.prompts, session.place, somebody=True)
    output.result(plan_data(plan, session, rig), plan_view(plan, session, rig))
    return ExitCode.OK


def _fraction(until: str | None) -> float | None:
    if until is None:
        return None
    percent = PERCENT.fullmatch(until)
    if percent is None or not 0 < float(percent[1]) < 100:
        bare = NUMBER.fullmatch(until.strip())
        mend = f"--until {bare[0]}%" if bare and 0 < float(bare[0]) < 100 else "--until 1%"
        if bare and 0 < float(bare[0]) < 1:
            mend += f" or --until {100 * float(bare[0]):g}%, whichever is meant"
        raise UsageError(
            f"--until {until}: is a percentage of each value, greater than 0 % and less than 100 %; write {mend}"
        )
    return float(percent[1]) / 100


def _quantity(option: str, text: str, unit: str) -> float:
    from norton_bench.units import parse_quantity  # noqa: PLC0415

    try:
        return parse_quantity(text, unit)
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from None


def perform(rig: "Rig", session: "Session", options: RunOptions, output: Output) -> int:
    """Run ``session`` and print its result; returns the exit code."""
    from norton_bench.check.check import refuse_impossible  # noqa: PLC0415

    refuse_impossible(rig, options.seed)
    folder = run_folder(options.out, rig.name)
    before = set(folder.iterdir())
    try:
        result = _run(rig, session, folder, options, output)
    except BaseException:  # name the recordings, also after a failure
        _name_recordings(folder, before, output)
        raise
    return _show(result, output)


def _run(rig: "Rig", session: "Session", folder: Path, options: RunOptions, output: Output) -> "Result":
    from norton_bench.cli.operator import operator_here  # noqa: PLC0415
    from norton_bench.session.engine import run_session  # noqa: PLC0415
    from norton_bench.session.operator import Answers  # noqa: PLC0415

    with operator_here() as operator, _watching(rig, session, options, operator, output) as on_event:
        return run_session(
            rig,
            session,
            out=folder,
            seed=options.seed,
            on_event=on_event,
            operator=operator,
            answers=Answers(options.answers, options.yes),
            resume=options.resume,
            live=options.live,
        )


@contextmanager
def _watching(
    rig: "Rig", session: "Session", options: RunOptions, operator: "CommandLineOperator", output: Output
) -> Iterator["Watcher"]:
    """The watchers of the session: the progress display, the operator, and the JUnit report."""
    from norton_bench.cli.progress import showing_progress  # noqa: PLC0415

    with showing_progress(output, rig.tick_s) as shown:
        watchers: list[Watcher] = [shown, operator.watch]
        if options.junit is not None:
            from norton_bench.session.junit import JUnitReport  # noqa: PLC0415

            about = {"rig": rig.place, "session": session.place, "seed": str(options.seed or "")}
            junit = JUnitReport(options.junit, f"norton-bench.{rig.name}", about)
            junit.prepare()
            watchers.append(junit)

        def to_all(event: "SessionEvent") -> None:
            for watcher in watchers:
                watcher(event)

        yield to_all


def _name_recordings(folder: Path, before: set[Path], output: Output) -> None:
    for recording in sorted(set(folder.glob("*.mcap")) - before):
        output.say(f"the measurements are in {recording}")
    if not any(folder.iterdir()):
        folder.rmdir()


def _show(result: "Result", output: Output) -> int:
    from norton_bench.cli.results import events, expectation_figures, expected, identification, summary  # noqa: PLC0415

    assert result.measured is not None
    assert result.knowledge is not None
    data: dict[str, Any] = {**identification(result), "events": events(result.measured)}
    view = [summary(result)]
    refined = result.knowledge.refinement
    if refined is not None and result.fit is not None:
        from norton_bench.cli.tables import until_figures, until_sentences  # noqa: PLC0415

        until = until_figures(refined, result.fit, len(result.measured.ticks) * result.knowledge.tick_s)
        data["until"] = until
        view.append(until_sentences(until))
    if result.expectations:
        data["expectations"] = [expectation_figures(each) for each in result.expectations]
        view += expected(result.expectations)
    output.result(data, *view)
    if result.shortcoming:
        complain(result.shortcoming)
    return result.exit_code
