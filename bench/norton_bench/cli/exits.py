"""The one place that turns errors into sentences on stderr and into exit codes."""

import os
import sys
import traceback

from norton_bench.errors import ExitCode
from norton_bench.session.failure import exit_code_of, sentence_of


def report_error(error: BaseException, *, debug: bool) -> ExitCode:
    """Say on stderr what went wrong; with ``debug``, where in the program."""
    if isinstance(error, BrokenPipeError):
        # Whoever read our output has left; the interpreter must not trip over it again when it flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.EXPERIMENT_FAILED
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    print(sentence_of(error), file=sys.stderr)
    return exit_code_of(error)
