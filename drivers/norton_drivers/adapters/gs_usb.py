"""gs_usb: candleLight and its kin through libusb, for systems whose kernel has no driver for them (Linux has)."""

import errno
from collections.abc import Iterator

import can

from norton_drivers.adapters.adapter import Adapter, Mistake, as_python_can_does
from norton_drivers.wiring import CanBusSettings


def _mistakes(settings: CanBusSettings) -> Iterator[Mistake]:
    if not settings.channel.isdecimal() and not {"index", "bus", "address"} & set(settings.options):
        yield "channel", f'"{settings.channel}" must be the number of the adapter: "0" is the first one found'


def _open(settings: CanBusSettings) -> can.BusABC:
    from norton_drivers.adapters.threaded_bus import ThreadedBus  # noqa: PLC0415  (only this interface needs it)

    channel = int(settings.channel) if settings.channel.isdecimal() else settings.channel
    # Its reader waits a millisecond at least, and every frame that is sent comes back, marked as such.
    return ThreadedBus(as_python_can_does(settings, channel=channel))


def _mend(_settings: CanBusSettings, error: Exception) -> str:
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
    mistakes=_mistakes,
    open=_open,
    mend=_mend,
    linux_error_frames=True,
)
