"""``identify`` and ``run``: an experiment from its files to its result."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from bench.cli.arguments import Backend, Json, Out, Quiet, RigFile, Seed, run_folder
from bench.cli.interrupt import operator_stop
from bench.cli.output import Output
from bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from bench.rig.rig import Rig
    from bench.session.engine import SessionResult
    from bench.session.schema import Session

SessionFile = Annotated[Path, Parameter(name="SESSION", help="A session file.")]
Until = Annotated[
    str | None, Parameter(help='Choose excitations until every 95 % interval is within ± this of its value: "1%".')
]
AtMost = Annotated[str, Parameter(help="Bench time that --until may take in all.")]
OtherRig = Annotated[Path | None, Parameter(name="--rig", help="A rig file, instead of the session's.")]


def identify(
    rig_file: RigFile,
    /,
    *,
    until: Until = None,
    at_most: AtMost = "10 min",
    backend: Backend = None,
    seed: Seed = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Identify the actuator of a rig: tare, calibrate, free, blocked, imposed, validate, as far as the rig allows."""
    from bench.rig.load import load_rig  # noqa: PLC0415
    from bench.session.schema import refining_session, standard_session  # noqa: PLC0415

    asked, at_most_s = _fraction(until), _quantity("--at-most", at_most, "s")
    rig = load_rig(rig_file, backend=backend)
    session = standard_session(rig) if asked is None else refining_session(rig, asked, at_most_s)
    return perform(rig, session, out=out, seed=seed, output=Output(json, quiet))


def run(
    session_file: SessionFile,
    /,
    *,
    rig_file: OtherRig = None,
    backend: Backend = None,
    seed: Seed = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Run the steps of a session file on its rig."""
    from bench.rig.load import load_rig  # noqa: PLC0415
    from bench.session.schema import load_session  # noqa: PLC0415

    session = load_session(session_file)
    place = rig_file or session.rig
    if place is None:
        raise UsageError(f'{session_file}: names no rig; add rig = "../rigs/my-rig.toml", or give --rig')
    rig = load_rig(place, backend=backend)
    return perform(rig, session, out=out, seed=session.seed if seed is None else seed, output=Output(json, quiet))


def _fraction(until: str | None) -> float | None:
    if until is None:
        return None
    asked = _quantity("--until", until, "")
    if not 0 < asked < 1:
        raise UsageError(f"--until {until}: must be between 0 and 100 %; write it like --until 1%")
    return asked


def _quantity(option: str, text: str, unit: str) -> float:
    from bench.units import parse_quantity  # noqa: PLC0415

    try:
        return parse_quantity(text, unit)
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from None


def perform(rig: "Rig", session: "Session", *, out: Path | None, seed: int | None, output: Output) -> int:
    """Run ``session`` and show what came of it; returns the exit code."""
    folder = run_folder(out, rig.name)
    before = set(folder.iterdir())
    output.say("preparing; the very first run compiles for a while")
    try:
        result = _run(rig, session, folder, seed, output)
    except BaseException:  # whatever ended it, the data are worth a word
        _say_what_is_kept(folder, before, output)
        raise
    return _show(result, output)


def _run(rig: "Rig", session: "Session", folder: Path, seed: int | None, output: Output) -> "SessionResult":
    from bench.cli.progress import showing_progress  # noqa: PLC0415
    from bench.session.engine import run_session  # noqa: PLC0415
    from bench.session.operator import Nobody  # noqa: PLC0415

    with operator_stop() as stop_word, showing_progress(output, rig.tick_s) as progress:
        return run_session(rig, session, out=folder, seed=seed, progress=progress, operator=Nobody(stop_word))


def _say_what_is_kept(folder: Path, before: set[Path], output: Output) -> None:
    for recording in sorted(set(folder.glob("*.mcap")) - before):
        output.say(f"what was measured is kept in {recording}")
    if not any(folder.iterdir()):
        folder.rmdir()


def _show(result: "SessionResult", output: Output) -> int:
    from bench.cli.results import events, identification, summary, until_figures, until_sentences  # noqa: PLC0415

    found, refined = result.conclusion, result.knowledge.refinement
    data = {**identification(found, result.recording), "events": events(result.measured)}
    view = summary(found, result.recording)
    if refined is None or found.fit is None:
        output.result(data, view)
    else:
        until = until_figures(refined, found.fit, len(result.measured.ticks) * result.knowledge.tick_s)
        output.result({**data, "until": until}, view, until_sentences(until))
    if found.fit is not None and not found.fit.converged:
        output.say("the fit did not converge: these parameters are no result; see the report for what was not excited")
        return ExitCode.EXPERIMENT_FAILED
    if found.fit is not None and found.fit.doubtful:
        output.say("the data contradict themselves: what is called doubtful is no result; the verdict says why")
        return ExitCode.EXPERIMENT_FAILED
    return ExitCode.OK
