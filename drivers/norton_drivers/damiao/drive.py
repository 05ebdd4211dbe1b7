"""What the program asks of the driver of Damiao motors: its units, how one is opened, and how one is known."""

from norton_drivers.damiao.messages import answers, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.damiao.motor import Damiao
from norton_drivers.damiao.options import DamiaoOptions
from norton_drivers.link import Link
from norton_drivers.spoken_to.options import UNITS
from norton_drivers.wiring import DeviceSettings, parse_options

CONNECTION = "can"
BITRATE = "1 Mbit/s"
OPTION_UNITS = {
    "position_range": "rad",
    "velocity_range": "rad/s",
    "torque_range": "N*m",
    "velocity_bandwidth": "Hz",
    **{name: unit for name, unit in UNITS.items() if name not in ("loop_period", "velocity_window")},
}


def open_amplifier(settings: DeviceSettings, link: Link) -> Damiao:
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return Damiao(settings, parse_options(DamiaoOptions, settings), link.can_port(settings), link)
