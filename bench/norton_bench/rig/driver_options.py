"""The options of a device as its driver declares them, so that a wrong one is told before anything is opened.

The module that a driver's entry point names may declare ``OPTION_UNITS`` (options that are quantities, and the unit in
which the driver wants them), ``OPTION_FILES`` (options that may name a file beside the rig file), ``CONNECTION``
("can" or "serial"), ``BITRATE`` (of a CAN device as it is delivered, "500 kbit/s"), ``DATA_BITRATE`` (the same for the
data of one that sends CAN FD frames) and one subclass of ``norton_drivers.wiring.DeviceOptions``;
``check_settings(settings)``, which raises WiringError for what only the files that the options name can tell; and,
where several such devices may share a serial port, ``check_port(settings, tick_ns)``, which raises WiringError where
the line cannot carry all of them in every tick. A driver that declares nothing checks its options itself.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from pydantic import ValidationError

from norton_bench.rig.files import Mistakes, example_of, keys_of, sentence, toml
from norton_bench.rig.rig import Rig
from norton_bench.rig.schema import DeviceSection
from norton_bench.units import conversion, parse_quantity
from norton_drivers import registry
from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceOptions, DeviceSettings, written_as


@dataclass(frozen=True)
class Declared:
    """What one driver says of its options."""

    units: Mapping[str, str]
    files: tuple[str, ...]
    model: type[DeviceOptions] | None
    connection: str | None = None  # "can" or "serial", where it says so
    bitrate: str | None = None  # of the bus, as its maker delivers the device
    data_bitrate: str | None = None  # the same of its data, where it sends CAN FD frames
    check: Callable[[DeviceSettings], None] | None = None
    check_port: Callable[[Sequence[DeviceSettings], int], None] | None = None  # where devices may share a port


def declared_by(group: str, driver: str) -> Declared:
    """Raises norton_drivers.errors.WiringError for a driver that is not installed."""
    factory = registry.load(group, driver, asked_by="driver")
    module = sys.modules[factory.__module__]
    units, files = getattr(module, "OPTION_UNITS", {}), getattr(module, "OPTION_FILES", ())
    names = ("CONNECTION", "BITRATE", "DATA_BITRATE", "check_settings", "check_port")
    told = (getattr(module, name, None) for name in names)
    return Declared(units, files, _model_in(module), *told)


def amplifier_options(driver: str, options: Mapping[str, Any]) -> DeviceOptions | None:
    """A drive's options as its driver reads them; None where it declares none, or where they are wrong."""
    with suppress(WiringError, ValidationError):
        model = declared_by(registry.AMPLIFIERS, driver).model
        return None if model is None else model.model_validate(dict(options))
    return None


def read_options(
    device: DeviceSection, declared: Declared, role: str, folder: Path, mistakes: Mistakes
) -> dict[str, Any]:
    """The options with quantities as numbers and files as paths; mistakes are noted."""
    written = device.driver_options
    options: dict[str, Any] = {}
    for key, value in written.items():
        try:
            options[key] = _converted(key, value, declared, folder)
        except ValueError as error:
            mistakes.add(f"[{role}] {key}", str(error))
    before = len(mistakes.sentences)
    if declared.model is not None:
        _check(declared.model, options, device, role, mistakes)
    if declared.check is not None and len(mistakes.sentences) == before:
        try:
            declared.check(DeviceSettings(role, device.driver, device.bus, device.port, device.direction, options))
        except WiringError as error:
            mistakes.add("", str(error))
    return options


def _converted(key: str, value: object, declared: Declared, folder: Path) -> object:
    if key in declared.units:
        return parse_quantity(value, declared.units[key])
    if key in declared.files and isinstance(value, str) and (folder / value).is_file():
        return str(folder / value)
    return value


def _check(
    model: type[DeviceOptions], options: dict[str, Any], device: DeviceSection, role: str, mistakes: Mistakes
) -> None:
    written, own = device.driver_options, keys_of(type(device))  # one of the section's own may have been meant
    told = set(written) - set(options)  # those that are no quantity: said already
    try:
        model.model_validate(options)
    except ValidationError as error:
        for details in error.errors():
            key = written_as(model, str(details["loc"][0])) if details["loc"] else ""
            if key not in told:
                text = sentence(details, model, key, written.get(key), own)
                mistakes.add(f"[{role}] {key}".strip(), _explained(text, model, key))


def _explained(text: str, model: type[DeviceOptions], key: str) -> str:
    """The sentence with what the option is, where it does not say so yet."""
    info = keys_of(model).get(key)
    if info is None or not info.description or info.description in text:
        return text
    return f"{text} ({info.description})"


def _model_in(module: ModuleType) -> type[DeviceOptions] | None:
    """Its own, or one that it takes from a module below its folder's name; not what all drivers share."""
    folder = module.__name__.rpartition(".")[0]
    classes = [each for each in vars(module).values() if isinstance(each, type) and issubclass(each, DeviceOptions)]
    own = (each for each in classes if each.__module__ in (module.__name__, f"{folder}.options"))
    return next(own, None)


LOAD_UNIT = "N*m"


# Whether each drive is commanded in the unit that it takes: one rule, for a rig file that is read, where the driver's
# options tell the unit, and for a drive that is open, where only that does.
class Commanded(Protocol):
    """What is commanded: its unit, and the one in which the drive takes the same number, where that is another."""

    @property
    def unit(self) -> str: ...
    @property
    def sent_as(self) -> str | None: ...


def wrong_unit_of(rig: Rig, settings: DeviceSettings, takes: str) -> str:
    """What is wrong with a drive of ``rig`` that ``takes`` commands in this unit, with its place; "" for nothing."""
    command = {"actuator": rig.command, "modulator": rig.modulation}.get(settings.role)
    result = wrong_unit(settings.role, settings.driver, settings.options, command, takes)
    return "" if result is None else ": ".join(result)


def wrong_unit(
    role: str, driver: str, options: Mapping[str, Any], command: Commanded | None, takes: str
) -> tuple[str, str] | None:
    """Where, and what is wrong with the remedy; None where the drive ``takes`` commands in the unit that it is sent.

    ``command`` is None for a load, which is commanded in newton metres.
    """
    sent = LOAD_UNIT if command is None else command.sent_as or command.unit
    if same_unit(sent, takes):
        return None
    settings = options_for(driver, options, sent)
    message = f'driver = "{driver}" as it is set here takes commands in "{takes}"'
    if command is None:
        where = next(iter(settings), "driver")
        mend = f"write {in_words(settings)}" if settings else "take another driver"
        return f"[{role}] {where}", f"{message}, but a load is commanded in newton metres; {mend}"
    key = "unit" if command.sent_as is None else "sent_as"
    mend = f'write {key} = "{takes}"' + (f", or {in_words(settings)} in [{role}]" if settings else "")
    return f"[{role}.command] {key}", f'"{sent}", but {message}; {mend}'


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
