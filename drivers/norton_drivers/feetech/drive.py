"""What the program asks of the driver of Feetech servos: its units, how one is opened, what a line carries."""

from collections.abc import Iterator, Sequence

from norton_drivers.codecs import feetech as protocol
from norton_drivers.feetech.options import FeetechOptions
from norton_drivers.feetech.servo import FeetechServo, share_of
from norton_drivers.feetech.table import MODELS
from norton_drivers.half_duplex.finding import Found, dynamixels, feetechs
from norton_drivers.half_duplex.line import LineTiming, check_line
from norton_drivers.half_duplex.sharing import master_of
from norton_drivers.link import Link
from norton_drivers.wiring import DeviceSettings, parse_options

CONNECTION = "serial"
OPTION_UNITS = {"return_delay": "s", "latency": "s", "stall_torque": "N*m", "loop_period": "s"}


def open_amplifier(settings: DeviceSettings, link: Link) -> FeetechServo:
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(FeetechOptions, settings)
    dialect = link.shared(("feetech", settings.port), lambda: protocol.Dialect(reads_together=options.kind.together))
    return FeetechServo(settings, options, master_of(settings, options, dialect, link), link)


def find(settings: DeviceSettings, link: Link) -> Iterator[Found]:
    """Who answers at the rate of ``settings``. Raises ConnectionFailedError."""
    port = link.serial_port(settings, parse_options(FeetechOptions, settings).baud)
    for node, told in feetechs(port, link):
        numbers = [int.from_bytes(told[3:5], order) for order in ("little", "big")]
        model = next((model for model in MODELS.values() if model.number in numbers), None)
        known = {} if model is None else {"type": model.name}
        yield Found(f"a Feetech servo ({model.name if model else 'of another model'})", {"node": node, **known})
    for node, _ in dynamixels(port, link):
        yield Found(f"a Dynamixel with id {node} that speaks Protocol 2.0")


def check_port(settings: Sequence[DeviceSettings], tick_ns: int) -> None:
    """Whether the line carries all of these servos in every tick. Raises WiringError."""
    options = [parse_options(FeetechOptions, each) for each in settings]
    timing = LineTiming(options[0].baud, max(each.latency_s for each in options))
    dialect = protocol.Dialect(reads_together=all(each.kind.together for each in options))
    check_line(dialect, timing, [share_of(each) for each in options], settings, tick_ns)
