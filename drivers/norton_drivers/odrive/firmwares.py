"""What differs between the firmwares of an ODrive, and what each needs of the driver.

Firmware 0.5 tells which part of the axis failed, and of what. It has no version and no parameters on CAN. Its watchdog
is set in the drive over USB and minds an idle axis too: one that nobody has spoken to for a while says that its
watchdog has expired, which is no failure until the loop is closed.

Firmware 0.6 tells its version, why it disarmed, its parameters and its temperatures. Its watchdog is off by default
and is armed over the bus, through parameters. Those are reached by endpoint numbers, which differ between boards and
firmware revisions. A wrong number would write something else. So look first whether what stands there can be a
watchdog, then write, then read back.
"""

from collections.abc import Callable, Mapping
from functools import partial
from math import isclose, nan
from typing import Final, NamedTuple, Protocol

from norton_drivers.codecs import odrive as protocol
from norton_drivers.codecs import odrive_05, odrive_06
from norton_drivers.codecs.odrive import Temperature
from norton_drivers.codecs.odrive_05 import ERROR_WATCHDOG, ClearErrors05, Command05, Heartbeat05, errors_of
from norton_drivers.codecs.odrive_06 import describe_errors, describe_procedure_result
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.readings import Inbox

Handler = Callable[[bytearray, int], None]  # payload, arrival


class Message(Protocol):
    """Anything of the codecs that can be sent."""

    @property
    def COMMAND(self) -> int: ...  # noqa: N802  (a constant of the class)
    def encode(self) -> bytes: ...


class HeartbeatState(NamedTuple):
    """What a heartbeat says, whatever the firmware: ``failed`` where something must be mended or cleared."""

    error_bits: int
    axis_state: int
    failed: bool


class DriveOptions(Protocol):
    """The part of the options that is needed here."""

    @property
    def watchdog_s(self) -> float: ...
    @property
    def watchdog_timeout_endpoint(self) -> int: ...
    @property
    def enable_watchdog_endpoint(self) -> int: ...


class Drive(Protocol):
    """The part of the driver that is needed here."""

    @property
    def options(self) -> DriveOptions: ...
    @property
    def place(self) -> str: ...
    def send(self, message: Message) -> None: ...
    def request(self, command: int) -> None: ...
    def command(self, value: float) -> float: ...
    def arrives(self, arrived: Callable[[], bool], timeout_s: float) -> bool: ...
    def wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None: ...
    def late(self, timeout_s: float, otherwise: str) -> DeviceTimeoutError: ...


class Dialect(Protocol):
    """One firmware's own messages."""

    @property
    def clear_errors(self) -> Message: ...

    @property
    def encoder_rate(self) -> str:
        """The name of the drive's own setting for how often it sends its estimates."""
        ...

    @property
    def temperature(self) -> Temperature:
        """As last told; NaN where this firmware tells none."""
        ...

    def handlers(self) -> Mapping[int, Handler]:
        """What is to be called for messages that only this firmware sends, by command."""
        ...

    def heard(self, data: bytearray) -> HeartbeatState:
        """Read a heartbeat. Raises CodecError."""
        ...

    def identify(self, timeout_s: float) -> tuple[str, str]:
        """Hardware and firmware, as the drive tells. Raises DeviceTimeoutError; DeviceError for another firmware."""
        ...

    def arm_watchdog(self) -> None:
        """See that the drive's watchdog is armed, as far as this firmware lets anybody. Raises DeviceError."""
        ...

    def ask_why(self) -> None:
        """Ask for the reasons of a failure. Raises ConnectionFailedError."""
        ...

    def forget(self) -> None:
        """Errors were cleared: past reasons are none any more."""
        ...

    def errors(self, error_bits: int) -> tuple[str, ...]:
        """A heartbeat's errors and all that has been told since, in words."""
        ...

    def refusals(self) -> tuple[str, ...]:
        """Why the loop was not closed, where the drive tells it otherwise than by errors."""
        ...


_ANSWER_TIMEOUT_S = 0.5
_LONGEST_TIMEOUT_S = 1e4


class Parameters:
    """A drive's parameters, by endpoint. ``answers`` counts those that were answered."""

    def __init__(self, drive: Drive) -> None:
        self.answers = 0
        self._drive = drive
        self._values: dict[int, bytes] = {}

    def take(self, answer: odrive_06.TxSdo) -> None:
        """Note what the drive answered."""
        self.answers += 1
        self._values[answer.endpoint] = answer.value

    def write(self, endpoint: int, value: bytes) -> None:
        """Raises ConnectionFailedError."""
        self._drive.send(odrive_06.RxSdo(odrive_06.SdoOpcode.WRITE, endpoint, value))

    def read(self, endpoint: int) -> bytes:
        """Raises DeviceTimeoutError where the drive does not answer."""
        self._values.pop(endpoint, None)
        self._drive.send(odrive_06.RxSdo(odrive_06.SdoOpcode.READ, endpoint))
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
    parameters.write(timeout_at, odrive_06.f32_value(options.watchdog_s))
    drive.command(0.0)
    parameters.write(enable_at, odrive_06.u32_value(1))
    timeout_s = odrive_06.f32_of(parameters.read(timeout_at))
    enabled = parameters.read(enable_at)[0]
    if not isclose(timeout_s, options.watchdog_s, rel_tol=1e-6) or enabled != 1:
        raise DeviceError(
            f"{drive.place}: its watchdog does not take {options.watchdog_s:g} s (it says {timeout_s:g} s, "
            f"{'on' if enabled == 1 else 'off'}); {_mend(drive)}"
        )


def _check_endpoints(drive: Drive, parameters: Parameters) -> None:
    timeout_s = odrive_06.f32_of(parameters.read(drive.options.watchdog_timeout_endpoint))
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


# Which message tells a part's errors, and what its bits mean.
_PARTS: Final = {
    Command05.MOTOR_ERROR: (odrive_05.MOTOR_WORDS, "motor"),
    Command05.ENCODER_ERROR: (odrive_05.ENCODER_WORDS, "encoder"),
    Command05.CONTROLLER_ERROR: (odrive_05.CONTROLLER_WORDS, "controller"),
    Command05.SENSORLESS_ERROR: (odrive_05.SENSORLESS_WORDS, "sensorless"),
}


class Firmware05:
    """See :class:`norton_drivers.odrive.firmwares.Dialect`."""

    clear_errors = ClearErrors05()
    encoder_rate = "encoder_rate_ms"
    temperature = protocol.Temperature(nan, nan)

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._answers = 0
        self._versions: Inbox[protocol.Version] = Inbox()
        self._bits = dict.fromkeys(_PARTS, 0)

    def handlers(self) -> Mapping[int, Handler]:
        handlers: dict[int, Handler] = {part: partial(self._on_part, part) for part in _PARTS}
        handlers[protocol.MessageId.VERSION] = self._on_version
        return handlers

    def heard(self, data: bytearray) -> HeartbeatState:
        heartbeat = Heartbeat05.decode(data)
        parts_failed = heartbeat.motor_failed or heartbeat.encoder_failed or heartbeat.controller_failed
        idle = heartbeat.axis_state == protocol.AxisState.IDLE
        failures = heartbeat.error_bits & ~ERROR_WATCHDOG if idle else heartbeat.error_bits
        return HeartbeatState(heartbeat.error_bits, heartbeat.axis_state, parts_failed or failures != 0)

    def identify(self, timeout_s: float) -> tuple[str, str]:
        asked, before = self._versions.count, self._answers
        self._drive.request(protocol.MessageId.VERSION)  # which 0.6 alone answers
        self._drive.request(Command05.SENSORLESS_ERROR)  # which 0.5 alone answers
        self._drive.wait_for(
            lambda: self._answers > before or self._versions.count > asked,
            timeout_s,
            "does not answer; is it powered and on this bus?",
        )
        if versions := self._versions.take():
            message = ".".join(map(str, versions[-1].firmware))
            raise DeviceError(
                f'{self._drive.place}: says it runs firmware {message}; the rig file has firmware = "0.5"'
            )
        return "", "0.5"

    def arm_watchdog(self) -> None:
        """Nothing on CAN reaches it: what the rig file says of it is seen when it is left to bite."""

    def ask_why(self) -> None:
        if not any(self._bits.values()):
            for part in _PARTS:
                self._drive.request(part)

    def forget(self) -> None:
        self._bits = dict.fromkeys(_PARTS, 0)

    def errors(self, error_bits: int) -> tuple[str, ...]:
        result = odrive_05.describe_errors_05(error_bits, odrive_05.AXIS_WORDS, "axis")
        for part, (meaning, name) in _PARTS.items():
            result += odrive_05.describe_errors_05(self._bits[part], meaning, name)
        return result

    def refusals(self) -> tuple[str, ...]:
        return ()

    def _on_part(self, part: Command05, data: bytearray, arrival_ns: int) -> None:
        self._bits[part] = errors_of(data)
        self._answers += 1

    def _on_version(self, data: bytearray, arrival_ns: int) -> None:
        self._versions.put(protocol.Version.decode(data))


# A frame may be lost where many have piled up.
_TIMES_ASKED = 4


class Firmware06:
    """See :class:`norton_drivers.odrive.firmwares.Dialect`."""

    clear_errors = protocol.ClearErrors()
    encoder_rate = "encoder_msg_rate_ms"

    def __init__(self, drive: Drive) -> None:
        self.temperature = protocol.Temperature(nan, nan)
        self._drive = drive
        self._parameters = Parameters(drive)
        self._versions: Inbox[protocol.Version] = Inbox()
        self._disarm_bits = 0
        self._result = protocol.RESULT_SUCCESS

    def handlers(self) -> Mapping[int, Handler]:
        return {
            protocol.MessageId.VERSION: self._on_version,
            protocol.MessageId.ERROR: self._on_error,
            protocol.MessageId.TX_SDO: self._on_parameter,
            protocol.MessageId.TEMPERATURE: self._on_temperature,
        }

    def heard(self, data: bytearray) -> HeartbeatState:
        heartbeat = protocol.Heartbeat.decode(data)
        self._result = heartbeat.procedure_result
        return HeartbeatState(heartbeat.error_bits, heartbeat.axis_state, heartbeat.error_bits != 0)

    def identify(self, timeout_s: float) -> tuple[str, str]:
        if not any(self._tells_version(timeout_s / _TIMES_ASKED) for _ in range(_TIMES_ASKED)):
            raise self._why_silent(timeout_s)
        version = self._versions.take()[-1]
        message = ".".join(map(str, version.firmware))
        if version.firmware[:2] != (0, 6):
            raise DeviceError(
                f'{self._drive.place}: says it runs firmware {message}; the rig file has firmware = "0.6"'
            )
        return ".".join(map(str, version.hardware)), message

    def _tells_version(self, timeout_s: float) -> bool:
        before = self._versions.count
        self._drive.request(protocol.MessageId.VERSION)
        return self._drive.arrives(lambda: self._versions.count > before, timeout_s)

    def arm_watchdog(self) -> None:
        arm_watchdog(self._drive, self._parameters)

    def ask_why(self) -> None:
        if not self._disarm_bits:
            self._drive.request(protocol.MessageId.ERROR)

    def forget(self) -> None:
        self._disarm_bits = 0

    def errors(self, error_bits: int) -> tuple[str, ...]:
        return describe_errors(error_bits | self._disarm_bits)

    def refusals(self) -> tuple[str, ...]:
        if self._result in (protocol.RESULT_SUCCESS, protocol.RESULT_BUSY):
            return ()
        return (describe_procedure_result(self._result),)

    def _why_silent(self, timeout_s: float) -> DeviceError:
        """Firmware 0.5 has no version to tell, but answers here, where 0.6 has nothing that could be asked for."""
        before = self._parameters.answers
        self._drive.request(Command05.SENSORLESS_ERROR)
        if self._drive.arrives(lambda: self._parameters.answers > before, timeout_s):
            return DeviceError(f'{self._drive.place}: answers as firmware 0.5 does; write firmware = "0.5"')
        return self._drive.late(timeout_s, "does not answer; is it powered and on this bus?")

    def _on_version(self, data: bytearray, arrival_ns: int) -> None:
        self._versions.put(protocol.Version.decode(data))

    def _on_error(self, data: bytearray, arrival_ns: int) -> None:
        error = protocol.GetError.decode(data)
        self._disarm_bits = error.active_bits | error.disarm_bits

    def _on_parameter(self, data: bytearray, arrival_ns: int) -> None:
        self._parameters.take(odrive_06.TxSdo.decode(data))

    def _on_temperature(self, data: bytearray, arrival_ns: int) -> None:
        self.temperature = protocol.Temperature.decode(data)
