"""What the program asks of the driver of actuators in MIT mode: its units, and how one is opened."""

from norton_drivers.link import Link
from norton_drivers.mit.actuator import MitActuator
from norton_drivers.mit.options import MitOptions
from norton_drivers.mit.replies import answers, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.spoken_to.options import UNITS
from norton_drivers.wiring import DeviceSettings, parse_options

CONNECTION = "can"
BITRATE = "1 Mbit/s"
OPTION_UNITS = {
    "position_range": "rad",
    "velocity_range": "rad/s",
    "torque_range": "N*m",
    "watchdog_probe": "N*m",
    **UNITS,
}


def open_amplifier(settings: DeviceSettings, link: Link) -> MitActuator:
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return MitActuator(settings, parse_options(MitOptions, settings), link.can_port(settings), link)
