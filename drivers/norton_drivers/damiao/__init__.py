"""Damiao DM motors."""

from norton_drivers.damiao.drive import open_amplifier
from norton_drivers.damiao.motor import Damiao
from norton_drivers.damiao.options import DamiaoOptions

__all__ = ["Damiao", "DamiaoOptions", "open_amplifier"]
