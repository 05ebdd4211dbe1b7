"""What can go wrong at a device or a port, each in one sentence that a user can act on."""

import re

_SYSTEM = re.compile(r"\[Errno -?\d+\] ([^:\[\]()]+)")


def reason_of(error: BaseException) -> str:
    """What the system said, in words: libraries wrap one failure into the other, and each names number and port again.

    "[Errno 2] could not open port x: [Errno 2] No such file or directory: 'x'" is "No such file or directory".
    """
    text = " ".join(str(error).split()) or type(error).__name__
    message = _SYSTEM.findall(text)
    return message[-1].strip() if message else text


class DeviceError(Exception):
    """A device or a port did not do what was asked. The text says which, what, and the remedy."""


class ConnectionFailedError(DeviceError):
    """A port cannot be opened, or was lost."""


class DeviceTimeoutError(DeviceError):
    """A device did not answer in time."""


class WiringError(DeviceError):
    """The rig's wiring asks for something that cannot be: unknown driver, missing option, wrong type."""
