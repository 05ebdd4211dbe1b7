"""Dynamixel X servos on a half-duplex line."""

from norton_drivers.dynamixel.drive import open_amplifier
from norton_drivers.dynamixel.options import DynamixelOptions
from norton_drivers.dynamixel.servo import DynamixelServo

__all__ = ["DynamixelOptions", "DynamixelServo", "open_amplifier"]
