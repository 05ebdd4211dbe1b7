"""Serial lines that several devices share: who may, and whether the line carries all of them in every tick."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from pydantic import ValidationError

from norton_bench.rig.driver_options import Declared, declared_by
from norton_bench.rig.schema import DeviceSection
from norton_drivers import registry
from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceSettings

Devices = Mapping[str, DeviceSection]
Options = Mapping[str, Mapping[str, Any]]


def shares(role: str, device: DeviceSection) -> bool:
    """Whether its driver can have several devices on a port."""
    return _declared(role, device).check_port is not None


def wrong_lines(devices: Devices, options: Options, rate_hz: float) -> Iterator[tuple[str, str]]:
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


def _not_carried(devices: Devices, options: Options, rate_hz: float) -> Iterator[tuple[str, str]]:
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
