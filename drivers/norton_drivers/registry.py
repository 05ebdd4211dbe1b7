"""Finds drivers by the name a rig file gives them: listed without importing, loaded one at a time."""

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, cast

from norton_drivers.backend import BackendFactory
from norton_drivers.devices import Amplifier, TorqueSensor
from norton_drivers.errors import WiringError
from norton_drivers.link import Link
from norton_drivers.recognition import Recognition
from norton_drivers.wiring import DeviceSettings

BACKENDS = "norton_bench.backends"
AMPLIFIERS = "norton_bench.amplifiers"
TORQUE_SENSORS = "norton_bench.torque_sensors"


def names(group: str) -> list[str]:
    """The installed names in a group, sorted; nothing is imported."""
    return sorted({entry.name for entry in _entries(group)})


def load(group: str, name: str, *, asked_by: str) -> Any:
    """Import what ``name`` stands for.

    Raises WiringError naming the known ones, or the package and the module that cannot be imported.
    """
    for entry in _entries(group):
        if entry.name == name:
            return _loaded(entry, asked_by)
    raise WiringError(f"{asked_by} = {name!r} is not installed; known: {', '.join(names(group)) or 'none'}")


def _entries(group: str) -> tuple[EntryPoint, ...]:
    return _read(group, tuple(sys.path))


@cache  # 5 ms to read what all packages say, and a rig file asks a dozen times
def _read(group: str, _found_along: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    return tuple(entry_points(group=group))


def _loaded(entry: EntryPoint, asked_by: str) -> Any:
    try:
        return entry.load()
    except Exception as error:  # whatever a package of somebody else does when it is imported
        package = "a package" if entry.dist is None else f"package {entry.dist.name} {entry.dist.version}"
        raise WiringError(
            f"{asked_by} = {entry.name!r}: {package} says that it is {entry.value}, but importing that fails "
            f"({_first_line(error)}); update or reinstall the package"
        ) from error


def _first_line(error: Exception) -> str:
    """The kind of error and the first line of what it says."""
    return f"{type(error).__name__}: {error}".splitlines()[0]


def installed(group: str) -> dict[str, ModuleType]:
    """The modules of a group's drivers, by name. One that cannot be imported is left out: nobody asked for it."""
    found: dict[str, ModuleType] = {}
    for entry in _entries(group):
        with suppress(Exception):  # a third party's module may raise anything
            found[entry.name] = sys.modules[entry.load().__module__]
    return dict(sorted(found.items()))


def recognition() -> dict[str, Recognition]:
    """What the installed drivers offer to tell who is on a bus, by the driver's name."""
    modules = {**installed(AMPLIFIERS), **installed(TORQUE_SENSORS)}
    return {
        name: Recognition(*(getattr(module, offer, None) for offer in ("recognise", "answers", "probes")))
        for name, module in modules.items()
    }


def load_backend(name: str) -> BackendFactory:
    return cast(BackendFactory, load(BACKENDS, name, asked_by="backend"))


def open_amplifier(settings: DeviceSettings, link: Link) -> Amplifier:
    """Raises WiringError for an unknown driver or a wrong option, ConnectionFailedError for a port."""
    factory = load(AMPLIFIERS, settings.driver, asked_by=f"[{settings.role}] driver")
    return cast(Callable[[DeviceSettings, Link], Amplifier], factory)(settings, link)


def open_torque_sensor(settings: DeviceSettings, link: Link) -> TorqueSensor:
    """Raises WiringError for an unknown driver or a wrong option, ConnectionFailedError for a port."""
    factory = load(TORQUE_SENSORS, settings.driver, asked_by=f"[{settings.role}] driver")
    return cast(Callable[[DeviceSettings, Link], TorqueSensor], factory)(settings, link)
