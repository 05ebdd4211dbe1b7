"""What the program asks of the driver of moteus controllers: its units, and how one is opened."""

from norton_drivers.errors import WiringError
from norton_drivers.link import Link
from norton_drivers.moteus.controller import MoteusController
from norton_drivers.moteus.options import MoteusOptions
from norton_drivers.moteus.recognition import answers, probes, recognise  # noqa: F401  (found here by who looks for them)
from norton_drivers.wiring import DeviceSettings, parse_options

CONNECTION = "can"
BITRATE = "1 Mbit/s"
DATA_BITRATE = "5 Mbit/s"
OPTION_UNITS = {
    "watchdog": "s",
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "greatest_torque": "N*m",
    "loop_period": "s",
    "velocity_window": "s",
}


def open_amplifier(settings: DeviceSettings, link: Link) -> MoteusController:
    """Raises WiringError for a wrong option or a bus without CAN FD, ConnectionFailedError for the bus."""
    options, port = parse_options(MoteusOptions, settings), link.can_port(settings)
    if not port.fd:
        raise WiringError(
            f'[{settings.role}] driver = "moteus" sends CAN FD frames; write fd = true and '
            f'data_bitrate = "{DATA_BITRATE}" in [bus.{port.name}]'
        )
    return MoteusController(settings, options, port, link)
