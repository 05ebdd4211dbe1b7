"""A driver's options as questions: those that it needs are asked, the others stand in the file with their defaults."""

import json
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Protocol, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from norton_bench.errors import UsageError
from norton_bench.rig.driver_options import Declared, declared_by
from norton_bench.rig.files import keys_of, sentence, toml
from norton_bench.units import example, parse_quantity
from norton_drivers import registry
from norton_drivers.wiring import DeviceOptions, written_as


# A question of ``rig new``, and whoever answers it.
def anything(text: str) -> str:
    """Any answer will do."""
    return text


@dataclass(frozen=True)
class Question:
    """``key`` is where the answer goes in the rig file, e.g. "actuator.node"; ``check`` makes it what is written there.

    ``check`` raises ValueError, in a sentence, for what cannot be. No ``default``: it must be answered. Of ``choices``
    that are not ``listed`` the text names those that matter.
    """

    key: str
    text: str
    default: str | None = None
    example: str = ""
    choices: tuple[str, ...] = ()
    check: Callable[[str], str] = anything
    listed: bool = True

    def accept(self, text: str) -> str:
        """The answer as it will be written. Raises ValueError, in a sentence."""
        text = text.strip()
        if self.choices and text not in self.choices:
            raise ValueError(f'"{text}" is none of {", ".join(self.choices)}')
        return self.check(text)


class Asker(Protocol):
    """Answers questions: a person at a terminal, or what was said on the command line."""

    def ask(self, question: Question) -> str:
        """An answer that the question accepts. Raises UsageError where there is none."""
        ...

    def offers(self, key: str) -> bool:
        """Whether there is an answer to what would otherwise not be asked."""
        ...

    def tell(self, text: str) -> None:
        """Something that helps to answer what comes next."""
        ...


@dataclass
class Prepared:
    """Answers given beforehand, by key; the rest takes its default."""

    answers: dict[str, str]

    def __post_init__(self) -> None:
        self.asked: list[str] = []

    def ask(self, question: Question) -> str:
        self.asked.append(question.key)
        answer = self.answers.get(question.key, question.default)
        if answer is None:
            like = question.example or "..."
            one_of = f"; one of {', '.join(question.choices)}" if question.choices and question.listed else ""
            raise UsageError(
                f"{question.key} is not answered: add --set {question.key}={like} ({question.text}{one_of})"
            )
        try:
            return question.accept(answer)
        except ValueError as error:
            raise UsageError(f"--set {question.key}={answer}: {error}") from None

    def offers(self, key: str) -> bool:
        return key in self.answers

    def tell(self, text: str) -> None:
        """Nobody is there to read."""

    def check_used(self, keys: Iterable[str]) -> None:
        """Raises UsageError for an answer to what nobody asked."""
        for key in keys:
            if key not in self.asked:
                raise UsageError(f"--set {key}: nobody asked for that here; asked were {', '.join(self.asked)}")


COMMENT_AT = 36


# The sections of a rig file under way, and the file's text: every line with a comment on what it is.
@dataclass(frozen=True)
class RigFileLine:
    """``value`` is TOML already. What is not ``active`` is written as a comment, to show what there is."""

    key: str
    value: str
    comment: str = ""
    active: bool = True

    def text(self) -> str:
        return _commented(f"{'' if self.active else '# '}{self.key} = {self.value}", self.comment)


@dataclass
class Section:
    """``name`` as in [name]."""

    name: str
    comment: str = ""
    lines: list[RigFileLine] = field(default_factory=list)

    def add(self, key: str, value: str, comment: str = "", *, active: bool = True) -> None:
        self.lines.append(RigFileLine(key, value, comment, active))

    def text(self) -> str:
        return "\n".join([_commented(f"[{self.name}]", self.comment), *(line.text() for line in self.lines)])


def rig_text(sections: Iterable[Section]) -> str:
    """The whole file."""
    first = "# Written by `norton-bench rig new`; docs/rig-file.md explains every key, docs/devices.md every device."
    return "\n\n".join([first, *(section.text() for section in sections)]) + "\n"


def _commented(text: str, comment: str) -> str:
    return f"{text:<{COMMENT_AT - 1}} # {comment}" if comment else text


def quoted(text: str) -> str:
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False)


def ask_options(section: Section, declared: Declared, ask: Asker, preset: Mapping[str, str]) -> None:
    """A driver's options as questions: those that it needs are asked, the others stand in the file with their
    defaults.

    Add the driver's options to ``section``. A driver that declares none is left to its documentation.

    ``preset`` are options that this bench wants otherwise than by default, as TOML; they are not asked for.
    """
    if declared.model is None:
        ask.tell(f"[{section.name}] its driver does not say which options it has; add them to the file")
        return
    asked = {written_as(declared.model, name) for name in declared.model.asked}
    values: dict[str, object] = {}
    for key, info in keys_of(declared.model).items():
        unit, offered = declared.units.get(key), ask.offers(f"{section.name}.{key}")
        needed = info.is_required() or offered or key in asked or _is_missing(key, values, declared.model)
        if key in preset and not offered:
            section.add(key, preset[key], _said(info))
        elif needed:
            section.add(key, ask.ask(_question(section.name, key, info, unit, declared.model, values)), _said(info))
        elif (shown := _shown(info, unit)) is not None:
            section.add(key, shown, _said(info), active=False)
            continue
        else:
            continue
        values[key] = _read(section.lines[-1].value, unit)


def options_of(section: Section, declared: Declared) -> dict[str, object]:
    """The options that ``section`` has, as its driver gets them."""
    keys = keys_of(declared.model) if declared.model is not None else {}
    lines = (line for line in section.lines if line.active and line.key in keys)
    return {line.key: _read(line.value, declared.units.get(line.key)) for line in lines}


def _read(written: str, unit: str | None) -> object:
    value = tomllib.loads(f"x = {written}")["x"]
    return value if unit is None else parse_quantity(value, unit)


def _question(
    role: str,
    key: str,
    info: FieldInfo,
    unit: str | None,
    model: type[DeviceOptions],
    values: Mapping[str, object],
) -> Question:
    """``values`` are the options so far, which it must agree with."""
    check = _quantity(key, unit, model, values) if unit is not None else _value(key, model, values)
    # Without TOML's quotes, as it is typed.
    given = (str(info.examples[0]) if info.examples else example(unit)[1:-1] if unit else "").strip()
    default = None if info.is_required() or info.default is None else _shown(info, unit)
    typed = None if default is None else tomllib.loads(f"x = {default}")["x"]
    proposed = None if typed is None else typed if isinstance(typed, str) else toml(typed)
    return Question(f"{role}.{key}", _said(info) or key, proposed, example=given, choices=_choices(info), check=check)


def _quantity(key: str, unit: str, model: type[DeviceOptions], values: Mapping[str, object]) -> Callable[[str], str]:
    def check(text: str) -> str:
        fault = _fault(key, parse_quantity(text, unit), model, values)
        if fault:
            raise ValueError(fault)
        return quoted(text)

    return check


def _value(key: str, model: type[DeviceOptions], values: Mapping[str, object]) -> Callable[[str], str]:
    """As TOML where that is what the option takes (a number, a table), else as text."""

    def check(text: str) -> str:
        faults = []
        for value, written in _readings(text):
            fault = _fault(key, value, model, values)
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


def _fault(key: str, value: object, model: type[DeviceOptions], values: Mapping[str, object]) -> str:
    """What is wrong with this option beside the others, in words; nothing where it is right."""
    for details in _faults({**values, key: value}, model):
        if _key_of(details, model) == key:
            return sentence(details, model, key, value)
    return ""


def _is_missing(key: str, values: Mapping[str, object], model: type[DeviceOptions]) -> bool:
    """Whether the options so far cannot do without this one."""
    return any(_key_of(details, model) == key for details in _faults(values, model))


def _faults(values: Mapping[str, object], model: type[DeviceOptions]) -> list[ErrorDetails]:
    try:
        model.model_validate(dict(values))
    except ValidationError as error:
        return error.errors()
    return []


def _key_of(details: ErrorDetails, model: type[DeviceOptions]) -> str:
    return written_as(model, str(details["loc"][0])) if details["loc"] else ""


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


USUAL = "1 Mbit/s"
# What a drive takes of a bus in each tick, at most: its command and two messages, of 8 bytes and with 29-bit
# identifiers. ISO 11898-1: 67 + 64 bits each, of which about one in twenty is doubled by stuffing.
BITS_PER_TICK = 3 * round(1.05 * (67 + 64))
# A bus as busy as that holds frames back now and then (`rig check` says so, too).
MOST_LOAD = 0.9


def bitrate_for(devices: Sequence[tuple[str, str]], rate_hz: float) -> tuple[str, str]:
    """Which bitrate a bus needs: the one its devices are delivered with, where that is enough for what they say.

    The bitrate to propose for a bus with these devices, ``(role, driver)``, and what is to be said of it.
    """
    delivered = [(driver, bitrate) for role, driver in devices if (bitrate := _delivered(role, driver))]
    if not delivered:
        return USUAL, ""
    driver, bitrate = min(delivered, key=lambda each: parse_quantity(each[1], "bit/s"))
    drives = sum(role != "torque_sensor" for role, _ in devices)
    needed_bit_s = drives * BITS_PER_TICK * rate_hz
    if needed_bit_s <= MOST_LOAD * parse_quantity(bitrate, "bit/s"):
        return bitrate, f"{bitrate} as {driver} drives are delivered; as set in every device on it"
    return USUAL, (
        f"{driver} drives are delivered with {bitrate}, too little for {drives} of them at {rate_hz:g} Hz "
        f"(some {needed_bit_s / 1e3:.0f} kbit/s): set {USUAL} in every device on it, or give each a bus of its own"
        if drives > 1
        else f"{driver} drives are delivered with {bitrate}, too little at {rate_hz:g} Hz: set {USUAL} in the device"
    )


def data_bitrate_for(devices: Sequence[tuple[str, str]]) -> str | None:
    """What the data of CAN FD frames go at, where a device on the bus sends such."""
    declared = (declared_by(registry.group_of(role), driver).data_bitrate for role, driver in devices)
    return next(filter(None, declared), None)


def _delivered(role: str, driver: str) -> str | None:
    """The bitrate that its maker sets, where its driver knows one."""
    return declared_by(registry.group_of(role), driver).bitrate
