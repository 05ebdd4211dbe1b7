"""Drivers by the name a rig file gives them, and what they offer to tell who is on a bus.

Drivers are listed without importing them, and loaded one at a time. A driver's module may offer these, the first three
pure, without a port and without a clock:

- ``recognise(message, options)``, a :data:`Recogniser`, which is shown every frame on the bus, other makers' too;
- ``answers(question, frame)``, whether ``frame`` answers ``question``: two answers come from two devices;
- ``probes(options, heard)``, questions that make every device of this kind say something, whatever its address;
- ``find(port, link)``, who of this kind answers on a serial line, where devices speak only when spoken to.
"""

import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, NamedTuple, cast

import can

from norton_drivers.devices import Amplifier, Device, TorqueSensor
from norton_drivers.errors import WiringError
from norton_drivers.finding import Found
from norton_drivers.link import Link
from norton_drivers.ports import BackendFactory, SerialPort
from norton_drivers.readings import RawFrame
from norton_drivers.wiring import DeviceSettings


@dataclass(frozen=True, slots=True)
class Recognised:
    """What a frame looks like.

    ``device`` is the sender in words ("an ODrive"), ``says`` what the frame is ("heartbeat"), ``options`` what a rig
    file would say to reach the sender ({"node": 3}). A frame that many others could be as well is not ``sure``: it
    counts only beside a sure one with the same options, or without options beside any sure one of this driver. One that
    a host sends, not the device, is ``from_host``.
    """

    device: str
    says: str
    options: Mapping[str, Any] = field(default_factory=dict)
    sure: bool = True
    from_host: bool = False


class Question(NamedTuple):
    """A frame that moves nothing, and that a device of one kind answers."""

    arbitration_id: int
    data: bytes
    extended: bool = False


# Given a frame and the options of the rig's device with this driver ({} where the rig has none).
Recogniser = Callable[[can.Message, Mapping[str, Any]], Recognised | None]
# Given a question as it was sent, and a frame that came after it.
Answers = Callable[[RawFrame, RawFrame], bool]
# Given the options, and the standard identifiers heard on the bus: those of others must not be disturbed.
Probes = Callable[[Mapping[str, Any], Collection[int]], Iterator[Question]]
# Given a port that is open at some baud rate. Raises ConnectionFailedError.
Find = Callable[[SerialPort, Link], Iterator[Found]]


def answers_remotely(question: RawFrame, frame: RawFrame) -> bool:
    """A remote frame is answered under its own identifier, whoever made the device."""
    same = (frame.arbitration_id, frame.extended) == (question.arbitration_id, question.extended)
    return question.remote and same and not frame.remote


def nobodys(identifier: int, heard: Collection[int], block: int = 32) -> bool:
    """Whether no frame was received near a standard identifier: nodes often own a block of them."""
    return all(other // block != identifier // block for other in heard)


@dataclass(frozen=True)
class Recognition:
    """What one driver offers."""

    recognise: Recogniser | None = None
    answers: Answers | None = None
    probes: Probes | None = None
    find: Find | None = None


OFFERS = ("recognise", "answers", "probes", "find")  # the fields of Recognition, in their order

BACKENDS = "norton_bench.backends"
AMPLIFIERS = "norton_bench.amplifiers"
TORQUE_SENSORS = "norton_bench.torque_sensors"
DRIVES = ("actuator", "load", "modulator")


def group_of(role: str) -> str:
    """The group of a device's drivers. A sensor's role says what it is, and has a number where a rig has several:
    "temperature_sensor" and "temperature_sensor_2" are of the group "norton_bench.temperature_sensors"."""
    return AMPLIFIERS if role in DRIVES else f"norton_bench.{role.rstrip('_0123456789')}s"


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
    result: dict[str, ModuleType] = {}
    for entry in _entries(group):
        with suppress(Exception):  # a third party's module may raise anything
            result[entry.name] = sys.modules[entry.load().__module__]
    return dict(sorted(result.items()))


def recognition() -> dict[str, Recognition]:
    """What the installed drivers offer to tell who is on a bus, by the driver's name."""
    modules = {**installed(AMPLIFIERS), **installed(TORQUE_SENSORS)}
    return {name: Recognition(*(getattr(module, offer, None) for offer in OFFERS)) for name, module in modules.items()}


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


def open_device(settings: DeviceSettings, link: Link) -> Device:
    """A device of any role. Raises WiringError for an unknown driver or a wrong option, ConnectionFailedError."""
    factory = load(group_of(settings.role), settings.driver, asked_by=f"[{settings.role}] driver")
    return cast(Callable[[DeviceSettings, Link], Device], factory)(settings, link)
