"""``ui``: the terminal UI. Its libraries are slow to import, so they are imported only when it runs."""

import gc
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from norton_bench.cli.arguments import RUNS, Backend, Seed, run_folder
from norton_bench.errors import UsageError

if TYPE_CHECKING:
    from norton_bench.screen.experiment import Experiment, Opening

Rig = Annotated[Path | None, Parameter(name="RIG", help="A rig file; without one there is a list to choose from.")]
SessionFile = Annotated[
    Path | None, Parameter(name="SESSION", help="A session file; without one there is a list to choose from.")
]
Runs = Annotated[
    Path | None, Parameter(name="--out", help="Folder for the runs, each in a folder of its own; default ./runs.")
]
Replay = Annotated[Path | None, Parameter(name="--replay", help="Play back this recording, without a rig.")]


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
    require_terminal("ui needs a terminal; norton-bench run SESSION needs none")
    from norton_bench.screen.experiment import Opening  # noqa: PLC0415

    runs = out or RUNS
    opening = Opening(
        lambda name: run_folder(None, name, runs), rig_file, session_file, replay, backend, seed, runs=runs
    )
    if replay is not None:
        print(f"reading {replay}", file=sys.stderr)
    show(opening, opening.given())


def require_terminal(otherwise: str) -> None:
    """Raises UsageError with the message ``otherwise`` where stdin or stdout is no terminal."""
    if not (sys.stdin.isatty() and sys.__stderr__ is not None and sys.__stderr__.isatty()):
        raise UsageError(otherwise)


def show(opening: "Opening", first: "Experiment | None") -> None:
    """Show the screen until the user leaves it. Raises UsageError for settings that cannot be used."""
    from norton_bench.screen.app import BenchApp  # noqa: PLC0415
    from norton_bench.screen.screens.keys import KNOWN as KNOWN_KEYS  # noqa: PLC0415
    from norton_bench.screen.settings import (  # noqa: PLC0415
        KNOWN,
        load_settings,
        settings_path,
    )

    app = BenchApp(opening, first, load_settings(settings_path(), KNOWN_KEYS, KNOWN))
    # Exclude existing objects from garbage collection: a full collection takes tenths of a second, without any key.
    gc.collect()
    gc.freeze()
    app.run()
