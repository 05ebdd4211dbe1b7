"""The one master of a port, and who may share it."""

from norton_drivers.codecs.half_duplex import Dialect
from norton_drivers.errors import WiringError
from norton_drivers.half_duplex.line import LineTiming
from norton_drivers.half_duplex.master import BusMaster
from norton_drivers.half_duplex.options import BusServoOptions
from norton_drivers.link import Link
from norton_drivers.wiring import DeviceSettings


def master_of(settings: DeviceSettings, options: BusServoOptions, dialect: Dialect, link: Link) -> BusMaster:
    """Made by the first servo on the port. Raises WiringError where they do not go together, ConnectionFailedError."""
    port = link.serial_port(settings, options.baud)
    timing = LineTiming(options.baud, options.latency_s)
    bus = link.shared(("half-duplex", settings.port), lambda: BusMaster(port, link, dialect, timing))
    if type(bus.dialect) is not type(dialect):
        raise WiringError(
            f"[{settings.role}] port {settings.port}: another device's servos speak another protocol there"
        )
    if bus.timing.baud != options.baud:
        raise WiringError(
            f"[{settings.role}] baud = {options.baud}, but port {settings.port} has {bus.timing.baud} for another; "
            "all servos on a line have one baud rate"
        )
    return bus
