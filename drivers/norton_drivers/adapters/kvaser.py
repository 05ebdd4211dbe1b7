"""kvaser: Kvaser's adapters through their CANlib. On Linux the kernel drives most of them too (socketcan)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import can

from norton_drivers.adapters.adapter import Adapter, Mistake
from norton_drivers.wiring import CanBusSettings


@dataclass
class KvaserHealth:
    """CANlib's own count of overruns; ``bus`` is python-can's ``KvaserBus``. Error frames come among the others."""

    bus: Any
    _counts: dict[str, int] = field(default_factory=dict)

    def ask(self) -> None:
        self._counts["receive overrun"] = int(self.bus.get_stats().overruns)

    def troubles(self) -> Mapping[str, int]:
        return dict(self._counts)

    @property
    def off_bus(self) -> str | None:
        return None  # python-can does not pass CANlib's bus status on


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not settings.channel.isdecimal():
        yield "channel", f'"{settings.channel}" must be CANlib\'s number of the channel: "0" is the first'


def _mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, (ImportError, NameError, NotImplementedError, can.CanInterfaceNotImplementedError)):
        return (
            "install Kvaser's CANlib (linuxcan) from kvaser.com; on Linux the kernel drives these adapters without it: "
            'use interface = "socketcan"'
        )
    return "is it plugged in, and is this its channel's number? `norton-bench devices` lists what is there"


KVASER = Adapter(
    channel='CANlib\'s number of the channel, "0" for the first',
    install="Kvaser's CANlib",
    options=(
        "timing",
        "accept_virtual",
        "tseg1",
        "tseg2",
        "sjw",
        "no_samp",
        "driver_mode",
        "single_handle",
        "fd",
        "fd_non_iso",
        "exclusive",
        "override_exclusive",
        "data_bitrate",
        "no_init_access",
        "can_filters",
    ),
    mistakes=_mistakes,
    mend=_mend,
    health=KvaserHealth,
)
