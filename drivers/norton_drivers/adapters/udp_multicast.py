"""udp_multicast: a bus between programs, on one computer or, with a ``hop_limit``, several. A datagram is a frame."""

from collections.abc import Iterator
from ipaddress import ip_address

import can

from norton_drivers.adapters.adapter import Adapter, Mistake, own_health
from norton_drivers.wiring import CanBusSettings

# Commands of drives do not go out on a network that nobody named; nor does a frame wait for the network card, which on
# a virtual machine takes longer than all the rest of sending it.
ON_THIS_COMPUTER = 0


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    try:
        multicast = ip_address(settings.channel).is_multicast
    except ValueError:
        multicast = False
    if not multicast:
        yield "channel", f'"{settings.channel}" must be a multicast address, e.g. "239.74.163.2"'


def _open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.quiet_udp import QuietUdpBus  # noqa: PLC0415  (msgpack is needed by this interface alone)

    own = {"bitrate": settings.bitrate_bit_s, "hop_limit": ON_THIS_COMPUTER}
    return QuietUdpBus(settings.channel, **{**own, **settings.options})


def _mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, ImportError):
        return "install msgpack: `pip install msgpack`"
    return "the channel must be a multicast address, e.g. 239.74.163.2, and the network must be up"


UDP_MULTICAST = Adapter(
    channel='a multicast address, e.g. "239.74.163.2"',
    options=("port", "hop_limit", "fd"),
    mistakes=_mistakes,
    open=_open,
    mend=_mend,
    health=own_health,
    linux_error_frames=True,
)
