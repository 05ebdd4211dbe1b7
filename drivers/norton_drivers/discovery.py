"""Serial ports and CAN adapters that are plugged in, and what prevents their use."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from norton_drivers.adapters.adapter import quiet_python_can
from norton_drivers.adapters.socketcan import NETWORK, bring_up, can_links
from norton_drivers.wiring import CanBusSettings


# USB devices that are met at a bench, by vendor and product, and what a rig file would say of each.
#
# Sources: Linux, drivers/net/can/usb (gs_usb.c, peak_usb/pcan_usb_core.h, kvaser_usb) and drivers/usb/serial
# (ftdi_sio_ids.h, ch341.c, cp210x.c, pl2303.h); the udev rules of ODrive's tool; bldc's usbd configuration.
@dataclass(frozen=True)
class UsbName:
    """``interface`` is python-can's, for CAN adapters; "" for a mere serial port."""

    words: str
    interface: str = ""


_GS_USB = "CAN adapter with candleLight firmware"
_NAMES: dict[tuple[int, int], UsbName] = {
    (0x16D0, 0x117E): UsbName("CANable, slcan firmware", "slcan"),
    (0xAD50, 0x60C4): UsbName("CANable or CANtact, slcan firmware", "slcan"),
    (0x0403, 0xFFA8): UsbName("Lawicel CANUSB", "slcan"),
    (0x04D8, 0x000A): UsbName("USBtin, or another serial device of Microchip's", "slcan"),
    (0x1D50, 0x606F): UsbName(_GS_USB, "socketcan"),
    (0x1209, 0x2323): UsbName(_GS_USB, "socketcan"),
    (0x1209, 0xCA01): UsbName("CANnectivity CAN adapter", "socketcan"),
    (0x1209, 0x0D32): UsbName("ODrive's own USB port"),
    (0x0483, 0x5740): UsbName("STM32 serial port: a VESC's own, an slcan adapter, an fdcanusb, or another", "slcan"),
    (0x0403, 0x6001): UsbName("FTDI serial adapter"),
    (0x0403, 0x6010): UsbName("FTDI serial adapter, two ports"),
    (0x0403, 0x6014): UsbName("FTDI serial adapter"),
    (0x0403, 0x6015): UsbName("FTDI serial adapter"),
    (0x1A86, 0x7523): UsbName("CH340 serial adapter"),
    (0x1A86, 0x55D3): UsbName("CH343 serial adapter"),
    (0x10C4, 0xEA60): UsbName("CP210x serial adapter"),
    (0x067B, 0x2303): UsbName("PL2303 serial adapter"),
}
_VENDORS = {0x0C72: UsbName("PEAK CAN adapter", "socketcan"), 0x0BFD: UsbName("Kvaser CAN adapter", "socketcan")}


def usb_name(vendor: int | None, product: int | None) -> UsbName | None:
    """What is known of a device; None where nothing is."""
    if vendor is None or product is None:
        return None
    return _NAMES.get((vendor, product)) or _VENDORS.get(vendor)


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


def found_serial(entry: Any, by_id: Path = BY_ID) -> FoundPort:
    """One of pyserial's ``ListPortInfo``."""
    known = usb_name(entry.vid, entry.pid)
    # What the device says of itself, then what its numbers tell.
    message = entry.description if entry.description not in (None, "n/a") else ""
    words = ", ".join(dict.fromkeys(filter(None, (message, known.words if known else ""))))
    return FoundPort(
        kind="serial",
        channel=stable_path(entry.device, by_id),
        description=words,
        device=entry.device,
        usb="" if entry.vid is None else f"{entry.vid:04x}:{entry.pid:04x}",
        interface=known.interface if known and known.interface == "slcan" else "",
        mend="; ".join(serial_obstacles(entry.device)),
    )


def found_link(name: str, up: bool) -> FoundPort:
    """One CAN link of the kernel."""
    mend = "" if up else f"it is down: {bring_up(CanBusSettings(name, 'socketcan', name))}"
    return FoundPort("socketcan", name, "CAN link of the kernel", device=name, mend=mend)


def stable_path(device: str, by_id: Path = BY_ID) -> str:
    """The path that names the device itself rather than the order in which it was plugged in; else ``device``."""
    links = sorted(by_id.iterdir()) if by_id.is_dir() else []
    return next((str(link) for link in links if link.resolve() == Path(device).resolve()), device)


def serial_obstacles(device: str) -> Iterator[str]:
    """What keeps a serial port from being opened, with the remedy."""
    path = Path(device)
    if path.exists() and not os.access(path, os.R_OK | os.W_OK):
        yield "this user may not open it: `sudo usermod -aG dialout $USER`, then log in again"


def held_back_words(device: str, usb_serial: Path = USB_SERIAL) -> str:
    """How long an adapter's latency timer holds bytes back, with the remedy; "" where it is quick, or has none.

    Of an open port: the hardware backend asks every adapter to be quick (``adapters.serial_line.hurry``), and the timer
    then reads as 1 ms; one that does not heed that must be told by the system's administrator.
    """
    timer = usb_serial / Path(device).resolve().name / "latency_timer"
    held_back_ms = _number(timer)
    return f"it holds bytes back for up to {held_back_ms} ms: `echo 1 | sudo tee {timer}`" if held_back_ms > 1 else ""


def _detected() -> Iterator[FoundPort]:
    """What python-can's interfaces find of themselves."""
    with quiet_python_can():  # else it says of each adapter's library that it is not installed
        configurations = can.detect_available_configs()
    for each in configurations:
        if each["interface"] not in _NOT_BUSES:
            message = [str(each[key]) for key in _SAID_OF_ADAPTERS if each.get(key)]  # type: ignore[literal-required]
            if each["interface"] == "udp_multicast":
                message = ["no adapter: a bus between programs"]
            yield FoundPort(str(each["interface"]), str(each["channel"]), " ".join(message))


def _number(path: Path) -> int:
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return 0
