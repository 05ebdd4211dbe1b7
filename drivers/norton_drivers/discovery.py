"""What a rig file could name: serial ports and CAN adapters that are plugged in, and what stands in their way."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from norton_drivers.adapters.adapter import quiet_python_can
from norton_drivers.adapters.socketcan import NETWORK, can_links
from norton_drivers.adapters.usb_names import usb_name

BY_ID = Path("/dev/serial/by-id")
USB_SERIAL = Path("/sys/bus/usb-serial/devices")
_NOT_BUSES = ("virtual", "serial", "socketcan")  # in one process only; every serial port again; looked for by ourselves
_SAID_OF_ADAPTERS = ("device_name", "serial", "device_id")  # python-can's keys, different for each maker


@dataclass(frozen=True)
class FoundPort:
    """Something that a rig file could name.

    ``kind`` is "serial" or a python-can interface, ``channel`` what to write (of a serial port the path that stays the
    same wherever it is plugged in, if there is one; ``device`` is the other). ``interface`` is "slcan" for a serial
    port that a CAN adapter may stand behind. ``mend`` is what to do before it can be used.
    """

    kind: str
    channel: str
    description: str = ""
    device: str = ""
    usb: str = ""  # vendor and product, e.g. "16d0:117e"
    interface: str = ""
    mend: str = ""


def list_ports() -> tuple[FoundPort, ...]:
    """Serial ports and CAN channels that this machine has. Opens nothing; takes some seconds with some adapters."""
    from serial.tools import list_ports as serial_list  # noqa: PLC0415

    links = tuple(found_link(name, up) for name, up in can_links(NETWORK).items())
    return (*(found_serial(entry) for entry in serial_list.comports()), *links, *_detected())


def found_serial(entry: Any, by_id: Path = BY_ID, usb_serial: Path = USB_SERIAL) -> FoundPort:
    """One of pyserial's ``ListPortInfo``."""
    known = usb_name(entry.vid, entry.pid)
    # What the device says of itself, then what its numbers tell.
    said = entry.description if entry.description not in (None, "n/a") else ""
    words = ", ".join(dict.fromkeys(filter(None, (said, known.words if known else ""))))
    return FoundPort(
        kind="serial",
        channel=stable_path(entry.device, by_id),
        description=words,
        device=entry.device,
        usb="" if entry.vid is None else f"{entry.vid:04x}:{entry.pid:04x}",
        interface=known.interface if known and known.interface == "slcan" else "",
        mend="; ".join(serial_obstacles(entry.device, usb_serial)),
    )


def found_link(name: str, up: bool) -> FoundPort:
    """One CAN link of the kernel."""
    mend = "" if up else f"it is down: `sudo ip link set {name} up type can bitrate 1000000`"
    return FoundPort("socketcan", name, "CAN link of the kernel", device=name, mend=mend)


def stable_path(device: str, by_id: Path = BY_ID) -> str:
    """The path that names the device itself rather than the order in which it was plugged in; else ``device``."""
    links = sorted(by_id.iterdir()) if by_id.is_dir() else []
    return next((str(link) for link in links if link.resolve() == Path(device).resolve()), device)


def serial_obstacles(device: str, usb_serial: Path = USB_SERIAL) -> Iterator[str]:
    """What keeps a serial port from being opened, or from being quick, with the mend."""
    path = Path(device)
    if path.exists() and not os.access(path, os.R_OK | os.W_OK):
        yield "this user may not open it: `sudo usermod -aG dialout $USER`, then log in again"
    timer = usb_serial / path.resolve().name / "latency_timer"
    held_back_ms = _number(timer)
    if held_back_ms > 1:
        yield f"it holds bytes back for up to {held_back_ms} ms: `echo 1 | sudo tee {timer}`"


def _detected() -> Iterator[FoundPort]:
    """What python-can's interfaces find of themselves."""
    with quiet_python_can():  # else it says of each adapter's library that it is not installed
        configurations = can.detect_available_configs()
    for each in configurations:
        if each["interface"] not in _NOT_BUSES:
            said = [str(each[key]) for key in _SAID_OF_ADAPTERS if each.get(key)]  # type: ignore[literal-required]
            if each["interface"] == "udp_multicast":
                said = ["no adapter: a bus between programs"]
            yield FoundPort(str(each["interface"]), str(each["channel"]), " ".join(said))


def _number(path: Path) -> int:
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return 0
