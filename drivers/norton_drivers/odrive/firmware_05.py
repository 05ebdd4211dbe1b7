"""What firmware 0.5 alone says: which part of the axis failed, and of what. It has no version and no parameters on CAN.

Its watchdog is set in the drive over USB, and minds an idle axis too: one that nobody has spoken to for a while says
that its watchdog has expired, which is no failure until the loop is closed.
"""

from collections.abc import Mapping
from functools import partial
from math import nan
from typing import Final

from norton_drivers.codecs import odrive as protocol
from norton_drivers.codecs import odrive_05_words as words
from norton_drivers.codecs.odrive_05 import ERROR_WATCHDOG, ClearErrors05, Command05, Heartbeat05, errors_of
from norton_drivers.errors import DeviceError
from norton_drivers.inbox import Inbox
from norton_drivers.odrive.dialect import Drive, Handler, Heard

# Which message tells a part's errors, and what its bits mean.
_PARTS: Final = {
    Command05.MOTOR_ERROR: (words.MOTOR, "motor"),
    Command05.ENCODER_ERROR: (words.ENCODER, "encoder"),
    Command05.CONTROLLER_ERROR: (words.CONTROLLER, "controller"),
    Command05.SENSORLESS_ERROR: (words.SENSORLESS, "sensorless"),
}


class Firmware05:
    """See :class:`norton_drivers.odrive.dialect.Dialect`."""

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
        handlers[protocol.Command.VERSION] = self._on_version
        return handlers

    def heard(self, data: bytearray) -> Heard:
        heartbeat = Heartbeat05.decode(data)
        parts_failed = heartbeat.motor_failed or heartbeat.encoder_failed or heartbeat.controller_failed
        idle = heartbeat.axis_state == protocol.AxisState.IDLE
        failures = heartbeat.error_bits & ~ERROR_WATCHDOG if idle else heartbeat.error_bits
        return Heard(heartbeat.error_bits, heartbeat.axis_state, parts_failed or failures != 0)

    def identify(self, timeout_s: float) -> tuple[str, str]:
        asked, before = self._versions.count, self._answers
        self._drive.request(protocol.Command.VERSION)  # which 0.6 alone answers
        self._drive.request(Command05.SENSORLESS_ERROR)  # which 0.5 alone answers
        self._drive.wait_for(
            lambda: self._answers > before or self._versions.count > asked,
            timeout_s,
            "does not answer; is it powered and on this bus?",
        )
        if versions := self._versions.take():
            said = ".".join(map(str, versions[-1].firmware))
            raise DeviceError(f'{self._drive.place}: says it runs firmware {said}; the rig file has firmware = "0.5"')
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
        found = words.describe(error_bits, words.AXIS, "axis")
        for part, (meaning, name) in _PARTS.items():
            found += words.describe(self._bits[part], meaning, name)
        return found

    def refusals(self) -> tuple[str, ...]:
        return ()

    def _on_part(self, part: Command05, data: bytearray, arrival_ns: int) -> None:
        self._bits[part] = errors_of(data)
        self._answers += 1

    def _on_version(self, data: bytearray, arrival_ns: int) -> None:
        self._versions.put(protocol.Version.decode(data))
