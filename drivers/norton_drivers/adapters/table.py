"""Every interface of python-can by its name: checked, opened, and complained about in one sentence with the remedy."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from ipaddress import ip_address

import can

from norton_drivers.adapters.adapter import Adapter, Health, Mistake, own_health, quiet_python_can
from norton_drivers.adapters.serial_line import serial_mend
from norton_drivers.adapters.socketcan import SOCKETCAN
from norton_drivers.adapters.vendors import GS_USB, KVASER, PCAN
from norton_drivers.errors import ConnectionFailedError, reason_of
from norton_drivers.wiring import CanBusSettings

# Lawicel's S0 to S8, and S9 as several firmwares have it; for the data of CAN FD frames CANable 2.0's Y2 and Y5.
# Source: python-can, slcanBus; normaldotcom/canable2-fw, README.
BITRATES = (10_000, 20_000, 50_000, 83_300, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)


DATA_BITRATES = (2_000_000, 5_000_000)


def _slcan_mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if settings.fd and settings.data_bitrate_bit_s not in DATA_BITRATES:
        yield "data_bitrate", "slcan adapters with CAN FD know two: write 2 Mbit/s or 5 Mbit/s"
    if settings.bitrate_bit_s not in BITRATES and "timing" not in settings.options:
        known = ", ".join(f"{bitrate // 1000}" for bitrate in BITRATES)
        yield "bitrate", f"{settings.bitrate_bit_s} bit/s is none that slcan adapters know: {known} kbit/s"


def _slcan_open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.mended_buses import SteadySlcanBus  # noqa: PLC0415  (only this interface needs it)

    own = {"bitrate": settings.bitrate_bit_s, "data_bitrate": settings.data_bitrate_bit_s}
    return SteadySlcanBus(settings.channel, **{**own, **settings.options})


def _slcan_mend(_settings: CanBusSettings, error: Exception) -> str:
    return serial_mend(error)


SLCAN = Adapter(
    channel='the serial port, e.g. "/dev/serial/by-id/usb-..."',
    options=("tty_baudrate", "timing", "sleep_after_open", "rtscts", "listen_only", "timeout"),
    fd=True,
    mistakes=_slcan_mistakes,
    open=_slcan_open,
    mend=_slcan_mend,
    health=own_health,
)


def _fdcanusb_open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.fdcanusb import FdcanusbBus  # noqa: PLC0415  (only this interface needs it)

    data_bit_s = settings.data_bitrate_bit_s or settings.bitrate_bit_s
    return FdcanusbBus(settings.channel, settings.bitrate_bit_s, data_bit_s, **settings.options)


FDCANUSB = Adapter(
    channel='the serial port, e.g. "/dev/serial/by-id/usb-mjbots_fdcanusb_..."',
    options=("baudrate", "uart"),
    fd=True,
    open=_fdcanusb_open,
    mend=_slcan_mend,
    health=own_health,
)


def _socketcand_mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not isinstance(settings.options.get("host"), str):
        yield "options", 'socketcand needs the server\'s host; add options = { host = "192.168.1.5", port = 29536 }'
    elif not isinstance(settings.options.get("port"), int):
        yield "options", "socketcand needs the server's port as a whole number; 29536 is its default"


def _socketcand_open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.mended_buses import SteadySocketcandBus  # noqa: PLC0415  (only this interface needs it)

    options = {key: value for key, value in settings.options.items() if key != "tcp_tune"}  # what it tunes is on here
    return SteadySocketcandBus(settings.channel, bitrate=settings.bitrate_bit_s, **options)


def _socketcand_mend(settings: CanBusSettings, _error: Exception) -> str:
    return (
        f"start the server there, `socketcand -i {settings.channel} -l eth0`, with the link up, and see that no "
        "firewall stands between"
    )


SOCKETCAND = Adapter(
    channel='the bus as the server names it, e.g. "can0"',
    install="socketcand on the computer that has the bus",
    options=("host", "port", "tcp_tune", "can_filters"),
    mistakes=_socketcand_mistakes,
    open=_socketcand_open,
    mend=_socketcand_mend,
    health=own_health,
    linux_error_frames=True,
)


# Commands of drives do not go out on a network that nobody named; nor does a frame wait for the network card, which on
# a virtual machine takes longer than all the rest of sending it.
ON_THIS_COMPUTER = 0


def _udp_multicast_mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    try:
        multicast = ip_address(settings.channel).is_multicast
    except ValueError:
        multicast = False
    if not multicast:
        yield "channel", f'"{settings.channel}" must be a multicast address, e.g. "239.74.163.2"'


def _udp_multicast_open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.quiet_udp import QuietUdpBus  # noqa: PLC0415  (msgpack is needed by this interface alone)

    own = {"bitrate": settings.bitrate_bit_s, "hop_limit": ON_THIS_COMPUTER, "fd": settings.fd}
    return QuietUdpBus(settings.channel, **{**own, **settings.options})


def _udp_multicast_mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, ImportError):
        return "install msgpack: `pip install msgpack`"
    return "the channel must be a multicast address, e.g. 239.74.163.2, and the network must be up"


UDP_MULTICAST = Adapter(
    channel='a multicast address, e.g. "239.74.163.2"',
    options=("port", "hop_limit", "fd"),
    fd=True,
    mistakes=_udp_multicast_mistakes,
    open=_udp_multicast_open,
    mend=_udp_multicast_mend,
    health=own_health,
    linux_error_frames=True,
)


ADAPTERS: Mapping[str, Adapter] = {
    "socketcan": SOCKETCAN,
    "slcan": SLCAN,
    "fdcanusb": FDCANUSB,
    "gs_usb": GS_USB,
    "pcan": PCAN,
    "kvaser": KVASER,
    "socketcand": SOCKETCAND,
    "udp_multicast": UDP_MULTICAST,
    "virtual": Adapter(channel="any name; reaches no further than this one program", fd=True, linux_error_frames=True),
}
INTERFACES = frozenset(can.VALID_INTERFACES) | frozenset(ADAPTERS)
UNKNOWN = Adapter(fd=True)  # whether it is will show
_KEYS_OF_THE_SECTION = ("interface", "channel", "bitrate")


@dataclass(frozen=True)
class OpenBus:
    """A bus, its state, and how its frames are read."""

    bus: can.BusABC
    health: Health
    adapter: Adapter


def mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    """What is wrong with the settings, as far as can be told without opening anything."""
    adapter = ADAPTERS.get(settings.interface, UNKNOWN)
    if settings.fd and not adapter.fd:
        able = ", ".join(name for name, each in ADAPTERS.items() if each.fd)
        yield "fd", f"{settings.interface} cannot carry CAN FD frames here; take another interface: {able}"
    if settings.options.get("receive_own_messages"):
        yield "options", "receive_own_messages would let the bench take its own frames for a device's; leave it out"
    for key in settings.options:
        if key in _KEYS_OF_THE_SECTION:
            yield "options", f"{key} is a key of the section itself; write it there"
        elif key not in adapter.options and (meant := get_close_matches(key, adapter.options, n=1, cutoff=0.75)):
            yield "options", f'{key} is no option of {settings.interface}; did you mean "{meant[0]}"?'
    yield from adapter.mistakes(settings)


def remarks(settings: CanBusSettings) -> Iterator[str]:
    """What works now on this machine, but may not for long, with the remedy; sentences without the bus' name."""
    yield from ADAPTERS.get(settings.interface, UNKNOWN).remarks(settings)


def open_bus(settings: CanBusSettings) -> OpenBus:
    """Raises ConnectionFailedError, in one sentence with the remedy."""
    place = f"[bus.{settings.name}] {settings.interface} on {settings.channel}"
    if settings.interface not in INTERFACES:
        known = ", ".join(sorted(INTERFACES))
        raise ConnectionFailedError(f"{place}: python-can has no such interface; known: {known}")
    adapter = ADAPTERS.get(settings.interface, UNKNOWN)
    with quiet_python_can():
        if obstacle := adapter.obstacle(settings):
            raise ConnectionFailedError(f"{place}: {obstacle}")
        try:
            bus = adapter.open(settings)
        except Exception as error:  # python-can's interfaces raise whatever their libraries do
            raise ConnectionFailedError(
                f"{place}: cannot open it ({reason_of(error)}); {adapter.mend(settings, error)}"
            ) from error
    return OpenBus(bus, adapter.health(bus), adapter)
