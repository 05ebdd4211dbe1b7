"""Emulated devices, by the name of the driver that talks to them."""

from collections.abc import Callable, Mapping

from sim_backend.firmware.bota import BotaSensor
from sim_backend.firmware.dbc_sensor import DbcSensor
from sim_backend.firmware.mit import MitMotor
from sim_backend.firmware.odrive import ODriveAxis
from sim_backend.firmware.site import Firmware, Site
from sim_backend.firmware.vesc import VescController

FIRMWARE: Mapping[str, Callable[[Site], Firmware]] = {
    "odrive": ODriveAxis,
    "mit": MitMotor,
    "vesc": VescController,
    "bota": BotaSensor,
    "dbc": DbcSensor,
}
