"""A driver's options as questions: those that it needs are asked, the others stand in the file with their defaults."""

import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from math import isfinite
from typing import Any, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from norton_bench.rig.driver_options import Declared
from norton_bench.rig.mistakes import keys_of, sentence, toml
from norton_bench.rig.new.questions import Asker, Question
from norton_bench.rig.new.text import Section, quoted
from norton_bench.units import example, parse_quantity
from norton_drivers.options import DeviceOptions


def ask_options(section: Section, declared: Declared, ask: Asker) -> None:
    """Add the driver's options to ``section``. A driver that declares none is left to its documentation."""
    if declared.model is None:
        ask.tell(f"[{section.name}] its driver does not say which options it has; add them to the file")
        return
    for key, info in keys_of(declared.model).items():
        unit = declared.units.get(key)
        question = _question(section.name, key, info, unit, declared.model)
        if info.is_required() or ask.offers(question.key):
            section.add(key, ask.ask(question), _said(info))
        elif (shown := _shown(info, unit)) is not None:
            section.add(key, shown, _said(info), active=False)


def _question(role: str, key: str, info: FieldInfo, unit: str | None, model: type[DeviceOptions]) -> Question:
    check = _quantity(key, unit, model) if unit is not None else _value(key, model)
    # Without TOML's quotes, as it is typed.
    given = (str(info.examples[0]) if info.examples else example(unit)[1:-1] if unit else "").strip()
    return Question(f"{role}.{key}", _said(info) or key, example=given, choices=_choices(info), check=check)


def _quantity(key: str, unit: str, model: type[DeviceOptions]) -> Callable[[str], str]:
    def check(text: str) -> str:
        fault = _fault(key, parse_quantity(text, unit), model)
        if fault:
            raise ValueError(fault)
        return quoted(text)

    return check


def _value(key: str, model: type[DeviceOptions]) -> Callable[[str], str]:
    """As TOML where that is what the option takes (a number, a table), else as text."""

    def check(text: str) -> str:
        faults = []
        for value, written in _readings(text):
            fault = _fault(key, value, model)
            if not fault:
                return written
            faults.append(fault)
        raise ValueError(faults[0])

    return check


def _readings(text: str) -> Iterator[tuple[Any, str]]:
    """What a typed answer can mean, the likeliest first, and how each is written."""
    with suppress(tomllib.TOMLDecodeError):
        value = tomllib.loads(f"x = {text}")["x"]
        if not isinstance(value, str):
            yield value, text
    yield text, quoted(text)


def _fault(key: str, value: object, model: type[DeviceOptions]) -> str:
    """What is wrong with this one option, in words; nothing where it is right."""
    try:
        model.model_validate({key: value})
    except ValidationError as error:
        for details in error.errors():
            if details["loc"] and details["loc"][0] == key:
                return sentence(details, model, key, value)
    return ""


def _choices(info: FieldInfo) -> tuple[str, ...]:
    values = get_args(info.annotation)
    return tuple(values) if values and all(isinstance(value, str) for value in values) else ()


def _shown(info: FieldInfo, unit: str | None) -> str | None:
    """An option's default as TOML, or an example where it has none that can be written."""
    default: object = info.default
    if unit is not None and isinstance(default, (int, float)) and isfinite(default):
        return quoted(f"{default:g} {unit}".strip())
    if default is not None and unit is None:
        return _toml(default)
    return _toml(info.examples[0]) if info.examples else None


def _toml(value: object) -> str | None:
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Mapping):
        return toml(dict(value))
    if isinstance(value, (bool, int, list)) or (isinstance(value, float) and isfinite(value)):
        return toml(value)
    return None


def _said(info: FieldInfo) -> str:
    return " ".join((info.description or "").split())
