"""``completion``: what a shell needs to complete commands, options and file names on the Tab key."""

from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.completion.detect import ShellDetectionError

from norton_bench.cli.output import Output
from norton_bench.errors import UsageError

Shell = Annotated[
    Literal["bash", "zsh", "fish"] | None, Parameter(name="SHELL", help="Your shell; found out where none is given.")
]
Install = Annotated[
    bool, Parameter(help="Put it where the shell looks for it, and a line that reads it into its startup file.")
]


def completion(shell: Shell = None, /, *, install: Install = False) -> None:
    """Print the script that completes norton-bench in a shell, or install it."""
    from norton_bench.cli.app import build_app  # noqa: PLC0415  (which names this command)

    try:
        app = build_app()
        said = f"{app.install_completion(shell=shell)}\n" if install else app.generate_completion(shell=shell)
    except ShellDetectionError:
        raise UsageError("this shell is not known; name it: norton-bench completion bash (or zsh, or fish)") from None
    except OSError as error:
        raise UsageError(
            f"{error.filename}: cannot be written ({error.strerror}); print it, and put it into a file of your own: "
            "norton-bench completion bash > FILE"
        ) from error
    Output().result(None, said.rstrip())
