"""``ui``: the terminal UI. What it needs of the terminal is imported here, when it runs, and nowhere else."""

import gc
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from norton_bench.cli.arguments import RUNS, Backend, Seed, run_folder
from norton_bench.errors import UsageError

if TYPE_CHECKING:
    from norton_bench.screen.experiment import Experiment, Opening

Rig = Annotated[Path | None, Parameter(name="RIG", help="A rig file; asked for where none is given.")]
SessionFile = Annotated[Path | None, Parameter(name="SESSION", help="A session file; asked for where none is given.")]
Runs = Annotated[Path | None, Parameter(name="--out", help="Folder in which every run gets its own; ./runs if none.")]
Replay = Annotated[Path | None, Parameter(name="--replay", help="A recording to play back, instead of a rig.")]


def ui(
    rig_file: Rig = None,
    session_file: SessionFile = None,
    /,
    *,
    replay: Replay = None,
    backend: Backend = None,
    seed: Seed = None,
    out: Runs = None,
) -> None:
    """Watch and run experiments in the terminal: live traces, parameters as they converge, stop on the space bar."""
    if replay is not None and (rig_file is not None or session_file is not None):
        raise UsageError("ui --replay plays a recording and needs no rig; leave RIG and SESSION out")
    require_terminal("ui needs a terminal; norton-bench run SESSION does the same without one")
    from norton_bench.screen.experiment import Opening  # noqa: PLC0415

    runs = out or RUNS
    opening = Opening(
        lambda name: run_folder(None, name, runs), rig_file, session_file, replay, backend, seed, runs=runs
    )
    if replay is not None:
        print(f"reading {replay}", file=sys.stderr)
    show(opening, opening.given())


def require_terminal(otherwise: str) -> None:
    """Raises UsageError, saying ``otherwise``, where nobody could look at a screen."""
    if not (sys.stdin.isatty() and sys.__stderr__ is not None and sys.__stderr__.isatty()):
        raise UsageError(otherwise)


def show(opening: "Opening", first: "Experiment | None") -> None:
    """The screen, until somebody leaves it. Raises UsageError for settings that cannot be used."""
    from norton_bench.screen.app import BenchApp  # noqa: PLC0415
    from norton_bench.screen.screens.keys import KNOWN as KNOWN_KEYS  # noqa: PLC0415
    from norton_bench.screen.settings import (  # noqa: PLC0415
        KNOWN,
        load_settings,
        settings_path,
    )

    app = BenchApp(opening, first, load_settings(settings_path(), KNOWN_KEYS, KNOWN))
    # What is there now, stays: going through all of it takes a few tenths of a second, in which no key is heard.
    gc.collect()
    gc.freeze()
    app.run()
