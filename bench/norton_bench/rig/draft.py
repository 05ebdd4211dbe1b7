"""A rig file taken apart into its sections, each read for itself, so that one wrong section does not hide another."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import Any

from norton_bench.errors import nearest
from norton_bench.records import STREAMS
from norton_bench.rig.driver_options import Commanded, amplifier_options, declared_by, read_options, wrong_unit
from norton_bench.rig.files import Mistakes
from norton_bench.rig.lines import overfull_lines, shares, wrong_kinds, wrong_lines
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

FITTED = ("actuator", "load", "torque_sensor", "modulator")  # what an experiment may need
SENSORS = tuple(dict.fromkeys(stream.role for stream in STREAMS if stream.role not in FITTED))
DEVICES = (*FITTED, *SENSORS)
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
    sensors: Mapping[str, DeviceSection | None] = field(default_factory=dict)  # further ones, by role
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of each device, by its role

    def devices(self) -> dict[str, DeviceSection]:
        """The devices that could be read, by role."""
        result: dict[str, DeviceSection | None] = {role: getattr(self, role) for role in FITTED}
        result.update(self.sensors)
        return {role: device for role, device in result.items() if device is not None}

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
        sensors={role: _section(DeviceSection, written, role, mistakes) for role in SENSORS},
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
    group = registry.group_of(role)
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


Found = Iterator[tuple[str, str]]  # where, and what is wrong with the remedy


def check(draft: Draft, backend: str | None, mistakes: Mistakes) -> None:
    """What no section can see for itself: contradictions between the sections of a rig file.

    Note every contradiction; ``backend`` is the one in force, where that is known.
    """
    for look in CHECKS:
        for where, text in look(draft):
            mistakes.add(where, text)
    for where, text in _backend(draft, backend):
        mistakes.add(where, text)


def _backend(draft: Draft, backend: str | None) -> Found:
    known = registry.names(registry.BACKENDS)
    if backend is not None and backend not in known:
        yield "[rig] backend", f'"{backend}" is not installed; {nearest(backend, known)}'
    if backend == "simulated" and not draft.has("simulated"):
        yield (
            "[simulated]",
            'is missing though the backend is "simulated"; add the section, or say backend = "hardware"',
        )


def _needed_devices(draft: Draft) -> Found:
    if draft.load is not None and not draft.has("torque_sensor") and not isfinite(draft.load.torque_limit_nm):
        yield "[load] torque_limit", 'is missing, and no sensor watches the torque; add torque_limit = "1 N*m"'
    if draft.has("load") and draft.rig is not None and draft.rig.shaft == "clamped":
        yield "[rig] shaft", '"clamped" contradicts the [load] that turns the shaft; leave out shaft, or [load]'


def _connections(draft: Draft) -> Found:
    for role, device in draft.devices().items():
        where = f"[{role}]"
        if device.bus is None and device.port is None:
            yield where, 'is not connected; add bus = "can0" or port = "/dev/ttyUSB0"'
        elif device.bus is not None and device.port is not None:
            yield where, "is on a bus and on a port at once; leave out one of them"
        elif device.bus is not None and device.bus not in draft.buses:
            known = ", ".join(draft.buses) or "none"
            yield f"{where} bus", f'"{device.bus}" is not defined (known: {known}); add a section [bus.{device.bus}]'


def _kinds_of_line(draft: Draft) -> Found:
    return wrong_kinds(draft.devices())


def _unused_buses(draft: Draft) -> Found:
    written = (draft.written.get(role) for role in DEVICES)
    used = [table.get("bus") for table in written if isinstance(table, dict)]
    for name in draft.buses:
        if name not in used:
            yield f"[bus.{name}]", "no device is on this bus; remove the section, or name the bus in a device"


def _shared_addresses(draft: Draft) -> Found:
    taken: dict[str, str] = {}
    for role, device in draft.devices().items():
        node = draft.options.get(role, {}).get("node")
        if device.port is not None and isinstance(node, int) and shares(role, device):
            address = f'node {node} on the port "{device.port}"'
        elif device.port is not None:
            address = f'the port "{device.port}"'
        elif device.bus is not None and isinstance(node, int):
            address = f"node {node} of bus {device.bus}"
        else:
            continue
        if address in taken:
            yield (
                f"[{role}]",
                f"{address} belongs to [{taken[address]}] already; every device needs an address of its own",
            )
        taken.setdefault(address, role)


def _lines(draft: Draft) -> Found:
    if draft.rig is not None:
        yield from wrong_lines(draft.devices(), draft.options, draft.rig.rate_hz)
        yield from overfull_lines(draft.devices(), draft.options, draft.rig.rate_hz)


def _interfaces(draft: Draft) -> Found:
    if not draft.buses:
        return
    # Slow to import; only a rig with a bus needs it.
    from norton_drivers.adapters.table import INTERFACES, mistakes  # noqa: PLC0415

    for name, bus in draft.buses.items():
        if bus is None:
            continue
        if bus.interface not in INTERFACES:
            mend = nearest(bus.interface, INTERFACES)
            yield f"[bus.{name}] interface", f'"{bus.interface}" is no interface of python-can; {mend}'
            continue
        for key, text in mistakes(bus.settings(name)):
            yield f"[bus.{name}] {key}", text


def _can_fd(draft: Draft) -> Found:
    """A device that sends CAN FD frames on a bus that does not carry them."""
    for role, device in draft.devices().items():
        bus = draft.buses.get(device.bus or "")
        if bus is None or bus.fd:
            continue
        with suppress(WiringError):  # told already
            data_bitrate = declared_by(registry.group_of(role), device.driver).data_bitrate
            if data_bitrate is not None:
                yield (
                    f"[bus.{device.bus}] fd",
                    f'[{role}] driver = "{device.driver}" sends CAN FD frames; write fd = true and '
                    f'data_bitrate = "{data_bitrate}"',
                )


def _timing(draft: Draft) -> Found:
    if draft.rig is None:
        return
    two_ticks_s = 2 / draft.rig.rate_hz
    mend = f'at the rate of {draft.rig.rate_hz:g} Hz; write at least "{two_ticks_s * 1e3:g} ms"'
    if draft.limits is not None and draft.limits.stale_after_s < two_ticks_s:
        yield "[limits] stale_after", f"{draft.limits.stale_after_s * 1e3:g} ms is less than two ticks {mend}"
    for role, options in draft.options.items():
        watchdog_s = options.get("watchdog")
        if isinstance(watchdog_s, float) and 0 < watchdog_s < two_ticks_s:
            yield f"[{role}] watchdog", f"{watchdog_s * 1e3:g} ms is less than two ticks {mend}"


def _stall(draft: Draft) -> Found:
    """The loop must notice that it stood still before a drive does."""
    if draft.limits is None:
        return
    stall_s = draft.limits.stall_after_s
    for role, options in draft.options.items():
        watchdog_s = options.get("watchdog")
        if isinstance(watchdog_s, float) and 0 < watchdog_s <= stall_s:
            yield (
                "[limits] stall_after",
                f"{stall_s * 1e3:g} ms is not below the watchdog of [{role}], {watchdog_s * 1e3:g} ms; "
                "shorten stall_after or lengthen the watchdog",
            )


def _lost_answers(draft: Draft) -> Found:
    """One answer lost by a sensor that has to be asked must not end the experiment."""
    timeout_s = draft.options.get("torque_sensor", {}).get("timeout")
    if draft.limits is not None and isinstance(timeout_s, float) and timeout_s >= draft.limits.stale_after_s:
        yield (
            "[torque_sensor] timeout",
            f"{timeout_s * 1e3:g} ms is not below [limits] stale_after = {draft.limits.stale_after_s * 1e3:g} ms: one "
            "lost answer would end the experiment; shorten timeout or lengthen stale_after",
        )


def _torque_limits(draft: Draft) -> Found:
    if draft.limits is None:
        return
    torque_nm = draft.limits.torque_nm
    if not draft.has("torque_sensor"):
        for key, value in (("torque", torque_nm), ("power", draft.limits.power_w)):
            if isfinite(value):
                yield f"[limits] {key}", "cannot be held without a [torque_sensor]; remove the key or add the section"
    elif not isfinite(torque_nm):
        yield "[limits] torque", 'is missing; add torque = "1 N*m", within what the torque sensor stands'
    range_nm = _range_nm(draft)
    if isfinite(torque_nm) and torque_nm > range_nm:
        yield "[limits] torque", f"{torque_nm:g} N*m is beyond the sensor's range of {range_nm:g} N*m; lower the limit"
    if draft.load is not None and isfinite(draft.load.torque_limit_nm) and draft.load.torque_limit_nm > range_nm:
        yield (
            "[load] torque_limit",
            f"{draft.load.torque_limit_nm:g} N*m is beyond the sensor's range of {range_nm:g} N*m; lower the limit",
        )


def _twist(draft: Draft) -> Found:
    written = draft.written.get("limits")
    if isinstance(written, dict) and "twist" in written and not draft.has("load"):
        yield "[limits] twist", "cannot be held without a [load], whose encoder it takes; remove the key"


def _command_limit(draft: Draft) -> Found:
    """A command in newton metres is what a blocked shaft carries, one of a velocity what a free shaft has."""
    if draft.actuator is None or draft.limits is None:
        return
    greatest_nm = draft.actuator.command.limit_nm
    if greatest_nm is not None and greatest_nm > draft.limits.torque_nm:
        yield (
            "[actuator.command] limit",
            f"{greatest_nm:g} N*m on a blocked shaft would exceed [limits] torque = {draft.limits.torque_nm:g} N*m; "
            "lower the command's limit or raise the torque's",
        )
    command, greatest_rad_s = draft.actuator.command, draft.limits.velocity_rad_s
    declared = amplifier_options(draft.actuator.driver, draft.options.get("actuator", {}))
    turns = declared is not None and declared.servo is not None and not declared.servo.holds_position
    if turns and command.sent_as is None and command.limit > greatest_rad_s:
        yield (
            "[actuator.command] limit",
            f"{command.limit:g} {command.unit} is what a free shaft would turn at, and [limits] velocity = "
            f"{greatest_rad_s:g} rad/s; lower the command's limit or raise the velocity's",
        )


def _readable(draft: Draft) -> Found:
    """The guard must see what it is to hold: a drive's readings may end, or begin anew, before a limit is reached."""
    if draft.limits is None:
        return
    velocity_rad_s, position_rad = draft.limits.velocity_rad_s, draft.limits.position_rad
    for role, device in draft.devices().items():
        declared = (
            amplifier_options(device.driver, draft.options.get(role, {})) if role in ("actuator", "load") else None
        )
        if declared is None:
            continue
        if velocity_rad_s >= declared.greatest_velocity_rad_s:
            yield (
                "[limits] velocity",
                f"{velocity_rad_s:g} rad/s is not below {declared.greatest_velocity_rad_s:g} rad/s, beyond which "
                f"[{role}] cannot tell its velocity; lower the limit, or widen the range in the drive and in [{role}]",
            )
        if position_rad > declared.greatest_position_rad:
            end_rad = declared.greatest_position_rad
            yield (
                "[limits] position",
                f"lets the shaft turn further than the {end_rad:g} rad about its zero within which [{role}] can tell "
                f'where it is; write position = "{0.8 * end_rad:.3g} rad", or say in [{role}] that it goes on there',
            )


def _command_units(draft: Draft) -> Found:
    """A drive whose driver tells the unit of its commands only once it is open is looked at then."""
    commands: dict[str, Commanded | None] = {
        "actuator": draft.actuator.command if draft.actuator else None,
        "modulator": draft.modulator.command if draft.modulator else None,
        "load": None,
    }
    for role, device in draft.devices().items():
        options = draft.options.get(role, {})
        declared = amplifier_options(device.driver, options) if role in commands else None
        if declared is not None and declared.command_unit is not None:
            result = wrong_unit(role, device.driver, options, commands[role], declared.command_unit)
            if result is not None:
                yield result


def _range_nm(draft: Draft) -> float:
    """The sensor's range, where its driver has such an option and it was written."""
    value = draft.options.get("torque_sensor", {}).get("range", inf)
    return value if isinstance(value, float) else inf


CHECKS: tuple[Callable[[Draft], Found], ...] = (
    _needed_devices,
    _connections,
    _kinds_of_line,
    _unused_buses,
    _shared_addresses,
    _lines,
    _interfaces,
    _can_fd,
    _timing,
    _stall,
    _lost_answers,
    _torque_limits,
    _twist,
    _command_limit,
    _command_units,
    _readable,
)
