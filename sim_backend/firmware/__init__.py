"""Emulated devices, by the name of the driver that talks to them."""

from collections.abc import Callable, Mapping

from sim_backend.firmware.bota import BotaSensor
from sim_backend.firmware.canopen_sensor import CanopenSensor
from sim_backend.firmware.cia402 import Cia402Drive
from sim_backend.firmware.dbc_sensor import DbcSensor
from sim_backend.firmware.odrive import ODriveAxis
from sim_backend.firmware.site import Firmware, Site

FIRMWARE: Mapping[str, Callable[[Site], Firmware]] = {
    "odrive": ODriveAxis,
    "cia402": Cia402Drive,
    "bota": BotaSensor,
    "dbc": DbcSensor,
    "canopen": CanopenSensor,
}
