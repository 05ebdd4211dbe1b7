"""A rig file taken apart into its sections, each read for itself, so that one wrong section does not hide another."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from norton_bench.rig.driver_options import declared_by, read_options
from norton_bench.rig.mistakes import Mistakes, nearest
from norton_bench.rig.schema import (
    ActuatorSection,
    BusSection,
    DeviceSection,
    GuardSection,
    LimitsSection,
    LoadSection,
    ModulatorSection,
    RecordingSection,
    RigSection,
)
from norton_drivers import registry
from norton_drivers.errors import WiringError

DEVICES = ("actuator", "load", "torque_sensor", "modulator")
SECTIONS = ("rig", "bus", *DEVICES, "limits", "guard", "recording", "simulated")
MENDS = {
    "rig": 'add [rig] with name = "my-bench", rate = "1 kHz" and backend = "hardware"',
    "actuator": 'add [actuator] with driver = "odrive", bus = "can0", node = 1 and command = { unit = "N*m", '
    'limit = "0.5 N*m" }',
    "limits": 'add [limits] with torque = "1 N*m" and velocity = "60 rad/s"',
}


@dataclass(frozen=True)
class Draft:
    """What could be read of a rig file. None stands for what is not there, or is wrong and told already."""

    place: str
    written: Mapping[str, Any]
    rig: RigSection | None
    buses: Mapping[str, BusSection | None]
    actuator: ActuatorSection | None
    load: LoadSection | None
    torque_sensor: DeviceSection | None
    modulator: ModulatorSection | None
    limits: LimitsSection | None
    guard: GuardSection | None
    recording: RecordingSection | None
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of each device, by its role

    def devices(self) -> dict[str, DeviceSection]:
        """The devices that could be read, by role."""
        found: dict[str, DeviceSection | None] = {role: getattr(self, role) for role in DEVICES}
        return {role: device for role, device in found.items() if device is not None}

    def has(self, section: str) -> bool:
        """Whether the file has the section, right or wrong."""
        return section in self.written


def read_draft(written: Mapping[str, Any], folder: Path, mistakes: Mistakes) -> Draft:
    """Read every section of a rig file; ``folder`` is where the file lies."""
    for section in written:
        if section not in SECTIONS:
            mistakes.add(f"[{section}]", f"unknown section; {nearest(section, SECTIONS)}")
    for section, mend in MENDS.items():
        if section not in written:
            mistakes.add(f"[{section}]", f"is missing; {mend}")
    if not isinstance(written.get("simulated", {}), dict):
        mistakes.add("[simulated]", "is a section; write [simulated] on a line of its own")
    actuator = _section(ActuatorSection, written, "actuator", mistakes)
    context = {"command_unit": actuator.command.unit if actuator else None}
    draft = Draft(
        place=mistakes.place,
        written=written,
        rig=_section(RigSection, written, "rig", mistakes),
        buses=_buses(written, mistakes),
        actuator=actuator,
        load=_section(LoadSection, written, "load", mistakes),
        torque_sensor=_section(DeviceSection, written, "torque_sensor", mistakes),
        modulator=_section(ModulatorSection, written, "modulator", mistakes),
        limits=_section(LimitsSection, written, "limits", mistakes, context),
        guard=_section(GuardSection, {"guard": {}, **written}, "guard", mistakes),
        recording=_section(RecordingSection, {"recording": {}, **written}, "recording", mistakes),
    )
    options = {role: _options(device, role, folder, mistakes) for role, device in draft.devices().items()}
    return Draft(**{**vars(draft), "options": options})


def _section(
    model: type[Any],
    written: Mapping[str, Any],
    name: str,
    mistakes: Mistakes,
    context: Mapping[str, Any] | None = None,
) -> Any:
    return mistakes.read(model, written[name], name, context) if name in written else None


def _buses(written: Mapping[str, Any], mistakes: Mistakes) -> dict[str, BusSection | None]:
    buses = written.get("bus", {})
    if not isinstance(buses, dict):
        mistakes.add("[bus]", "is a section; write [bus.can0] on a line of its own")
        return {}
    return {name: mistakes.read(BusSection, table, f"bus.{name}") for name, table in buses.items()}


def _options(device: DeviceSection, role: str, folder: Path, mistakes: Mistakes) -> Mapping[str, Any]:
    group = registry.TORQUE_SENSORS if role == "torque_sensor" else registry.AMPLIFIERS
    known = registry.names(group)
    if device.driver not in known:
        mistakes.add(f"[{role}] driver", f'"{device.driver}" is not installed; {nearest(device.driver, known)}')
        return {}
    try:
        declared = declared_by(group, device.driver)
    except WiringError as error:
        mistakes.add(f"[{role}]", str(error))
        return {}
    return read_options(device, declared, role, folder, mistakes)
