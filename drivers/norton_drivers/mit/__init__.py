"""Actuators in MIT mode: mini-cheetah, CubeMars AK and their like."""

from norton_drivers.mit.drive import MitActuator, MitOptions, open_amplifier

__all__ = ["MitActuator", "MitOptions", "open_amplifier"]
