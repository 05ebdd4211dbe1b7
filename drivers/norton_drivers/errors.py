"""What can go wrong at a device or a port, each in one sentence that a user can act on."""


class DeviceError(Exception):
    """A device or a port does not do what was asked; the text says which, what, and the mend."""


class ConnectionFailedError(DeviceError):
    """A port cannot be opened, or was lost."""


class DeviceTimeoutError(DeviceError):
    """A device did not answer in time."""


class WiringError(DeviceError):
    """The rig's wiring asks for something that cannot be: unknown driver, missing option, wrong type."""
