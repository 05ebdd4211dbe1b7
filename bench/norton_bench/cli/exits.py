"""The one place that turns errors into sentences on stderr and into exit codes."""

import sys
import traceback

from norton_bench.cli.output import complain
from norton_bench.errors import ExitCode
from norton_bench.session.failure import exit_code_of, sentence_of


def report_error(error: BaseException, *, debug: bool) -> ExitCode:
    """Say on stderr what went wrong; with ``debug``, where in the program."""
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    complain(sentence_of(error))
    return exit_code_of(error)
