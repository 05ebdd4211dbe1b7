"""pcan: PEAK-System's adapters through their PCAN-Basic library. On Linux the kernel drives them too (socketcan)."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import can

from norton_drivers.adapters.adapter import Adapter, Mistake
from norton_drivers.wiring import CanBusSettings

# python-can takes 500 kbit/s for a bitrate that it does not know. Source: python-can, PCAN_BITRATES.
BITRATES = tuple(thousands * 1000 for thousands in (5, 10, 20, 33, 47, 50, 83, 95, 100, 125, 250, 500, 800, 1000))
_CHANNEL = re.compile(r"PCAN_(ISA|DNG|PCI|USB|PCC|LAN)BUS\d+")
_BUS_OFF = 0x10
# Source: PCAN-Basic documentation, "PCAN_ERROR_ codes", as python-can's interfaces/pcan/basic.py has them.
_STATUS_WORDS = (
    (0x00001, "send buffer of the controller full"),
    (0x00002, "receive overrun"),
    (0x00004, "error warning level reached"),
    (0x00008, "error warning level reached (heavy)"),
    (_BUS_OFF, "bus-off"),
    (0x00040, "receive queue overrun, frames were lost"),
    (0x00080, "send queue full"),
    (0x40000, "error-passive"),
)


@dataclass
class PcanHealth:
    """Counts each bit of the status as it rises; ``bus`` is python-can's ``PcanBus``."""

    bus: Any
    _status: int = 0
    _counts: dict[str, int] = field(default_factory=dict)

    def ask(self) -> None:
        status = int(self.bus.status())
        risen, self._status = status & ~self._status, status
        for bit, words in _STATUS_WORDS:
            if risen & bit:
                self._counts[words] = self._counts.get(words, 0) + 1

    def troubles(self) -> Mapping[str, int]:
        return dict(self._counts)

    @property
    def off_bus(self) -> str | None:
        return "PCAN-Basic says bus-off" if self._status & _BUS_OFF else None


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not _CHANNEL.fullmatch(settings.channel) and "device_id" not in settings.options:
        yield "channel", f'"{settings.channel}" is no PCAN channel; write it like "PCAN_USBBUS1"'
    if settings.bitrate_bit_s not in BITRATES and not {"timing", "fd"} & set(settings.options):
        known = ", ".join(f"{bitrate // 1000}" for bitrate in BITRATES)
        yield "bitrate", f"{settings.bitrate_bit_s} bit/s is none that PCAN-Basic knows: {known} kbit/s"


def _mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, (ImportError, can.CanInterfaceNotImplementedError)) or "not found" in str(error):
        return (
            "install PEAK's PCAN-Basic library from peak-system.com; on Linux the kernel drives these adapters without "
            'it: use interface = "socketcan"'
        )
    return "is it plugged in, and does no other program have it open? `norton-bench devices` lists what is there"


PCAN = Adapter(
    channel='PEAK\'s name of it, e.g. "PCAN_USBBUS1"',
    install="PEAK's PCAN-Basic library",
    options=("device_id", "state", "timing", "fd", "auto_reset", "f_clock", "f_clock_mhz", "can_filters"),
    mistakes=_mistakes,
    mend=_mend,
    health=PcanHealth,
)
