"""Whether each drive is commanded in the unit that it takes: one rule, for a rig file that is read, where the driver's
options tell the unit, and for a drive that is open, where only that does."""

from collections.abc import Mapping
from typing import Any, Protocol

from pydantic import ValidationError

from norton_bench.rig.driver_options import declared_by
from norton_bench.rig.mistakes import example_of, keys_of, toml
from norton_bench.rig.rig import Rig
from norton_bench.units import conversion
from norton_drivers import registry
from norton_drivers.errors import WiringError
from norton_drivers.options import DeviceOptions, written_as
from norton_drivers.wiring import DeviceSettings

LOAD_UNIT = "N*m"


class Commanded(Protocol):
    """What is commanded: its unit, and the one in which the drive takes the same number, where that is another."""

    @property
    def unit(self) -> str: ...
    @property
    def sent_as(self) -> str | None: ...


def wrong_unit_of(rig: Rig, settings: DeviceSettings, takes: str) -> str:
    """What is wrong with a drive of ``rig`` that ``takes`` commands in this unit, with its place; "" for nothing."""
    command = {"actuator": rig.command, "modulator": rig.modulation}.get(settings.role)
    found = wrong_unit(settings.role, settings.driver, settings.options, command, takes)
    return "" if found is None else ": ".join(found)


def wrong_unit(
    role: str, driver: str, options: Mapping[str, Any], command: Commanded | None, takes: str
) -> tuple[str, str] | None:
    """Where, and what is wrong with the mend; None where the drive ``takes`` commands in the unit that it is sent.

    ``command`` is None for a load, which is commanded in newton metres.
    """
    sent = LOAD_UNIT if command is None else command.sent_as or command.unit
    if same_unit(sent, takes):
        return None
    settings = options_for(driver, options, sent)
    said = f'driver = "{driver}" as it is set here takes commands in "{takes}"'
    if command is None:
        where = next(iter(settings), "driver")
        mend = f"write {in_words(settings)}" if settings else "take another driver"
        return f"[{role}] {where}", f"{said}, but a load is commanded in newton metres; {mend}"
    key = "unit" if command.sent_as is None else "sent_as"
    mend = f'write {key} = "{takes}"' + (f", or {in_words(settings)} in [{role}]" if settings else "")
    return f"[{role}.command] {key}", f'"{sent}", but {said}; {mend}'


def options_for(driver: str, options: Mapping[str, Any], unit: str) -> dict[str, str]:
    """What the driver's options must be for commands in ``unit``, as TOML; with an example where only the user knows
    the value. Nothing where the driver cannot, or does not say."""
    try:
        model = declared_by(registry.AMPLIFIERS, driver).model
    except WiringError:
        return {}
    if model is None or unit not in model.command_units:
        return {}
    chosen = {written_as(model, name): value for name, value in model.command_units[unit].items()}
    missing = _at_fault(model, {**options, **chosen}) - _at_fault(model, options)
    keys = keys_of(model)
    examples = {key: example_of(keys[key]) for key in keys if key in missing}
    return {**{key: toml(value) for key, value in chosen.items()}, **examples}


def in_words(settings: Mapping[str, str]) -> str:
    """As they would stand in the rig file."""
    return " and ".join(f"{key} = {value}" for key, value in settings.items())


def _at_fault(model: type[DeviceOptions], options: Mapping[str, Any]) -> set[str]:
    """The options that are missing or wrong."""
    try:
        model.model_validate(dict(options))
    except ValidationError as error:
        return {written_as(model, str(details["loc"][0])) for details in error.errors() if details["loc"]}
    return set()


def same_unit(unit: str, other: str) -> bool:
    """Whether a number means the same in both."""
    try:
        return conversion(unit, other) == (1.0, 0.0)
    except ValueError:
        return False
