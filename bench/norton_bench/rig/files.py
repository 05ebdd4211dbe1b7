"""Files that a user wrote: read, with every mistake in one sentence, its place and the remedy."""

import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from norton_bench.errors import UsageError, nearest

NEIGHBOURS = 5  # are offered in the place of a file that is not there
# What to do with a file of each kind that was given in the place of another.
MENDS = {
    "rig file": "norton-bench identify RIG runs the standard session on it, norton-bench run SESSION --rig RIG another",
    "session file": "norton-bench run SESSION runs it, on the rig that it names or on that of --rig",
    "column map": "norton-bench fit LOG --columns MAP reads a log by it",
    "arm file": "norton-bench joints ARM measures the arm",
    "recording": "norton-bench fit RECORDING fits it again, norton-bench info RECORDING says what it holds",
}


def read_text(path: Path, kind: str, error: type[UsageError] = UsageError) -> str:
    """TOML files as users write them: read, with a sentence for every way in which that can fail.

    The content of the file; ``kind`` ("rig file") names it. Raises ``error`` in one sentence.
    """
    try:
        return path.read_text(encoding="utf-8-sig")  # Windows' editors put a mark at the beginning
    except FileNotFoundError:
        raise error(f"{path}: no such {kind}; {_neighbours(path, kind)}") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder; {_neighbours(path / 'x', kind)}") from None
    except UnicodeDecodeError as wrong:
        if path.suffix.lower() == ".mcap":
            raise error(f"{path}: is a recording, not a {kind}; {MENDS['recording']}") from None
        raise error(f"{path}: is not text (byte {wrong.start} is not UTF-8); give a {kind} in TOML") from None
    except OSError as wrong:
        raise error(f"{path}: cannot be read ({wrong.strerror}); check its permissions") from None


def parse_toml(text: str, place: str, error: type[UsageError] = UsageError) -> dict[str, Any]:
    """The tables in ``text``. Raises ``error`` with line and column where it is not TOML."""
    text = text.removeprefix("\ufeff")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as wrong:
        if text.lstrip().startswith("{"):
            raise error(f"{place}: is JSON, not TOML; is it a network file? norton-bench network show FILE") from None
        raise error(f"{place}: is not TOML: {wrong}; check quotes, brackets and repeated keys there") from None


def check_kind(tables: Mapping[str, Any], kind: str, place: str, error: type[UsageError] = UsageError) -> None:
    """Raises ``error`` where a file that was read as a ``kind`` ("rig file") is one of another kind."""
    result = _kind_of(tables)
    if result not in ("", kind):
        raise error(f"{place}: is {_with_article(result)}, not {_with_article(kind)}; {MENDS[result]}")


def _with_article(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def _kind_of(tables: Mapping[str, Any]) -> str:
    """What the tables say the file is, by those that only one kind has; empty where they do not tell."""
    if isinstance(tables.get("step"), list):
        return "session file"
    if isinstance(tables.get("columns"), dict):
        return "column map"
    if isinstance(tables.get("joints"), dict):
        return "arm file"
    if isinstance(tables.get("actuator"), dict) and ("limits" in tables or "rig" in tables):
        return "rig file"
    return ""


def _kind_of_file(path: Path) -> str:
    with suppress(OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return _kind_of(tomllib.loads(path.read_text(encoding="utf-8-sig")))
    return ""


def _neighbours(path: Path, kind: str) -> str:
    """The mend for a file that is not there: those of its kind that lie where it was looked for, or else those that do
    not tell of which kind they are."""
    kinds = {near: _kind_of_file(near) for near in sorted(path.parent.glob("*.toml"))}
    result = [near for near, its in kinds.items() if its == kind] or [near for near, its in kinds.items() if not its]
    if result:
        return f"there are: {', '.join(map(str, result[:NEIGHBOURS]))}"
    return f"there is none in {path.parent}; check the path, or copy the shipped ones: norton-bench examples ."


Section = TypeVar("Section", bound=BaseModel)

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
KINDS = {
    "string_type": "a text in quotes",
    "string_too_short": "a text",
    "string_pattern_mismatch": 'a plain name of letters, digits, ".", "_" and "-"',
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "dict_type": "a table { key = value }",
    "model_type": "a table { key = value }",
    "list_type": "a list [ ... ]",
    "tuple_type": "a list [ ... ]",
}
BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


# What is wrong in a file that a user wrote: every mistake in one sentence, with its place and the remedy.
@dataclass
class Mistakes:
    """The mistakes found so far in the file ``place``."""

    place: str
    sentences: list[str] = field(default_factory=list)

    def add(self, where: str, text: str) -> None:
        """Note a mistake at ``where``, e.g. ``[limits] torque``."""
        self.sentences.append(": ".join(filter(None, (self.place, where, text))))

    def raise_as(self, error: type[UsageError]) -> None:
        """Raise all of them at once, one a line, where there are any."""
        if self.sentences:
            raise error("\n".join(self.sentences))

    def read(
        self,
        model: type[Section],
        table: object,
        where: str,
        context: Mapping[str, Any] | None = None,
        also_known: Iterable[str] = (),
    ) -> Section | None:
        """``table`` as a ``model``; None, with every mistake noted, where it is not one.

        ``also_known`` are keys that may stand there too, and are read elsewhere.
        """
        if not isinstance(table, dict):
            self.add(f"[{where}]", f"is a section, not {toml(table)}; write [{where}] on a line of its own")
            return None
        try:
            # Keys as users write them: a model that programs fill, too, has names with units for the same fields.
            return model.model_validate(table, context=dict(context or {}), by_alias=True, by_name=False)
        except ValidationError as error:
            for details in error.errors():
                self._add_details(details, model, table, where, also_known)
            return None

    def _add_details(
        self, details: ErrorDetails, model: type[BaseModel], table: object, where: str, also_known: Iterable[str]
    ) -> None:
        path = [step for step in details["loc"] if step != "[key]"]
        names = [step for step in path if isinstance(step, str)]
        key = names.pop() if path and isinstance(path[-1], str) else ""
        inner = _model_at(model, names)
        written = _dig(table, path)
        *tables, last = _counted(path) or [""]
        section = ".".join(filter(None, [where, *tables]))
        text = sentence(details, inner, key, written, () if tables else also_known)
        self.add(" ".join(filter(None, [section and f"[{section}]", last])), text)


def sentence(
    details: ErrorDetails, model: type[BaseModel], key: str, written: object, also_known: Iterable[str] = ()
) -> str:
    """One mistake that pydantic found, in words, with the remedy; ``written`` is what the file says there.

    ``also_known`` are keys that may stand there beside those of the model.
    """
    keys = keys_of(model)
    example = example_of(keys[key]) if key in keys else ""
    kind = details["type"]
    if kind == "missing":
        return f"is missing; add {key} = {example}"
    if kind == "extra_forbidden":
        return f"unknown key; {nearest(key, (*keys, *also_known))}"
    if kind == "value_error":
        return str(details["ctx"]["error"])
    if kind == "literal_error":
        return f"{toml(written)} is not allowed; write {details['ctx']['expected'].replace(chr(39), chr(34))}"
    if kind in BOUNDS:
        bound, words = BOUNDS[kind]
        return f"{toml(written)} must be {words} {details['ctx'][bound]:g}" + _like(example)
    return f"expected {KINDS.get(kind, details['msg'])}, not {toml(written)}" + _like(example)


def keys_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The keys of a section as a user writes them."""
    return {info.alias or name: info for name, info in model.model_fields.items()}


def toml(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # whose escapes are TOML's too
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml(inner) for inner in value) + "]"
    return str(value)


def _key(key: str) -> str:
    return key if BARE_KEY.fullmatch(key) else toml(key)


def example_of(info: FieldInfo) -> str:
    """What could stand there: the field's own example, or else its description."""
    if info.examples:
        return toml(info.examples[0])
    return f"... ({info.description})" if info.description else "..."


def _like(example: str) -> str:
    return f"; write it like {example}" if example else ""


def _model_at(model: type[BaseModel], tables: list[str]) -> type[BaseModel]:
    for table in tables:
        info = keys_of(model).get(table)
        model = (info and _model_in(info.annotation)) or model
    return model


def _model_in(annotation: object) -> type[BaseModel] | None:
    """The model that a field is declared as, also where it may be None or has validators."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_model_in, get_args(annotation))), None)


def _dig(table: object, path: list[str | int]) -> object:
    for step in path:
        if isinstance(step, int):
            table = table[step] if isinstance(table, list) else table
        else:
            table = table.get(step) if isinstance(table, dict) else table
    return table


def _counted(path: list[str | int]) -> list[str]:
    """The steps of a path as a user counts them: one of a list is named after the list, from 1 on."""
    steps: list[str] = []
    for step in path:
        if isinstance(step, int) and steps:
            steps[-1] += f" {step + 1}"
        else:
            steps.append(str(step))
    return steps
