"""How the devices of one bench are connected: plain data, validated by whoever reads the rig file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class CanBusSettings:
    """One CAN bus, in python-can's own terms (``interface``, ``channel``, ``bitrate`` and its further options)."""

    name: str
    interface: str
    channel: str
    bitrate_bit_s: int = 1_000_000
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class DeviceSettings:
    """One device: its driver's name, where it is connected, and the options its driver understands.

    ``direction`` is +1 or -1: the sign that turns the device's own positive sense into the bench's
    (the actuator's positive rotation, seen at the port; positive torque accelerates the load that way).
    """

    role: str  # its section in the rig file: "actuator", "load", "torque_sensor", "modulator", or a further sensor's
    driver: str
    bus: str | None = None  # the name of a CAN bus
    port: str | None = None  # a serial port: a path or any pyserial URL
    direction: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)
    released_at_zero: bool = False  # as its driver's options have it
    dead_band: float = 0.0  # commands smaller than this do nothing, in the unit of its commands


@dataclass(frozen=True)
class Wiring:
    """Everything the backends and the drivers need to know of a rig."""

    name: str
    tick_ns: int
    buses: tuple[CanBusSettings, ...]
    actuator: DeviceSettings
    torque_sensor: DeviceSettings | None = None
    load: DeviceSettings | None = None
    shaft: str = "free"  # where there is no load drive: "free" or "clamped"
    command_unit: str = "N*m"  # of the actuator's command
    modulator: DeviceSettings | None = None  # the actuator's second drive, which sets its impedance
    modulation_unit: str = ""  # of its command
    sensors: tuple[DeviceSettings, ...] = ()  # further ones, which only the recording and the screen need

    def devices(self) -> tuple[DeviceSettings, ...]:
        """The devices that are there, the actuator first."""
        present = (self.actuator, self.load, self.torque_sensor, self.modulator, *self.sensors)
        return tuple(device for device in present if device is not None)
