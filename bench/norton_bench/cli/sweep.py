"""``sweep``: many simulated sessions, or many recordings, fitted in parallel."""

import os
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import RUNS, Jobs, Json, Quiet, numbers_in
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from norton_bench.sweep.task import RecordedTask, SimulatedTask, Spread, TaskResult

RECORDING_SUFFIX = ".mcap"

Source = Annotated[Path, Parameter(name="SOURCE", help="A simulated rig, or recordings (.mcap).")]
Seeds = Annotated[str | None, Parameter(help="Seeds of the simulation, such as 1-20.")]
SessionFile = Annotated[Path | None, Parameter(name="--session", help="A session file; replaces the standard session.")]
Cluster = Annotated[str | None, Parameter(help="Address of a Dask scheduler to use: tcp://host:8786.")]
Folder = Annotated[Path | None, Parameter(name="--out", help="Folder of the results; a sweep in it is continued.")]
Keep = Annotated[bool, Parameter(help="Also keep recording, network and report of each run.")]


def sweep(
    first: Source,
    /,
    *others: Source,
    seeds: Seeds = None,
    session: SessionFile = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    out: Folder = None,
    keep: Keep = False,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Simulate and fit a session with many seeds, or fit many recordings, in parallel. Finished runs are not
    repeated."""
    from norton_bench.cli.progress import counting  # noqa: PLC0415
    from norton_bench.sweep.run import Store, executor_of  # noqa: PLC0415
    from norton_bench.sweep.run import sweep as run_sweep  # noqa: PLC0415
    from norton_bench.sweep.task import summary  # noqa: PLC0415

    sources, output = (first, *others), Output(json, quiet)
    folder = out or RUNS / f"sweep-{first.stem}"
    tasks, about = _tasks(sources, seeds, session, folder if keep else None)
    store = Store.opened(folder, about)
    todo = sum(task.name not in store.done for task in tasks)
    if todo < len(tasks):
        output.say(f"{len(tasks) - todo} of {len(tasks)} are finished already in {folder}")
    with counting(output, todo) as done, executor_of(min(max(todo, 1), jobs or os.cpu_count() or 1), cluster) as pool:
        outcomes = run_sweep(tasks, pool, store, lambda outcome: done(_line(outcome)))
    spreads = summary(outcomes)
    output.result(sweep_data(outcomes, spreads, folder), *sweep_view(outcomes, spreads, folder))
    return ExitCode.OK if all(outcome.converged for outcome in outcomes) else ExitCode.EXPERIMENT_FAILED


def _tasks(
    sources: Sequence[Path], seeds: str | None, session: Path | None, keep: Path | None
) -> "tuple[Sequence[SimulatedTask | RecordedTask], dict[str, str]]":
    """The tasks, and the settings that must not change when a sweep is continued."""
    from norton_bench.sweep.task import RecordedTask  # noqa: PLC0415

    recordings = [path for path in sources if path.suffix.lower() == RECORDING_SUFFIX]
    if not recordings:
        if len(sources) > 1:
            raise UsageError(f"{sources[1]}: a sweep is of one rig, or of recordings ({RECORDING_SUFFIX})")
        return _simulations(sources[0], seeds, session, keep)
    odd = next((path for path in sources if path not in recordings), None)
    if odd is not None:
        raise UsageError(f"{odd}: is not a recording; name either one rig file, or recordings ({RECORDING_SUFFIX})")
    if seeds is not None or session is not None:
        raise UsageError("--seeds and --session are for a simulated rig; leave them out with recordings")
    return [RecordedTask(path.resolve(), keep) for path in sources], {"kind": "recordings"}


def _simulations(
    rig_file: Path, seeds: str | None, session: Path | None, keep: Path | None
) -> "tuple[Sequence[SimulatedTask], dict[str, str]]":
    from norton_bench.rig.load import load_rig  # noqa: PLC0415
    from norton_bench.session.schema import load_session, standard_session  # noqa: PLC0415
    from norton_bench.sweep.task import SimulatedTask  # noqa: PLC0415

    if seeds is None:
        raise UsageError("--seeds is missing: name the seeds to simulate, such as --seeds 1-20")
    rig = load_rig(rig_file, backend="simulated")
    steps = standard_session(rig) if session is None else load_session(session)
    about = {"kind": "simulations", "rig": _digest(rig.text), "session": _digest(f"{steps.text}{steps.steps!r}")}
    return [SimulatedTask(rig, steps, seed, keep) for seed in numbers_in("--seeds", seeds)], about


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def _line(outcome: "TaskResult") -> str:
    if outcome.failure:
        return f"{outcome.name}: {outcome.failure}"
    valid = sum(each.status.value == "valid" for each in outcome.estimates)
    return f"{outcome.name}: {valid} of {len(outcome.estimates)} parameters valid, {outcome.took_s:.0f} s"


def sweep_data(outcomes: "Sequence[TaskResult]", spreads: "Sequence[Spread]", folder: Path) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "parameters": {
            each.name: {key: value for key, value in vars(each).items() if key != "name"} for each in spreads
        },
        "runs": [outcome.as_json() for outcome in outcomes],
        "failed": sum(bool(outcome.failure) for outcome in outcomes),
        "not_converged": sum(not outcome.failure and not outcome.converged for outcome in outcomes),
        "results": folder,
    }


def sweep_view(
    outcomes: "Sequence[TaskResult]", spreads: "Sequence[Spread]", folder: Path
) -> "Iterator[RenderableType]":
    """The same for a terminal: a row for each parameter, errors where the truth is known; then what failed."""

    with_truth = any(each.rms_error == each.rms_error for each in spreads)
    table = plain_table()
    table.add_column("parameter", no_wrap=True)
    headings = ["runs", "median", "spread", "own std"] + (["bias", "rms error", "in 95 %"] if with_truth else [])
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for each in spreads:
        cells = [str(each.runs), f"{each.median:.5g}", f"{each.spread:.2g}", f"{each.std:.2g}"]
        if with_truth:
            cells += [f"{each.bias:+.2g}", f"{each.rms_error:.2g}", f"{each.within:.0%}"]
        table.add_row(each.name, *cells, each.unit)
    yield table
    yield from (f"{outcome.name}: {outcome.failure}" for outcome in outcomes if outcome.failure)
    yield str(folder)
