"""CubeMars' AK actuators in servo mode."""

from norton_drivers.cubemars.drive import CubeMars, CubeMarsOptions, open_amplifier

__all__ = ["CubeMars", "CubeMarsOptions", "open_amplifier"]
