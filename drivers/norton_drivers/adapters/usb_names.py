"""USB devices that are met at a bench, by vendor and product, and what a rig file would say of each.

Sources: Linux, drivers/net/can/usb (gs_usb.c, peak_usb/pcan_usb_core.h, kvaser_usb) and drivers/usb/serial
(ftdi_sio_ids.h, ch341.c, cp210x.c, pl2303.h); the udev rules of ODrive's tool; bldc's usbd configuration.
"""

from dataclasses import dataclass


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
    (0x1209, 0x0D32): UsbName("ODrive's own USB port (spoken to over CAN here)"),
    (0x0483, 0x5740): UsbName("STM32 serial port: a VESC's own, an slcan adapter, or another", "slcan"),
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
