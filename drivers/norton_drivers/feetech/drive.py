"""What the program asks of the driver of Feetech servos: its units, how one is opened, what a line carries."""

from collections.abc import Iterator, Sequence

from norton_drivers.codecs import feetech as protocol
from norton_drivers.feetech.options import FeetechOptions
from norton_drivers.feetech.servo import FeetechServo, share_of
from norton_drivers.feetech.table import IDENTITY_LENGTH, MODELS
from norton_drivers.finding import Found, answers_to
from norton_drivers.half_duplex.line import LineTiming, check_line
from norton_drivers.half_duplex.sharing import master_of
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort
from norton_drivers.wiring import DeviceSettings, parse_options

FIRST_NODES = range(21)
ONE_ANSWERS_NS = 5_000_000

CONNECTION = "serial"
OPTION_UNITS = {"return_delay": "s", "latency": "s", "stall_torque": "N*m", "loop_period": "s"}


def open_amplifier(settings: DeviceSettings, link: Link) -> FeetechServo:
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(FeetechOptions, settings)
    dialect = link.shared(("feetech", settings.port), lambda: protocol.Dialect(reads_together=options.kind.together))
    return FeetechServo(settings, options, master_of(settings, options, dialect, link), link)


def find(port: SerialPort, link: Link) -> Iterator[Found]:
    """Those that speak this protocol, of the first ids alone. Raises ConnectionFailedError."""
    dialect = protocol.Dialect()
    answers = dialect.answers()
    for node in FIRST_NODES:
        for answer in answers.feed(answers_to(dialect.read(node, 0, IDENTITY_LENGTH), port, link, ONE_ANSWERS_NS)):
            if len(answer.data) == IDENTITY_LENGTH:
                yield _found(answer.node, answer.data)


def _found(node: int, told: bytes) -> Found:
    numbers = [int.from_bytes(told[3:5], order) for order in ("little", "big")]
    model = next((model for model in MODELS.values() if model.number in numbers), None)
    if model is None:
        return Found("a servo of another model, which may be a Dynamixel of Protocol 1.0", {"node": node})
    return Found(f"a Feetech servo ({model.name})", {"node": node, "type": model.name})


def check_port(settings: Sequence[DeviceSettings], tick_ns: int) -> None:
    """Whether the line carries all of these servos in every tick. Raises WiringError."""
    options = [parse_options(FeetechOptions, each) for each in settings]
    timing = LineTiming(options[0].baud, max(each.latency_s for each in options))
    dialect = protocol.Dialect(reads_together=all(each.kind.together for each in options))
    check_line(dialect, timing, [share_of(each) for each in options], settings, tick_ns)
