"""Every interface of python-can by its name: checked, opened, and complained about in one sentence with the mend."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

import can

from norton_drivers.adapters.adapter import Adapter, Health, Mistake, quiet_python_can
from norton_drivers.adapters.gs_usb import GS_USB
from norton_drivers.adapters.kvaser import KVASER
from norton_drivers.adapters.pcan import PCAN
from norton_drivers.adapters.slcan import SLCAN
from norton_drivers.adapters.socketcan import SOCKETCAN
from norton_drivers.adapters.socketcand import SOCKETCAND
from norton_drivers.adapters.udp_multicast import UDP_MULTICAST
from norton_drivers.errors import ConnectionFailedError, reason_of
from norton_drivers.wiring import CanBusSettings

ADAPTERS: Mapping[str, Adapter] = {
    "socketcan": SOCKETCAN,
    "slcan": SLCAN,
    "gs_usb": GS_USB,
    "pcan": PCAN,
    "kvaser": KVASER,
    "socketcand": SOCKETCAND,
    "udp_multicast": UDP_MULTICAST,
    "virtual": Adapter(channel="any name; reaches no further than this one program", linux_error_frames=True),
}
UNKNOWN = Adapter()
_KEYS_OF_THE_SECTION = ("interface", "channel", "bitrate")


@dataclass(frozen=True)
class OpenBus:
    """A bus, how it fares, and how its frames are to be read."""

    bus: can.BusABC
    health: Health
    adapter: Adapter


def mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    """What is wrong with the settings, as far as can be told without opening anything."""
    adapter = ADAPTERS.get(settings.interface, UNKNOWN)
    if settings.options.get("receive_own_messages"):
        yield "options", "receive_own_messages would let the bench take its own frames for a device's; leave it out"
    for key in settings.options:
        if key in _KEYS_OF_THE_SECTION:
            yield "options", f"{key} is a key of the section itself; write it there"
        elif key not in adapter.options and (meant := get_close_matches(key, adapter.options, n=1, cutoff=0.75)):
            yield "options", f'{key} is no option of {settings.interface}; did you mean "{meant[0]}"?'
    yield from adapter.mistakes(settings)


def open_bus(settings: CanBusSettings) -> OpenBus:
    """Raises ConnectionFailedError, in one sentence with the mend."""
    place = f"[bus.{settings.name}] {settings.interface} on {settings.channel}"
    if settings.interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
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
