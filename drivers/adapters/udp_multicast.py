"""udp_multicast: a bus between programs, on one computer or several. Every datagram is a frame."""

from collections.abc import Iterator
from ipaddress import ip_address

import can

from drivers.adapters.adapter import Adapter, Mistake, own_health
from drivers.wiring import CanBusSettings


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    try:
        multicast = ip_address(settings.channel).is_multicast
    except ValueError:
        multicast = False
    if not multicast:
        yield "channel", f'"{settings.channel}" must be a multicast address, e.g. "239.74.163.2"'


def _open(settings: CanBusSettings) -> can.BusABC:
    from drivers.adapters.quiet_udp import QuietUdpBus  # noqa: PLC0415  (msgpack is needed by this interface alone)

    return QuietUdpBus(settings.channel, **{"bitrate": settings.bitrate_bit_s, **settings.options})


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
