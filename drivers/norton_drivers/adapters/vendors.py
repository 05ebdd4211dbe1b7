"""Makers' own USB adapters, through the makers' libraries or libusb: gs_usb (candleLight and its kin), kvaser, pcan.

On Linux the kernel drives most of them too (socketcan).
"""

import errno
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import can

from norton_drivers.adapters.adapter import Adapter, Mistake, as_python_can_does
from norton_drivers.wiring import CanBusSettings

# CAN FD through CANlib and PCAN-Basic needs the whole bit timing: with a clock that both know, and sample points at
# four fifths of a bit unless the rig file has others.
_CLOCK_HZ = 80_000_000
_SAMPLE_POINTS = {"sample_point": 80.0, "data_sample_point": 80.0}
_OWN_TIMING = {"timing", "f_clock", "f_clock_mhz", "tseg1"}


def _open_with_timing(settings: CanBusSettings) -> can.BusABC:
    """Raises ValueError for bit rates that the clock cannot be divided into."""
    if not settings.fd or _OWN_TIMING & set(settings.options):
        return as_python_can_does(settings)
    points = {name: float(settings.options.get(name, share)) for name, share in _SAMPLE_POINTS.items()}
    timing = can.BitTimingFd.from_sample_point(
        f_clock=_CLOCK_HZ,
        nom_bitrate=settings.bitrate_bit_s,
        nom_sample_point=points["sample_point"],
        data_bitrate=settings.data_bitrate_bit_s or settings.bitrate_bit_s,
        data_sample_point=points["data_sample_point"],
    )
    others = {name: value for name, value in settings.options.items() if name not in _SAMPLE_POINTS}
    return as_python_can_does(replace(settings, options=others), timing=timing)


def _gs_usb_mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not settings.channel.isdecimal() and not {"index", "bus", "address"} & set(settings.options):
        yield "channel", f'"{settings.channel}" must be the number of the adapter: "0" is the first one found'


def _gs_usb_open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.mended_buses import ThreadedBus  # noqa: PLC0415  (only this interface needs it)

    channel = int(settings.channel) if settings.channel.isdecimal() else settings.channel
    # Its reader waits a millisecond at least, and every frame that is sent comes back, marked as such.
    return ThreadedBus(as_python_can_does(settings, channel=channel))


def _gs_usb_mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, (ImportError, can.CanInterfaceNotImplementedError)):
        return (
            'install its library: `pip install "python-can[gs_usb]"`; on Linux the kernel drives these adapters: use '
            'interface = "socketcan"'
        )
    if "NoBackend" in type(error).__name__:
        return "install libusb, e.g. `sudo apt install libusb-1.0-0`"
    if getattr(error, "errno", None) in (errno.EACCES, errno.EPERM):
        return 'this user may not open it: add a udev rule ATTR{idVendor}=="1d50", ATTR{idProduct}=="606f", MODE="0666"'
    if getattr(error, "errno", None) == errno.EBUSY:
        return 'the kernel\'s driver has it: use interface = "socketcan"'
    return "is it plugged in? `norton-bench devices` lists what is"


GS_USB = Adapter(
    channel='the number of the adapter, "0" for the first one found',
    install='`pip install "python-can[gs_usb]"` and libusb',
    options=("index", "bus", "address", "can_filters"),
    mistakes=_gs_usb_mistakes,
    open=_gs_usb_open,
    mend=_gs_usb_mend,
    linux_error_frames=True,
)


@dataclass
class KvaserHealth:
    """kvaser: Kvaser's adapters through their CANlib. On Linux the kernel drives most of them too (socketcan).

    CANlib's own count of overruns; ``bus`` is python-can's ``KvaserBus``. Error frames come among the others.
    """

    bus: Any
    _counts: dict[str, int] = field(default_factory=dict)

    def ask(self) -> None:
        self._counts["receive overrun"] = int(self.bus.get_stats().overruns)

    def troubles(self) -> Mapping[str, int]:
        return dict(self._counts)

    @property
    def off_bus(self) -> str | None:
        return None  # python-can does not pass CANlib's bus status on


def _kvaser_mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not settings.channel.isdecimal():
        yield "channel", f'"{settings.channel}" must be CANlib\'s number of the channel: "0" is the first'


def _kvaser_mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, (ImportError, NameError, NotImplementedError, can.CanInterfaceNotImplementedError)):
        return (
            "install Kvaser's CANlib (linuxcan) from kvaser.com; on Linux the kernel drives these adapters without it: "
            'use interface = "socketcan"'
        )
    return "is it plugged in, and is this its channel's number? `norton-bench devices` lists what is there"


KVASER = Adapter(
    channel='CANlib\'s number of the channel, "0" for the first',
    install="Kvaser's CANlib",
    fd=True,
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
        *_SAMPLE_POINTS,
    ),
    mistakes=_kvaser_mistakes,
    open=_open_with_timing,
    mend=_kvaser_mend,
    health=KvaserHealth,
)


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
    """pcan: PEAK-System's adapters through their PCAN-Basic library. On Linux the kernel drives them too (socketcan).

    Counts each bit of the status as it rises; ``bus`` is python-can's ``PcanBus``.
    """

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


def _pcan_mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not _CHANNEL.fullmatch(settings.channel) and "device_id" not in settings.options:
        yield "channel", f'"{settings.channel}" is no PCAN channel; write it like "PCAN_USBBUS1"'
    if settings.bitrate_bit_s not in BITRATES and not (settings.fd or {"timing", "fd"} & set(settings.options)):
        known = ", ".join(f"{bitrate // 1000}" for bitrate in BITRATES)
        yield "bitrate", f"{settings.bitrate_bit_s} bit/s is none that PCAN-Basic knows: {known} kbit/s"


def _pcan_mend(_settings: CanBusSettings, error: Exception) -> str:
    if isinstance(error, (ImportError, can.CanInterfaceNotImplementedError)) or "not found" in str(error):
        return (
            "install PEAK's PCAN-Basic library from peak-system.com; on Linux the kernel drives these adapters without "
            'it: use interface = "socketcan"'
        )
    return "is it plugged in, and does no other program have it open? `norton-bench devices` lists what is there"


PCAN = Adapter(
    channel='PEAK\'s name of it, e.g. "PCAN_USBBUS1"',
    install="PEAK's PCAN-Basic library",
    fd=True,
    options=(
        "device_id",
        "state",
        "timing",
        "fd",
        "auto_reset",
        "f_clock",
        "f_clock_mhz",
        "can_filters",
        *_SAMPLE_POINTS,
    ),
    mistakes=_pcan_mistakes,
    open=_open_with_timing,
    mend=_pcan_mend,
    health=PcanHealth,
)
