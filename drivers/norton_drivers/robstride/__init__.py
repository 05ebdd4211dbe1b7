"""RobStride motors, and Xiaomi's CyberGear."""

from norton_drivers.robstride.drive import open_amplifier
from norton_drivers.robstride.motor import RobStride
from norton_drivers.robstride.options import RobStrideOptions

__all__ = ["RobStride", "RobStrideOptions", "open_amplifier"]
