"""An error in words, and the exit code it stands for: the same on the command line, on the screen and in a result."""

from norton_bench.errors import BenchError, ExitCode
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError

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
