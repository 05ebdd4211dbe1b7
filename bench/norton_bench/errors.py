"""Errors that reach the user: one sentence with the place and the mend, and the exit code they end the program with."""

from enum import IntEnum


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
