"""Errors that reach the user: one sentence with the place and the mend, and the exit code they end the program with."""

from collections.abc import Iterable
from difflib import get_close_matches
from enum import IntEnum

from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError


class ExitCode(IntEnum):
    """Documented in the README."""

    OK = 0
    EXPERIMENT_FAILED = 1
    USAGE = 2
    CONNECTION = 3
    TIMEOUT = 4
    SAFETY_STOP = 5
    INTERRUPTED = 130


class BenchError(Exception):
    """Base of every error that is the user's business."""

    exit_code = ExitCode.EXPERIMENT_FAILED


class UsageError(BenchError):
    """A file or an argument cannot be used as it stands."""

    exit_code = ExitCode.USAGE


class RigError(UsageError):
    """A rig file is wrong, or lacks what was asked of it."""


class ExperimentError(BenchError):
    """The experiment ran and did not give what it should."""


class SafetyStopError(BenchError):
    """The guard stopped the experiment; the drives are idle. ``by`` names what tripped: docs/safety.md lists them."""

    exit_code = ExitCode.SAFETY_STOP

    def __init__(self, reason: str, by: str = "guard") -> None:
        super().__init__(reason)
        self.by = by


class OperatorStopError(BenchError):
    """The operator stopped the experiment; the drives are idle."""

    exit_code = ExitCode.INTERRUPTED


def nearest(word: str, known: Iterable[str]) -> str:
    """For the end of a message about a word that is not ``known``: the closest one, or all there are."""
    choices = sorted(known)
    close = get_close_matches(word.lower(), choices, n=1, cutoff=0.6)
    if close:
        return f'did you mean "{close[0]}"?'
    return "known: " + (", ".join(choices) or "none")


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


def sentence_of(error: BaseException) -> str:
    """The error in words: its own where it is the user's business, else what to do about it."""
    if isinstance(error, KeyboardInterrupt):
        return "Interrupted."
    if isinstance(error, (BenchError, DeviceError)):
        return str(error)
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return f"Unexpected failure ({what}): a fault of norton-bench; run again with --debug and report what it shows."
