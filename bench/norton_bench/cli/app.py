"""The command line. Commands are named here and imported only when they run, so that ``--help`` is quick."""

import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version

from cyclopts import App, CycloptsError, Parameter, UnusedCliTokensError

from norton_bench.cli.output import complain, report_error, to_stdout
from norton_bench.errors import ExitCode

DEBUG = "--debug"
VERSION_FLAGS = ("--version", "-V")
# With one of these, or with nothing but the name of a group, words are printed and nothing else is done.
WORDS_ALONE = frozenset(("--help", "-h", *VERSION_FLAGS))
EPILOGUE = (
    f"{DEBUG} anywhere shows the traceback of a failure. Exit codes: 0 done, 1 the experiment failed, 2 wrong usage or "
    "file, 3 no connection, 4 a device did not answer, 5 safety stop, 130 interrupted."
)

# What numpy's libraries of linear algebra may be told, before they are loaded, of how many threads to use.
THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

COMMANDS = {
    "demo": ("norton_bench.cli.examples:demo", "Identify a simulated actuator, to see what this program does."),
    "examples": (
        "norton_bench.cli.examples:examples",
        "List or copy the rigs, sessions and scripts shipped with it.",
    ),
    "identify": ("norton_bench.cli.experiment:identify", "Identify the actuator of a rig with the standard session."),
    "run": ("norton_bench.cli.experiment:run", "Run a session file."),
    "jog": ("norton_bench.cli.jog:jog", "Move a bench by hand: nudge it, watch every signal, stop."),
    "ui": ("norton_bench.cli.screen:ui", "Watch and run experiments in the terminal."),
    "fit": (
        "norton_bench.cli.recordings:fit",
        "Fit recordings again, or logs from elsewhere by a map of their columns.",
    ),
    "sweep": (
        "norton_bench.cli.sweep:sweep",
        "Fit one experiment at many seeds, or a fleet of recordings, in parallel.",
    ),
    "report": ("norton_bench.cli.recordings:report", "Write the report of a recording."),
    "datasheet": ("norton_bench.cli.datasheet:datasheet", "Write the data sheet of an actuator, to hand on."),
    "info": ("norton_bench.cli.info:info", "Say what a recording holds, and how well its loop kept time."),
    "recover": ("norton_bench.cli.recordings:recover", "Rescue a recording that was cut off."),
    "runs": ("norton_bench.cli.runs:runs", "List past runs, compare two, follow a parameter over time."),
    "export": ("norton_bench.cli.recordings:export", "Write a recording as Parquet, CSV or MATLAB tables."),
    "faults": ("norton_bench.cli.faults:faults", "Rehearse faults on simulated rigs, and say how each of them ends."),
    "paper": ("norton_bench.cli.paper:paper", "Repeat the paper's claims as experiments, each beside its closed form."),
    "devices": ("norton_bench.cli.check:devices", "List the serial ports and CAN adapters of this machine."),
    "completion": (
        "norton_bench.cli.completion:completion",
        "Print or install what completes commands on the Tab key.",
    ),
}
GROUPS = {
    "rig": (
        "Describe a rig, and look at it.",
        {
            "new": ("norton_bench.cli.new:new", "Write a new rig file from your answers."),
            "check": ("norton_bench.cli.check:check", "Say what is wrong with a rig. Moves nothing without --move."),
        },
    ),
    "network": (
        "Networks in files: look at them, convert them, use them elsewhere.",
        {
            "show": (
                "norton_bench.cli.network:show",
                "Say what a network is, and whether it can be told from its port.",
            ),
            "convert": ("norton_bench.cli.network:convert", "Write the exact equivalent of another type or form."),
            "export": ("norton_bench.cli.network:export", "Write a network for MuJoCo, as C, or as an FMU."),
            "plot": ("norton_bench.cli.network:plot", "Draw the source and the impedance of a network."),
        },
    ),
    "sim": (
        "The simulator.",
        {
            "serve": (
                "norton_bench.cli.simulator:serve",
                "Serve a rig's simulated devices on its own ports, in wall time.",
            ),
            "truth": ("norton_bench.cli.simulator:truth", "Print the true values of a simulated actuator."),
        },
    ),
}


def build_app() -> App:
    """All commands, none of them imported."""
    app = App(
        name="norton-bench",
        help="Find out what an actuator really is: identify its nonlinear Norton equivalent network.",
        help_epilogue=EPILOGUE,
        version=lambda: version("norton-bench"),
        version_flags=VERSION_FLAGS,
        default_parameter=Parameter(negative=()),
        suppress_keyboard_interrupt=False,
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
    )
    _register(app, COMMANDS)
    for name, (help_text, commands) in GROUPS.items():
        group = App(name=name, help=help_text)
        _register(group, commands)
        app.command(group)
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code. Every error becomes sentences on stderr."""
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = DEBUG in tokens
    tokens = [token for token in tokens if token != DEBUG]
    _leave_cores_alone()
    return run_safely(lambda: _run(tokens), debug=debug)


def _run(tokens: list[str]) -> object:
    if all(token in GROUPS for token in tokens) or not WORDS_ALONE.isdisjoint(tokens):
        with to_stdout():
            build_app()(tokens)
        return ExitCode.OK
    return build_app()(tokens)


def _leave_cores_alone() -> None:
    """One thread of linear algebra, unless the user wants it otherwise.

    Matrices are small here, and what waits for its threads spins on the cores that loop and recorder need: twice the
    time for a session, and far more on a machine that is busy.
    """
    for name in THREAD_COUNTS:
        os.environ.setdefault(name, "1")


def run_safely(command: Callable[[], object], *, debug: bool) -> int:
    """The command's own exit code, or that of the error it ended with."""
    try:
        result = command()
        with to_stdout():
            pass  # what still waits leaves here, or its failure would be the interpreter's
    except CycloptsError as error:
        return _usage(error)
    except (Exception, KeyboardInterrupt) as error:
        return report_error(error, debug=debug)
    return int(result) if isinstance(result, int) else ExitCode.OK


def _usage(error: CycloptsError) -> int:
    text = " ".join(str(error).split())
    if isinstance(error, UnusedCliTokensError):
        text = f"{' '.join(error.unused_tokens or ())}: is more than this command takes; leave it out."
    complain(f"{text} See norton-bench --help.")
    return ExitCode.USAGE


def _register(app: App, commands: dict[str, tuple[str, str]]) -> None:
    for name, (path, help_text) in commands.items():
        app.command(path, name=name, help=help_text)
