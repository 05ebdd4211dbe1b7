"""Feetech STS and SCS servos on a half-duplex line."""

from norton_drivers.feetech.drive import open_amplifier
from norton_drivers.feetech.options import FeetechOptions
from norton_drivers.feetech.servo import FeetechServo

__all__ = ["FeetechOptions", "FeetechServo", "open_amplifier"]
