"""Emulated devices, by the name of the driver that talks to them."""

from collections.abc import Callable, Mapping

from norton_drivers.odrive import ODriveOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.celsius import CelsiusProbe
from norton_sim.firmware.cia402 import Cia402Drive
from norton_sim.firmware.context import DeviceContext
from norton_sim.firmware.dyn200 import Dyn200Sensor
from norton_sim.firmware.mit import MitMotor
from norton_sim.firmware.odrive import ODriveAxis
from norton_sim.firmware.odrive_05 import ODrive05Axis
from norton_sim.firmware.torque_sensors import AsciiSensor, BotaSensor, CanopenSensor, DbcSensor, MantracourtSensor
from norton_sim.firmware.vesc import VescController
from norton_sim.world import Firmware


def _odrive(context: DeviceContext) -> Firmware:
    """The axis with the firmware that the rig names."""
    options = parse_options(ODriveOptions, context.settings)
    return ODrive05Axis(context) if options.firmware == "0.5" else ODriveAxis(context)


FIRMWARE: Mapping[str, Callable[[DeviceContext], Firmware]] = {
    "odrive": _odrive,
    "cia402": Cia402Drive,
    "mit": MitMotor,
    "vesc": VescController,
    "ascii": AsciiSensor,
    "bota": BotaSensor,
    "canopen": CanopenSensor,
    "celsius": CelsiusProbe,
    "dbc": DbcSensor,
    "dyn200": Dyn200Sensor,
    "mantracourt": MantracourtSensor,
}
