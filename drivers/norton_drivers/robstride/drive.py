"""What the program asks of the driver of RobStride motors: its units, how one is opened, and how one is known."""

from norton_drivers.link import Link
from norton_drivers.robstride.messages import answers, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.robstride.motor import RobStride
from norton_drivers.robstride.options import RobStrideOptions
from norton_drivers.spoken_to.options import UNITS
from norton_drivers.wiring import DeviceSettings, parse_options

CONNECTION = "can"
BITRATE = "1 Mbit/s"
OPTION_UNITS = {
    "position_range": "rad",
    "velocity_range": "rad/s",
    "torque_range": "N*m",
    **UNITS,
}


def open_amplifier(settings: DeviceSettings, link: Link) -> RobStride:
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return RobStride(settings, parse_options(RobStrideOptions, settings), link.can_port(settings), link)
