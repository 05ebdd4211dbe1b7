"""What a rig file may ask of lines: each drive on one of its kind, who may share one, and no more than it carries."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from pydantic import ValidationError

from norton_bench.rig.driver_options import Declared, amplifier_options, declared_by
from norton_bench.rig.schema import DeviceSection
from norton_drivers import registry
from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceSettings

Devices = Mapping[str, DeviceSection]
Options = Mapping[str, Mapping[str, Any]]
Found = Iterator[tuple[str, str]]  # where, and what is wrong with the remedy


def wrong_kinds(devices: Devices) -> Found:
    """A maker's drives on CAN and on serial lines have drivers of their own: ``vesc`` and ``vesc_uart``."""
    for role, device in devices.items():
        group, takes = registry.group_of(role), _declared(role, device).connection
        on_bus = device.bus is not None
        if takes is None or on_bus in (device.port is not None, takes == "can"):
            continue
        other = f"{device.driver}_uart" if takes == "can" else device.driver.removesuffix("_uart")
        mend = 'bus = "can0"' if takes == "can" else 'port = "/dev/ttyUSB0"'
        if other != device.driver and other in registry.names(group):
            mend = f'driver = "{other}", or {mend}'
        where, line = ("port", "CAN") if takes == "can" else ("bus", "a serial line")
        yield f"[{role}] {where}", f'driver = "{device.driver}" is for a device on {line}; write {mend}'


def overfull_lines(devices: Devices, options: Options, rate_hz: float) -> Found:
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


def shares(role: str, device: DeviceSection) -> bool:
    """Whether its driver can have several devices on a port."""
    return _declared(role, device).check_port is not None


def wrong_lines(devices: Devices, options: Options, rate_hz: float) -> Found:
    """Where, and what is wrong with a line that devices share."""
    by_port: dict[str, dict[str, DeviceSection]] = {}
    for role, device in devices.items():
        if device.port is not None:
            by_port.setdefault(device.port, {})[role] = device
    for port, each in by_port.items():
        sharing = {role: device for role, device in each.items() if shares(role, device)}
        if not sharing:
            continue
        if others := [role for role in each if role not in sharing]:
            yield f"[{others[0]}] port", f'"{port}" is a line that servos share; connect it to another port'
        elif len({device.driver for device in sharing.values()}) > 1:
            roles = " and ".join(f"[{role}]" for role in sharing)
            yield f"{roles} port", f'"{port}" cannot carry two protocols; connect one of them to another port'
        else:
            yield from _not_carried(sharing, options, rate_hz)


def _not_carried(devices: Devices, options: Options, rate_hz: float) -> Found:
    """Of devices of one driver, whose options are right: what is wrong with those is told where they stand."""
    role, device = next(iter(devices.items()))
    declared = _declared(role, device)
    if declared.check_port is None or declared.model is None:
        return
    settings = [
        DeviceSettings(role, each.driver, each.bus, each.port, each.direction, options.get(role, {}))
        for role, each in devices.items()
    ]
    try:
        for each in settings:
            declared.model.model_validate(dict(each.options))
        declared.check_port(settings, round(1e9 / rate_hz))
    except ValidationError:
        return
    except WiringError as error:
        yield "", str(error)


def _declared(role: str, device: DeviceSection) -> Declared:
    with suppress(WiringError):
        return declared_by(registry.group_of(role), device.driver)
    return Declared({}, (), None)
