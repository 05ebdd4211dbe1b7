"""Bota Systems force-torque sensors on a serial line (binary format): one of their three torques.

The sensor streams by itself. Torque is that which the actuator exerts on the load, times ``direction``.
"""

from math import inf
from typing import Literal

from pydantic import Field

from norton_drivers.codecs.bota import BAUD, FRAME_LENGTH, BotaFrame, BotaStream, describe_status
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort
from norton_drivers.readings import DeviceIdentity, Unwrapped
from norton_drivers.serial_sensor import SerialSensor
from norton_drivers.wiring import DeviceSettings, TorqueSensorOptions, parse_options

CONNECTION = "serial"
OPTION_UNITS = {"range": "N*m", "averaging": "s"}

_CLOCK_WRAP_US = 1 << 32  # after 72 minutes


class BotaOptions(TorqueSensorOptions):
    """What a rig file may say of a Bota sensor."""

    axis: Literal["x", "y", "z"] = Field("z", description="the sensor's axis that is the shaft's")
    range_nm: float = Field(inf, alias="range", gt=0, description="the torque it can measure", examples=["2 N*m"])
    baud: int = Field(BAUD, gt=0, description="the baud rate set in the sensor", examples=[BAUD])


def open_torque_sensor(settings: DeviceSettings, link: Link) -> "BotaSensor":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(BotaOptions, settings)
    return BotaSensor(settings, options, link.serial_port(settings, options.baud), link)


class BotaSensor(SerialSensor):
    """One axis of torque. ``stream`` counts what was no frame."""

    def __init__(self, settings: DeviceSettings, options: BotaOptions, port: SerialPort, link: Link) -> None:
        super().__init__(settings, options, port, link, 1.0)
        self.stream = BotaStream()
        self._baud = options.baud
        self._status = 0  # of the last frame
        self._field = BotaFrame._fields.index(f"torque_{options.axis}_nm")
        self._clock_us = Unwrapped(_CLOCK_WRAP_US)
        port.subscribe(self._on_bytes)

    @property
    def malformed(self) -> int:
        """Stretches of bytes that began like a frame and were none."""
        return self.stream.crc_errors

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Wait for a frame: the sensor sends nothing else of itself while it streams.

        Raises DeviceTimeoutError where none comes, DeviceError for a sensor that says that it is not well.
        """
        if not self._comes(timeout_s):
            raise DeviceTimeoutError(
                f"[{self.role}] Bota sensor on {self._port.name}: no frame in {timeout_s:g} s "
                f"({self.stream.discarded_bytes} bytes that are none); check power, port and baud {self._baud}"
            )
        if words := describe_status(self._status):
            raise DeviceError(f"[{self.role}] Bota sensor on {self._port.name}: says that {'; '.join(words)}")
        return DeviceIdentity(driver="bota", address=self._port.name)

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        frames = self.stream.feed(data)
        if not frames:
            return
        for frame, complete_ns in self._stamps.each(frames, FRAME_LENGTH, arrival_ns, self.stream.pending_bytes):
            self._status = frame.status
            clock_ns = 1000 * self._clock_us.follow(frame.timestamp_us)
            self._put(frame[self._field], complete_ns, clock_ns, sound=not frame.status and frame.finite)
