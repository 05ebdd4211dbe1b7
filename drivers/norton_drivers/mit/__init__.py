"""Actuators in MIT mode: mini-cheetah, CubeMars AK and their like."""

from norton_drivers.mit.actuator import MitActuator
from norton_drivers.mit.drive import MitOptions, open_amplifier

__all__ = ["MitActuator", "MitOptions", "open_amplifier"]
