"""The one place that turns errors into sentences on stderr and into exit codes."""

import os
import sys
import traceback

from bench.errors import BenchError, ExitCode
from drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError

DEVICE_CODES = (
    (ConnectionFailedError, ExitCode.CONNECTION),
    (DeviceTimeoutError, ExitCode.TIMEOUT),
    (WiringError, ExitCode.USAGE),
    (DeviceError, ExitCode.EXPERIMENT_FAILED),
)


def exit_code_of(error: BaseException) -> ExitCode:
    """What the program ends with because of ``error``."""
    if isinstance(error, BenchError):
        return error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return ExitCode.INTERRUPTED
    return next((code for kind, code in DEVICE_CODES if isinstance(error, kind)), ExitCode.EXPERIMENT_FAILED)


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


def sentence_of(error: BaseException) -> str:
    """The error in words: its own where it is the user's business, else what to do about it."""
    if isinstance(error, KeyboardInterrupt):
        return "Interrupted."
    if isinstance(error, (BenchError, DeviceError)):
        return str(error)
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return f"Unexpected failure ({what}): a fault of norton-bench; run again with --debug and report what it shows."
