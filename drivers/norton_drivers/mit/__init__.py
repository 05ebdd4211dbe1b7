"""Actuators in MIT mode: mini-cheetah, CubeMars AK and their like."""

from norton_drivers.mit.actuator import MitActuator
from norton_drivers.mit.drive import open_amplifier
from norton_drivers.mit.options import MitOptions

__all__ = ["MitActuator", "MitOptions", "open_amplifier"]
