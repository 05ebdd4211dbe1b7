"""Emulated devices, by the name of the driver that talks to them."""

from collections.abc import Callable
from importlib import import_module

from norton_sim.firmware.context import DeviceContext
from norton_sim.world import Firmware

# Module and class; imported when a rig has such a device.
FIRMWARE = {
    "odrive": ("odrive", "ODriveAxis"),
    "odrive 0.5": ("odrive_05", "ODrive05Axis"),
    "odrive_uart": ("odrive_uart", "ODriveText"),
    "cia402": ("cia402", "Cia402Drive"),
    "cubemars": ("cubemars", "CubeMarsActuator"),
    "damiao": ("damiao", "DamiaoMotor"),
    "dynamixel": ("dynamixel", "DynamixelServo"),
    "feetech": ("feetech", "FeetechServo"),
    "mit": ("mit", "MitMotor"),
    "moteus": ("moteus", "MoteusBoard"),
    "robstride": ("robstride", "RobStrideMotor"),
    "vesc": ("vesc", "VescController"),
    "vesc_uart": ("vesc_uart", "VescSerial"),
    "ascii": ("serial_sensors", "AsciiSensor"),
    "bota": ("bota", "BotaSensor"),
    "canopen": ("can_sensors", "CanopenSensor"),
    "celsius": ("serial_sensors", "CelsiusProbe"),
    "dbc": ("can_sensors", "DbcSensor"),
    "dyn200": ("dyn200", "Dyn200Sensor"),
    "simplefoc": ("simplefoc", "SimpleFocMotor"),
    "mantracourt": ("serial_sensors", "MantracourtSensor"),
}
DRIVERS = tuple(sorted(driver for driver in FIRMWARE if " " not in driver))


def start_firmware(context: DeviceContext) -> Firmware:
    """The device that the context's driver talks to, under way. Raises WiringError for wrong options."""
    driver = context.settings.driver
    if driver == "odrive" and context.settings.options.get("firmware") == "0.5":
        driver = "odrive 0.5"
    module, name = FIRMWARE[driver]
    make: Callable[[DeviceContext], Firmware] = getattr(import_module(f"{__name__}.{module}"), name)
    return make(context)
