"""VESC motor controllers on CAN."""

from norton_drivers.vesc.drive import Vesc, VescOptions, open_amplifier

__all__ = ["Vesc", "VescOptions", "open_amplifier"]
