"""What the program asks of the driver of Dynamixel X servos: its units, how one is opened, what a line carries."""

from collections.abc import Iterator, Sequence

from norton_drivers.codecs import dynamixel as protocol
from norton_drivers.dynamixel import table
from norton_drivers.dynamixel.options import DynamixelOptions
from norton_drivers.dynamixel.servo import DynamixelServo, share_of
from norton_drivers.finding import Found, answers_to
from norton_drivers.half_duplex.line import LineTiming, check_line
from norton_drivers.half_duplex.sharing import master_of
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort
from norton_drivers.wiring import DeviceSettings, parse_options

# All answer a broadcast one after another, by their ids; at 57600 baud this is enough for the first forty.
ALL_ANSWER_NS = 150_000_000

CONNECTION = "serial"
OPTION_UNITS = {
    "return_delay": "s",
    "latency": "s",
    "torque_constant": "N*m/A",
    "stall_torque": "N*m",
    "greatest_current": "A",
    "loop_period": "s",
    "watchdog": "s",
}


def open_amplifier(settings: DeviceSettings, link: Link) -> DynamixelServo:
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(DynamixelOptions, settings)
    dialect = link.shared(("dynamixel", settings.port), protocol.Dialect)
    bus = master_of(settings, options, dialect, link)
    return DynamixelServo(settings, options, bus, dialect, link)


def find(port: SerialPort, link: Link) -> Iterator[Found]:
    """Those that speak Protocol 2.0. Raises ConnectionFailedError."""
    dialect = protocol.Dialect()
    heard = answers_to(dialect.ping(protocol.BROADCAST), port, link, ALL_ANSWER_NS)
    for answer in dialect.answers().feed(heard):
        if len(answer.data) == 3:
            name = table.model_in_words(int.from_bytes(answer.data[:2], "little"))
            yield Found(f"a Dynamixel ({name})", {"node": answer.node, "type": name})


def check_port(settings: Sequence[DeviceSettings], tick_ns: int) -> None:
    """Whether the line carries all of these servos in every tick. Raises WiringError."""
    options = [parse_options(DynamixelOptions, each) for each in settings]
    timing = LineTiming(options[0].baud, max(each.latency_s for each in options))
    check_line(protocol.Dialect(), timing, [share_of(each) for each in options], settings, tick_ns)
