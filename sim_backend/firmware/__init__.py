"""Emulated devices, by the name of the driver that talks to them."""

from collections.abc import Callable, Mapping

from drivers.odrive import ODriveOptions
from drivers.options import parse_options
from sim_backend.firmware.ascii_lines import AsciiSensor
from sim_backend.firmware.bota import BotaSensor
from sim_backend.firmware.canopen_sensor import CanopenSensor
from sim_backend.firmware.cia402 import Cia402Drive
from sim_backend.firmware.dbc_sensor import DbcSensor
from sim_backend.firmware.dyn200 import Dyn200Sensor
from sim_backend.firmware.mantracourt import MantracourtSensor
from sim_backend.firmware.mit import MitMotor
from sim_backend.firmware.odrive import ODriveAxis
from sim_backend.firmware.odrive_05 import ODrive05Axis
from sim_backend.firmware.site import Firmware, Site
from sim_backend.firmware.vesc import VescController


def _odrive(site: Site) -> Firmware:
    """The axis with the firmware that the rig names."""
    options = parse_options(ODriveOptions, site.settings)
    return ODrive05Axis(site) if options.firmware == "0.5" else ODriveAxis(site)


FIRMWARE: Mapping[str, Callable[[Site], Firmware]] = {
    "odrive": _odrive,
    "cia402": Cia402Drive,
    "mit": MitMotor,
    "vesc": VescController,
    "ascii": AsciiSensor,
    "bota": BotaSensor,
    "canopen": CanopenSensor,
    "dbc": DbcSensor,
    "dyn200": Dyn200Sensor,
    "mantracourt": MantracourtSensor,
}
