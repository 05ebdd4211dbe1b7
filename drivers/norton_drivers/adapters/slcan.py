"""slcan: CANable (slcan firmware), Lawicel CANUSB, USBtin and many more, as a serial port of ASCII lines."""

from collections.abc import Iterator

import can

from norton_drivers.adapters.adapter import Adapter, Mistake, own_health
from norton_drivers.adapters.serial_mend import serial_mend
from norton_drivers.wiring import CanBusSettings

# Lawicel's S0 to S8, and S9 as several firmwares have it. Source: python-can, slcanBus.
BITRATES = (10_000, 20_000, 50_000, 83_300, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if settings.bitrate_bit_s not in BITRATES and "timing" not in settings.options:
        known = ", ".join(f"{bitrate // 1000}" for bitrate in BITRATES)
        yield "bitrate", f"{settings.bitrate_bit_s} bit/s is none that slcan adapters know: {known} kbit/s"


def _open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.steady_slcan import SteadySlcanBus  # noqa: PLC0415  (only this interface needs it)

    return SteadySlcanBus(settings.channel, **{"bitrate": settings.bitrate_bit_s, **settings.options})


def _mend(_settings: CanBusSettings, error: Exception) -> str:
    return serial_mend(error)


SLCAN = Adapter(
    channel='the serial port, e.g. "/dev/serial/by-id/usb-..."',
    options=("tty_baudrate", "timing", "sleep_after_open", "rtscts", "listen_only", "timeout"),
    mistakes=_mistakes,
    open=_open,
    mend=_mend,
    health=own_health,
)
