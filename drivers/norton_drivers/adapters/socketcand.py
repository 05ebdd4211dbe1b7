"""socketcand: the CAN bus of another computer, over the network."""

from collections.abc import Iterator

import can

from norton_drivers.adapters.adapter import Adapter, Mistake, own_health
from norton_drivers.wiring import CanBusSettings


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not isinstance(settings.options.get("host"), str):
        yield "options", 'socketcand needs the server\'s host; add options = { host = "192.168.1.5", port = 29536 }'
    elif not isinstance(settings.options.get("port"), int):
        yield "options", "socketcand needs the server's port as a whole number; 29536 is its default"


def _open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.steady_socketcand import SteadySocketcandBus  # noqa: PLC0415  (only this interface needs it)

    options = {key: value for key, value in settings.options.items() if key != "tcp_tune"}  # what it tunes is on here
    return SteadySocketcandBus(settings.channel, bitrate=settings.bitrate_bit_s, **options)


def _mend(settings: CanBusSettings, _error: Exception) -> str:
    return (
        f"start the server there, `socketcand -i {settings.channel} -l eth0`, with the link up, and see that no "
        "firewall stands between"
    )


SOCKETCAND = Adapter(
    channel='the bus as the server names it, e.g. "can0"',
    install="socketcand on the computer that has the bus",
    options=("host", "port", "tcp_tune", "can_filters"),
    mistakes=_mistakes,
    open=_open,
    mend=_mend,
    health=own_health,
    linux_error_frames=True,
)
