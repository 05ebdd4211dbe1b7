"""A rig file to a :class:`Rig`: every mistake in it is told at once, in a sentence each, before anything is opened."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from norton_bench.errors import RigError
from norton_bench.rig.draft import Draft, check, read_draft
from norton_bench.rig.driver_options import amplifier_options
from norton_bench.rig.files import Mistakes, check_kind, parse_toml, read_text
from norton_bench.rig.rig import Command, Limits, Rig, Supervision
from norton_bench.rig.schema import ActuatorSection, CommandSection, DeviceSection, LimitsSection, RigSection
from norton_drivers.wiring import CanBusSettings, DeviceSettings, Wiring


def load_rig(path: str | Path, *, backend: str | None = None) -> Rig:
    """The bench that the rig file describes; ``backend`` overrides the file's.

    Raises RigError: one line for each mistake, each with its place and the mend.
    """
    path = Path(path)
    return parse_rig(read_text(path, "rig file", RigError), place=str(path), backend=backend)


def parse_rig(text: str, *, place: str, backend: str | None = None) -> Rig:
    """As :func:`load_rig`, from the file's content (a recording keeps it); ``place`` is where it came from."""
    mistakes = Mistakes(place)
    written = parse_toml(text, place, RigError)
    check_kind(written, "rig file", place, RigError)
    draft = read_draft(written, Path(place).parent, mistakes)
    chosen = backend or (draft.rig.backend if draft.rig else None)
    check(draft, chosen, mistakes)
    mistakes.raise_as(RigError)
    return _assemble(draft, chosen, text)


def _assemble(draft: Draft, backend: str | None, text: str) -> Rig:
    rig, actuator, limits = draft.rig, draft.actuator, draft.limits
    guard, recording = draft.guard, draft.recording
    # Whatever of these is missing or wrong has been told, and raised, by now.
    assert rig is not None
    assert actuator is not None
    assert limits is not None
    assert guard is not None
    assert recording is not None
    assert backend is not None
    return Rig(
        name=rig.name,
        backend=backend,
        wiring=_wiring(draft, rig, actuator),
        command=_command(actuator.command),
        modulation=_command(draft.modulator.command) if draft.modulator else None,
        model=actuator.model,
        limits=_limits(limits, draft.load.torque_limit_nm if draft.load else None),
        supervision=Supervision(tuple(guard.leave_out), guard.verify_watchdogs),
        candump=recording.candump and bool(draft.buses),
        simulated=draft.written.get("simulated", {}),
        place=draft.place,
        text=text,
    )


def _command(section: CommandSection) -> Command:
    return Command(section.unit, section.limit, section.lowest, section.sent_as)


def _wiring(draft: Draft, rig: RigSection, actuator: ActuatorSection) -> Wiring:
    return Wiring(
        name=rig.name,
        tick_ns=round(1e9 / rig.rate_hz),
        buses=tuple(
            CanBusSettings(name, bus.interface, bus.channel, round(bus.bitrate_bit_s), bus.options)
            for name, bus in draft.buses.items()
            if bus is not None
        ),
        actuator=_drive("actuator", actuator, draft.options["actuator"]),
        torque_sensor=_device("torque_sensor", draft.torque_sensor, draft.options["torque_sensor"])
        if draft.torque_sensor
        else None,
        load=_drive("load", draft.load, draft.options["load"]) if draft.load else None,
        shaft=rig.shaft,
        command_unit=actuator.command.unit,
        modulator=_drive("modulator", draft.modulator, draft.options["modulator"]) if draft.modulator else None,
        modulation_unit=draft.modulator.command.unit if draft.modulator else "",
        sensors=tuple(_device(role, sensor, draft.options[role]) for role, sensor in draft.sensors.items() if sensor),
    )


def _device(role: str, section: DeviceSection, options: Mapping[str, Any]) -> DeviceSettings:
    return DeviceSettings(role, section.driver, section.bus, section.port, section.direction, options)


def _drive(role: str, section: DeviceSection, options: Mapping[str, Any]) -> DeviceSettings:
    declared = amplifier_options(section.driver, options)
    settings = _device(role, section, options)
    if declared is None:
        return settings
    return replace(settings, released_at_zero=declared.released_at_zero, dead_band=declared.dead_band)


def _limits(section: LimitsSection, load_torque_nm: float | None) -> Limits:
    values = section.model_dump(exclude={"stale_after_s", "stall_after_s"})
    if load_torque_nm is not None:
        values["load_torque_nm"] = load_torque_nm
    return Limits(
        **values,
        stale_after_ns=round(section.stale_after_s * 1e9),
        stall_after_ns=round(section.stall_after_s * 1e9),
    )
