"""socketcan: any adapter with a driver in the Linux kernel (gs_usb, PEAK, Kvaser, SPI and on-board controllers).

The kernel sets the bitrate, not the program that opens the bus, so that the two are compared here.
"""

import json
import socket
import subprocess
from pathlib import Path

from norton_drivers.adapters.adapter import Adapter
from norton_drivers.wiring import CanBusSettings

NETWORK = Path("/sys/class/net")
_CAN_LINK = "280"  # ARPHRD_CAN, Linux' <linux/if_arp.h>
_UP = 0x1  # IFF_UP, <linux/if.h>
_CLASSICAL_MTU = "16"  # CAN_MTU, <linux/can.h>; that of a link with CAN FD is 72
_PATIENCE_S = 2.0


def can_links(network: Path = NETWORK) -> dict[str, bool]:
    """The machine's CAN network interfaces, and whether each is up."""
    result = {link.name: link for link in network.iterdir()} if network.is_dir() else {}
    return {name: _is_up(link) for name, link in sorted(result.items()) if _read(link / "type") == _CAN_LINK}


def real_bitrate(channel: str, timing: str = "bittiming") -> int | None:
    """What the kernel has set on a link [bit/s], for the data of CAN FD frames with ``timing = "data_bittiming"``; None
    where nobody can say (virtual links have none)."""
    try:
        done = subprocess.run(
            ["ip", "-details", "-json", "link", "show", channel],
            capture_output=True,
            timeout=_PATIENCE_S,
            check=True,
        )
        return int(json.loads(done.stdout)[0]["linkinfo"]["info_data"][timing]["bitrate"])
    except (OSError, subprocess.SubprocessError, ValueError, LookupError, TypeError):
        return None


def _obstacle(settings: CanBusSettings) -> str | None:
    return obstacle_of(settings)


def obstacle_of(settings: CanBusSettings, network: Path = NETWORK, has_sockets: bool | None = None) -> str | None:
    """Why the link cannot be used, with the remedy."""
    if not (_kernel_has_can() if has_sockets is None else has_sockets):
        return "this kernel has no CAN sockets; `sudo modprobe can_raw`, or use another interface"
    links = can_links(network)
    if settings.channel not in links:
        known = ", ".join(links) or "none"
        return f"there is no CAN link {settings.channel} (there is: {known}); is the adapter plugged in? see `ip link`"
    if not links[settings.channel]:
        return f"the link is down; {_bring_up(settings)}"
    if settings.fd and _read(network / settings.channel / "mtu") == _CLASSICAL_MTU:
        return f"the link carries no CAN FD frames; {_set_up_anew(settings)}"
    for words, timing, wanted in (
        ("runs", "bittiming", settings.bitrate_bit_s),
        ("sends data", "data_bittiming", settings.data_bitrate_bit_s),
    ):
        real = None if wanted is None else real_bitrate(settings.channel, timing)
        if real is not None and real != wanted:
            return (
                f"the link {words} at {real} bit/s, but the rig file says {wanted}; correct the file, or "
                f"{_set_up_anew(settings)}"
            )
    return None


def _set_up_anew(settings: CanBusSettings) -> str:
    return f"`sudo ip link set {settings.channel} down` and {_bring_up(settings)}"


def _bring_up(settings: CanBusSettings) -> str:
    data_bit_s = settings.data_bitrate_bit_s or settings.bitrate_bit_s
    fd = f" dbitrate {data_bit_s} fd on" if settings.fd else ""
    return f"`sudo ip link set {settings.channel} up type can bitrate {settings.bitrate_bit_s}{fd}`"


def _mend(settings: CanBusSettings, _error: Exception) -> str:
    return f"is it up? {_bring_up(settings)}"


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
    mend=_mend,
    marks_own_frames=False,  # the mark means any program of this computer; the kernel keeps our own frames from us
    linux_error_frames=True,
)
