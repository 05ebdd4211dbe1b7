"""socketcan: any adapter with a driver in the Linux kernel (gs_usb, PEAK, Kvaser, SPI and on-board controllers).

The kernel sets the bitrate, not the program that opens the bus, so that the two are compared here.
"""

import json
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import can

from norton_drivers.adapters.adapter import Adapter, bus_arguments
from norton_drivers.wiring import CanBusSettings

NETWORK = Path("/sys/class/net")
_CAN_LINK = "280"  # ARPHRD_CAN, Linux' <linux/if_arp.h>
_UP = 0x1  # IFF_UP, <linux/if.h>
_CLASSICAL_MTU = "16"  # CAN_MTU, <linux/can.h>; that of a link with CAN FD is 72
_PATIENCE_S = 2.0
_VIRTUAL = "virtual"  # of /sys/devices/virtual/net, where links are that no adapter stands behind
QUEUE_MIN = 32  # the kernel's own is 10 frames: a millisecond of a full bus at 1 Mbit/s


def can_links(network: Path = NETWORK) -> dict[str, bool]:
    """The machine's CAN network interfaces, and whether each is up."""
    result = {link.name: link for link in network.iterdir()} if network.is_dir() else {}
    return {name: _is_up(link) for name, link in sorted(result.items()) if _read(link / "type") == _CAN_LINK}


@dataclass(frozen=True)
class KernelLink:
    """What the kernel says of a link; None for what it does not say (virtual links have no bitrate)."""

    bitrate_bit_s: int | None = None
    state: str | None = None  # "ERROR-ACTIVE", "ERROR-PASSIVE", "BUS-OFF", ...
    queue_frames: int | None = None
    data_bitrate_bit_s: int | None = None  # of CAN FD frames


def kernel_link(channel: str) -> KernelLink:
    """What ``ip`` reports; nothing where it is not installed."""
    try:
        done = subprocess.run(
            ["ip", "-details", "-json", "link", "show", channel],
            capture_output=True,
            timeout=_PATIENCE_S,
            check=True,
        )
        link = json.loads(done.stdout)[0]
        of_can = link.get("linkinfo", {}).get("info_data", {})
        bitrate_bit_s, data_bit_s = (of_can.get(each, {}).get("bitrate") for each in ("bittiming", "data_bittiming"))
        return KernelLink(bitrate_bit_s, of_can.get("state"), link.get("txqlen"), data_bit_s)
    except (OSError, subprocess.SubprocessError, ValueError, LookupError, TypeError, AttributeError):
        return KernelLink()


def _obstacle(settings: CanBusSettings) -> str | None:
    return obstacle_of(settings)


def obstacle_of(settings: CanBusSettings, network: Path = NETWORK, has_sockets: bool | None = None) -> str | None:
    """Why the link cannot be used, with the remedy."""
    if not (_kernel_has_can() if has_sockets is None else has_sockets):
        return "this kernel has no CAN sockets; `sudo modprobe can_raw`, or use another interface"
    channel, links = settings.channel, can_links(network)
    if channel not in links:
        known = ", ".join(links) or "none"
        mend = (
            f"make it: `sudo ip link add {channel} type vcan && sudo ip link set {channel} up`"
            if channel.startswith("vcan")
            else "is the adapter plugged in? see `ip link`"
        )
        return f"there is no CAN link {channel} (there is: {known}); {mend}"
    if not links[channel]:
        return f"the link is down; {bring_up(settings, network)}"
    if settings.fd and _read(network / channel / "mtu") == _CLASSICAL_MTU:
        return f"the link carries no CAN FD frames; {_set_up_anew(settings, network)}"
    return _set_up_wrongly(settings, network)


def _set_up_wrongly(settings: CanBusSettings, network: Path) -> str | None:
    """What the link was set up with that is not as the rig file has it, with the remedy."""
    link = kernel_link(settings.channel)
    if link.state == "BUS-OFF":
        return (
            "the controller has left the bus after too many errors (bus-off); check bitrate, wiring and termination, "
            f"then {_set_up_anew(settings, network)}"
        )
    for words, real, wanted in (
        ("runs", link.bitrate_bit_s, settings.bitrate_bit_s),
        ("sends data", link.data_bitrate_bit_s, settings.data_bitrate_bit_s),
    ):
        if real is not None and wanted is not None and real != wanted:
            return (
                f"the link {words} at {real} bit/s, but the rig file says {wanted}; correct the file, or "
                f"{_set_up_anew(settings, network)}"
            )
    return None


def remarks_of(settings: CanBusSettings) -> Iterator[str]:
    """What the link lacks for a fast loop, with the remedy. Virtual links queue nothing and never leave the bus."""
    link = kernel_link(settings.channel)
    if link.bitrate_bit_s is not None and link.queue_frames is not None and link.queue_frames < QUEUE_MIN:
        yield (
            f"the kernel queues {link.queue_frames} frames at most, and a bus that is busy for a moment refuses more: "
            f"`sudo ip link set {settings.channel} txqueuelen 100`"
        )


def _set_up_anew(settings: CanBusSettings, network: Path) -> str:
    return f"`sudo ip link set {settings.channel} down` and {bring_up(settings, network)}"


def bring_up(settings: CanBusSettings, network: Path = NETWORK) -> str:
    """The command that sets a link up; a virtual one has no bitrate."""
    channel = settings.channel
    if _VIRTUAL in (network / channel).resolve().parts:
        return f"`sudo ip link set {channel} up`"
    data_bit_s = settings.data_bitrate_bit_s or settings.bitrate_bit_s
    fd = f" dbitrate {data_bit_s} fd on" if settings.fd else ""
    return f"`sudo ip link set {channel} up type can bitrate {settings.bitrate_bit_s}{fd}`"


def _open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.steady_socketcan import SteadySocketcanBus  # noqa: PLC0415  (Linux alone has it)

    return SteadySocketcanBus(**bus_arguments(settings))


def _mend(settings: CanBusSettings, _error: Exception) -> str:
    return f"is it up? {bring_up(settings)}"


def _kernel_has_can() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (OSError, AttributeError):
        return False
    return True


def _is_up(link: Path) -> bool:
    flags = _read(link / "flags")
    return bool(int(flags, 16) & _UP) if flags else False


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


SOCKETCAN = Adapter(
    channel='the network interface, e.g. "can0"',
    options=("local_loopback", "fd", "can_filters", "ignore_rx_error_frames"),
    fd=True,
    obstacle=_obstacle,
    remarks=remarks_of,
    open=_open,
    mend=_mend,
    marks_own_frames=False,  # the mark means any program of this computer; the kernel keeps our own frames from us
    linux_error_frames=True,
)
