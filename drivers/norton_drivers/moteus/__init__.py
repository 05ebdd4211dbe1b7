"""moteus controllers of mjbots, on CAN FD."""

from norton_drivers.moteus.controller import MoteusController
from norton_drivers.moteus.drive import open_amplifier
from norton_drivers.moteus.options import MoteusOptions

__all__ = ["MoteusController", "MoteusOptions", "open_amplifier"]
