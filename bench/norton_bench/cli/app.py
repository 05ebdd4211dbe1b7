"""The command line. Commands are named here and imported only when they run, so that ``--help`` is quick."""

import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter, UnusedCliTokensError
from cyclopts.completion.detect import ShellDetectionError

from norton_bench.cli.output import Output, complain, report_error, to_stdout
from norton_bench.errors import ExitCode, UsageError

Shell = Annotated[
    Literal["bash", "zsh", "fish"] | None,
    Parameter(name="SHELL", help="Your shell; default: the one that runs this command."),
]
Install = Annotated[
    bool, Parameter(help="Write the script to the folder of the shell, and a line that loads it to its startup file.")
]


def completion(shell: Shell = None, /, *, install: Install = False) -> None:
    """Print the script that completes norton-bench commands in a shell, or install it."""
    from norton_bench.cli.app import build_app  # noqa: PLC0415  (which names this command)

    try:
        app = build_app()
        script = f"{app.install_completion(shell=shell)}\n" if install else app.generate_completion(shell=shell)
    except ShellDetectionError:
        raise UsageError("this shell is not known; name it: norton-bench completion bash (or zsh, or fish)") from None
    except OSError as error:
        raise UsageError(
            f"{error.filename}: cannot be written ({error.strerror}); write the script to a file of your choice: "
            "norton-bench completion bash > FILE"
        ) from error
    Output().result(None, script.rstrip())


DEBUG = "--debug"
VERSION_FLAGS = ("--version", "-V")
# With one of these, or with the name of a group alone, the program only prints text.
WORDS_ALONE = frozenset(("--help", "-h", *VERSION_FLAGS))
EPILOGUE = (
    f"{DEBUG} anywhere shows the traceback of a failure. Exit codes: 0 done, 1 the experiment failed, 2 wrong usage or "
    "file, 3 no connection, 4 a device did not answer, 5 safety stop, 130 interrupted."
)

# The environment variables with the number of threads of numpy's linear algebra; read when the library is loaded.
THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

COMMANDS = {
    "demo": ("norton_bench.cli.examples:demo", "Identify a simulated actuator: a demonstration."),
    "examples": (
        "norton_bench.cli.examples:examples",
        "List or copy the rigs, sessions and scripts that come with this program.",
    ),
    "identify": ("norton_bench.cli.experiment:identify", "Identify the actuator of a rig with the standard session."),
    "run": ("norton_bench.cli.experiment:run", "Run a session file."),
    "jog": ("norton_bench.cli.jog:jog", "Move a bench by hand: nudge it, watch every signal, stop."),
    "joints": ("norton_bench.cli.joints:joints", "Measure an arm of two joints, each on a bench of its own."),
    "ui": ("norton_bench.cli.screen:ui", "Watch and run experiments in the terminal."),
    "fit": (
        "norton_bench.cli.recordings:fit",
        "Fit recordings again, or fit logs of other programs.",
    ),
    "sweep": (
        "norton_bench.cli.sweep:sweep",
        "Fit many simulated sessions, or many recordings, in parallel.",
    ),
    "report": ("norton_bench.cli.recordings:report", "Write the report of a recording."),
    "datasheet": ("norton_bench.cli.datasheet:datasheet", "Write the data sheet of an actuator."),
    "law": ("norton_bench.cli.law:law", "Tell which virtual bodies a bench can render."),
    "info": ("norton_bench.cli.info:info", "Show what a recording contains, and the timing of its control loop."),
    "recover": ("norton_bench.cli.recordings:recover", "Repair a recording that was cut off."),
    "runs": ("norton_bench.cli.runs:runs", "List past runs, compare two, follow a parameter over time."),
    "export": ("norton_bench.cli.recordings:export", "Write a recording as Parquet, CSV or MATLAB tables."),
    "faults": ("norton_bench.cli.faults:faults", "Inject faults on simulated rigs, and report how each of them ends."),
    "paper": ("norton_bench.cli.paper:paper", "Test the claims of the paper in simulated experiments."),
    "devices": ("norton_bench.cli.check:devices", "List the serial ports and CAN adapters of this machine."),
    "completion": (
        "norton_bench.cli.app:completion",
        "Print or install the shell completion (Tab key).",
    ),
}
GROUPS = {
    "rig": (
        "Write a rig file, or check a rig.",
        {
            "new": ("norton_bench.cli.new:new", "Write a new rig file from your answers to questions."),
            "check": (
                "norton_bench.cli.check:check",
                "Check a rig, and report what is wrong. Moves nothing without --move.",
            ),
        },
    ),
    "network": (
        "Show, convert, join, draw or export network files.",
        {
            "show": (
                "norton_bench.cli.network:show",
                "Show a network, and whether measurements at its port determine it.",
            ),
            "convert": ("norton_bench.cli.network:convert", "Convert a network to another type or form."),
            "element": (
                "norton_bench.cli.network_algebra:element",
                "Write a spring, a damper, a mass, or an impedance of your own.",
            ),
            "join": ("norton_bench.cli.network_algebra:join", "Join networks in parallel or in series."),
            "gear": ("norton_bench.cli.network_algebra:gear", "See a network beyond a gear or lever."),
            "through": (
                "norton_bench.cli.network_algebra:through",
                "See a network through a load or a spring, or without it.",
            ),
            "export": ("norton_bench.cli.network:export", "Write a network for MuJoCo, as C, or as an FMU."),
            "plot": ("norton_bench.cli.network:plot", "Draw the source and the impedance of a network."),
        },
    ),
    "sim": (
        "The simulator.",
        {
            "serve": (
                "norton_bench.cli.simulator:serve",
                "Serve the simulated devices of a rig on its ports, in real time.",
            ),
            "truth": ("norton_bench.cli.simulator:truth", "Print the true values of a simulated actuator."),
        },
    ),
}


def build_app() -> App:
    """The app with all commands; none of them is imported."""
    app = App(
        name="norton-bench",
        help="Identify the nonlinear Norton equivalent network of an actuator.",
        help_format="plaintext",
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
    """One thread for linear algebra, unless the environment sets another number.

    Matrices are small here. More threads wait for each other in busy loops on the cores that loop and recorder need:
    a session takes twice the time, and far more on a busy machine.
    """
    for name in THREAD_COUNTS:
        os.environ.setdefault(name, "1")


def run_safely(command: Callable[[], object], *, debug: bool) -> int:
    """Run ``command``; returns its exit code, or that of the error with which it ended."""
    try:
        result = command()
        with to_stdout():
            pass  # buffered output is written here, where an error can still be reported
    except CycloptsError as error:
        return _usage(error)
    except (Exception, KeyboardInterrupt) as error:
        return report_error(error, debug=debug)
    return int(result) if isinstance(result, int) else ExitCode.OK


def _usage(error: CycloptsError) -> int:
    text = " ".join(str(error).split())
    if isinstance(error, UnusedCliTokensError):
        text = f"{' '.join(error.unused_tokens or ())}: is not an argument of this command; leave it out."
    complain(f"{text} See norton-bench --help.")
    return ExitCode.USAGE


def _register(app: App, commands: dict[str, tuple[str, str]]) -> None:
    for name, (path, help_text) in commands.items():
        app.command(path, name=name, help=help_text)
