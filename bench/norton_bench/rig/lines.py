"""What a rig file may ask of lines: each drive on one of its kind, and no more than a serial line carries."""

from collections.abc import Iterator, Mapping
from typing import Any

from norton_bench.rig.driver_options import amplifier_options, declared_by
from norton_bench.rig.schema import DeviceSection
from norton_drivers import registry

Found = Iterator[tuple[str, str]]  # where, and what is wrong with the remedy


def wrong_kinds(devices: Mapping[str, DeviceSection]) -> Found:
    """A maker's drives on CAN and on serial lines have drivers of their own: ``vesc`` and ``vesc_uart``."""
    for role, device in devices.items():
        group = registry.group_of(role)
        takes = declared_by(group, device.driver).connection if device.driver in registry.names(group) else None
        on_bus = device.bus is not None
        if takes is None or on_bus in (device.port is not None, takes == "can"):
            continue
        other = f"{device.driver}_uart" if takes == "can" else device.driver.removesuffix("_uart")
        mend = 'bus = "can0"' if takes == "can" else 'port = "/dev/ttyUSB0"'
        if other != device.driver and other in registry.names(group):
            mend = f'driver = "{other}", or {mend}'
        where, line = ("port", "CAN") if takes == "can" else ("bus", "a serial line")
        yield f"[{role}] {where}", f'driver = "{device.driver}" is for a device on {line}; write {mend}'


def overfull_lines(
    devices: Mapping[str, DeviceSection], options: Mapping[str, Mapping[str, Any]], rate_hz: float
) -> Found:
    """A drive's serial line must carry a command in every tick, and readings often enough to be of use."""
    for role, device in devices.items():
        if device.port is None or role not in registry.DRIVES:
            continue
        declared = amplifier_options(device.driver, options.get(role, {}))
        exchange = declared.exchange if declared is not None else None
        if exchange is None or exchange.serves(1 / rate_hz):
            continue
        line = f"at {exchange.baud} baud" if exchange.baud else "on USB"
        greatest_hz = exchange.greatest_rate_hz
        faster = f", or raise baud in the drive and in [{role}] (0 on its own USB port)" if exchange.baud else ""
        yield (
            "[rig] rate",
            f"{rate_hz:g} Hz is more than the line of [{role}] carries {line}: at most {greatest_hz:.0f} Hz with a "
            f'reading in every tick; write rate = "{int(greatest_hz / 10) * 10} Hz"{faster}',
        )
