"""What firmware 0.6 alone says: its version, why it disarmed, its parameters, its temperatures."""

from collections.abc import Mapping
from math import nan

from norton_drivers.codecs import odrive as protocol
from norton_drivers.codecs import odrive_words as words
from norton_drivers.codecs.odrive_05 import Command05
from norton_drivers.errors import DeviceError
from norton_drivers.inbox import Inbox
from norton_drivers.odrive.dialect import Drive, Handler, Heard
from norton_drivers.odrive.watchdog import Parameters, arm_watchdog

# A frame may be lost where many have piled up.
_TIMES_ASKED = 4


class Firmware06:
    """See :class:`norton_drivers.odrive.dialect.Dialect`."""

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
            protocol.Command.VERSION: self._on_version,
            protocol.Command.ERROR: self._on_error,
            protocol.Command.TX_SDO: self._on_parameter,
            protocol.Command.TEMPERATURE: self._on_temperature,
        }

    def heard(self, data: bytearray) -> Heard:
        heartbeat = protocol.Heartbeat.decode(data)
        self._result = heartbeat.procedure_result
        return Heard(heartbeat.error_bits, heartbeat.axis_state, heartbeat.error_bits != 0)

    def identify(self, timeout_s: float) -> tuple[str, str]:
        if not any(self._tells_version(timeout_s / _TIMES_ASKED) for _ in range(_TIMES_ASKED)):
            raise self._why_silent(timeout_s)
        version = self._versions.take()[-1]
        said = ".".join(map(str, version.firmware))
        if version.firmware[:2] != (0, 6):
            raise DeviceError(f'{self._drive.place}: says it runs firmware {said}; the rig file has firmware = "0.6"')
        return ".".join(map(str, version.hardware)), said

    def _tells_version(self, timeout_s: float) -> bool:
        before = self._versions.count
        self._drive.request(protocol.Command.VERSION)
        return self._drive.arrives(lambda: self._versions.count > before, timeout_s)

    def arm_watchdog(self) -> None:
        arm_watchdog(self._drive, self._parameters)

    def ask_why(self) -> None:
        if not self._disarm_bits:
            self._drive.request(protocol.Command.ERROR)

    def forget(self) -> None:
        self._disarm_bits = 0

    def errors(self, error_bits: int) -> tuple[str, ...]:
        return words.describe_errors(error_bits | self._disarm_bits)

    def refusals(self) -> tuple[str, ...]:
        if self._result in (protocol.RESULT_SUCCESS, protocol.RESULT_BUSY):
            return ()
        return (words.describe_procedure_result(self._result),)

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
        self._parameters.take(protocol.TxSdo.decode(data))

    def _on_temperature(self, data: bytearray, arrival_ns: int) -> None:
        self.temperature = protocol.Temperature.decode(data)
