"""Arming an ODrive's watchdog over the bus: it is off by default, and its parameters have no message of their own.

Parameters are reached by endpoint numbers, which differ between boards and firmware revisions. A wrong number would
write something else: so look first whether what stands there can be a watchdog, then write, then read back.
"""

from math import isclose

from norton_drivers.codecs import odrive as protocol
from norton_drivers.errors import DeviceError
from norton_drivers.odrive.dialect import Drive

_ANSWER_TIMEOUT_S = 0.5
_LONGEST_TIMEOUT_S = 1e4


class Parameters:
    """A drive's parameters, by endpoint. ``answers`` counts those that were answered."""

    def __init__(self, drive: Drive) -> None:
        self.answers = 0
        self._drive = drive
        self._values: dict[int, bytes] = {}

    def take(self, answer: protocol.TxSdo) -> None:
        """Note what the drive answered."""
        self.answers += 1
        self._values[answer.endpoint] = answer.value

    def write(self, endpoint: int, value: bytes) -> None:
        """Raises ConnectionFailedError."""
        self._drive.send(protocol.RxSdo(protocol.SdoOpcode.WRITE, endpoint, value))

    def read(self, endpoint: int) -> bytes:
        """Raises DeviceTimeoutError where the drive does not answer."""
        self._values.pop(endpoint, None)
        self._drive.send(protocol.RxSdo(protocol.SdoOpcode.READ, endpoint))
        self._drive.wait_for(
            lambda: endpoint in self._values,
            _ANSWER_TIMEOUT_S,
            f"does not answer for parameter {endpoint}; "
            'give it watchdog = "0 s" only if a watchdog is set in the drive',
        )
        return self._values[endpoint]


def arm_watchdog(drive: Drive, parameters: Parameters) -> None:
    """Set the timeout, feed, enable, and read both back.

    Raises DeviceTimeoutError where the drive answers no parameter requests, DeviceError where the endpoints are
    none of a watchdog, or where the drive does not take what is written.
    """
    options = drive.options
    timeout_at, enable_at = options.watchdog_timeout_endpoint, options.enable_watchdog_endpoint
    _check_endpoints(drive, parameters)
    parameters.write(timeout_at, protocol.f32_value(options.watchdog_s))
    drive.command(0.0)
    parameters.write(enable_at, protocol.u32_value(1))
    timeout_s = protocol.f32_of(parameters.read(timeout_at))
    enabled = parameters.read(enable_at)[0]
    if not isclose(timeout_s, options.watchdog_s, rel_tol=1e-6) or enabled != 1:
        raise DeviceError(
            f"{drive.place}: its watchdog does not take {options.watchdog_s:g} s (it says {timeout_s:g} s, "
            f"{'on' if enabled == 1 else 'off'}); {_mend(drive)}"
        )


def _check_endpoints(drive: Drive, parameters: Parameters) -> None:
    timeout_s = protocol.f32_of(parameters.read(drive.options.watchdog_timeout_endpoint))
    enabled = parameters.read(drive.options.enable_watchdog_endpoint)[0]
    # A comparison with NaN is false, as it should be.
    if not (0 <= timeout_s <= _LONGEST_TIMEOUT_S and enabled in (0, 1)):
        raise DeviceError(f"{drive.place}: has no watchdog where it was looked for; {_mend(drive)}")


def _mend(drive: Drive) -> str:
    options = drive.options
    return (
        f"set watchdog_timeout_endpoint (now {options.watchdog_timeout_endpoint}) and enable_watchdog_endpoint (now "
        f"{options.enable_watchdog_endpoint}) in the rig file from the flat_endpoints.json of this board and firmware"
    )
