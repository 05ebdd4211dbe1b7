"""Arming an ODrive's watchdog over the bus: it is off by default, and its parameters have no message of their own.

Parameters are reached by endpoint numbers, which differ between boards and firmware revisions. A wrong number would
write something else: so look first whether what stands there can be a watchdog, then write, then read back.
"""

from collections.abc import Callable
from math import isclose
from typing import Protocol

from drivers.codecs import odrive as protocol
from drivers.errors import DeviceError

_ANSWER_TIMEOUT_S = 0.5
_LONGEST_TIMEOUT_S = 1e4


class WatchdogOptions(Protocol):
    @property
    def watchdog_s(self) -> float: ...
    @property
    def watchdog_timeout_endpoint(self) -> int: ...
    @property
    def enable_watchdog_endpoint(self) -> int: ...


class WatchedDrive(Protocol):
    """The part of the driver that is needed here."""

    parameters: dict[int, bytes]

    @property
    def options(self) -> WatchdogOptions: ...
    @property
    def place(self) -> str: ...
    def send(self, message: protocol.RxSdo) -> None: ...
    def command(self, value: float) -> float: ...
    def wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None: ...


def arm_watchdog(drive: WatchedDrive) -> None:
    """Set the timeout, feed, enable, and read both back.

    Raises DeviceTimeoutError where the drive answers no parameter requests, DeviceError where the endpoints are
    none of a watchdog, or where the drive does not take what is written.
    """
    options = drive.options
    timeout_at, enable_at = options.watchdog_timeout_endpoint, options.enable_watchdog_endpoint
    _check_endpoints(drive, timeout_at, enable_at)
    _write(drive, timeout_at, protocol.f32_value(options.watchdog_s))
    drive.command(0.0)
    _write(drive, enable_at, protocol.u32_value(1))
    timeout_s = protocol.f32_of(_read(drive, timeout_at))
    enabled = _read(drive, enable_at)[0]
    if not isclose(timeout_s, options.watchdog_s, rel_tol=1e-6) or enabled != 1:
        raise DeviceError(
            f"{drive.place}: its watchdog does not take {options.watchdog_s:g} s (it says {timeout_s:g} s, "
            f"{'on' if enabled == 1 else 'off'}); {_mend(timeout_at, enable_at)}"
        )


def _check_endpoints(drive: WatchedDrive, timeout_at: int, enable_at: int) -> None:
    timeout_s = protocol.f32_of(_read(drive, timeout_at))
    enabled = _read(drive, enable_at)[0]
    # A comparison with NaN is false, as it should be.
    if not (0 <= timeout_s <= _LONGEST_TIMEOUT_S and enabled in (0, 1)):
        raise DeviceError(f"{drive.place}: has no watchdog where it was looked for; {_mend(timeout_at, enable_at)}")


def _mend(timeout_at: int, enable_at: int) -> str:
    return (
        f"set watchdog_timeout_endpoint (now {timeout_at}) and enable_watchdog_endpoint (now {enable_at}) in the rig "
        "file from the flat_endpoints.json of this board and firmware"
    )


def _write(drive: WatchedDrive, endpoint: int, value: bytes) -> None:
    drive.send(protocol.RxSdo(protocol.SdoOpcode.WRITE, endpoint, value))


def _read(drive: WatchedDrive, endpoint: int) -> bytes:
    drive.parameters.pop(endpoint, None)
    drive.send(protocol.RxSdo(protocol.SdoOpcode.READ, endpoint))
    mend = f'does not answer for parameter {endpoint}; give it watchdog = "0 s" only if a watchdog is set in the drive'
    drive.wait_for(lambda: endpoint in drive.parameters, _ANSWER_TIMEOUT_S, mend)
    return drive.parameters[endpoint]
