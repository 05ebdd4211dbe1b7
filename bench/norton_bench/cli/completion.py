"""``completion``: the script with which a shell completes commands, options and file names on the Tab key."""

from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.completion.detect import ShellDetectionError

from norton_bench.cli.output import Output
from norton_bench.errors import UsageError

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
