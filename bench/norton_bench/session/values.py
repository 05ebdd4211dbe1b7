"""Parameters of a session file: put in where they are named, set from outside, and swept."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.rig.files import nearest, toml
from norton_bench.units import RANGE

NAMED = re.compile(r"\$(\$|[A-Za-z_]\w*)")
NAME = re.compile(r"[A-Za-z_]\w*")
MOST_VALUES = 1000


@dataclass
class Values:
    """Parameters by name; ``used`` collects the names that were met."""

    given: Mapping[str, Any]
    used: set[str] = field(default_factory=set)

    def with_(self, more: Mapping[str, Any]) -> "Values":
        """For the inside of a sweep; what is met there is met here."""
        return Values({**self.given, **more}, self.used)

    def put_in(self, written: Any) -> Any:
        """``written`` with every ``$name`` replaced; a text that is nothing but one takes its value, of any kind.

        Raises ValueError, in a sentence, for a name that nobody gave a value.
        """
        if isinstance(written, dict):
            return {key: self.put_in(value) for key, value in written.items()}
        if isinstance(written, list):
            return [self.put_in(value) for value in written]
        if not isinstance(written, str):
            return written
        alone = NAMED.fullmatch(written)
        if alone is not None and alone[1] != "$":
            return self._of(alone[1])
        return NAMED.sub(lambda match: "$" if match[1] == "$" else str(self._of(match[1])), written)

    def _of(self, name: str) -> Any:
        if name not in self.given:
            raise ValueError(
                f"${name} is no parameter ({nearest(name, self.given)}); declare it in [parameters], or in `for`"
            )
        self.used.add(name)
        return self.given[name]


def sweeps(written: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of the values that ``for`` gives its names, the last name changing fastest.

    Raises ValueError, in a sentence, where a name or its values cannot be used.
    """
    for name in written:
        if not NAME.fullmatch(name):
            raise ValueError(f'"{name}" cannot be named as $...; use letters, digits and "_"')
    lists = [_values(name, values) for name, values in written.items()]
    combined = [dict(zip(written, values, strict=True)) for values in product(*lists)]
    if len(combined) > MOST_VALUES:
        raise ValueError(f"asks for {len(combined)} repetitions; at most {MOST_VALUES} are allowed")
    return combined


def _values(name: str, written: Any) -> Sequence[Any]:
    match = RANGE.fullmatch(written) if isinstance(written, str) else None
    if match is not None:
        return _ranged(written, float(match[1]), float(match[2]), float(match[3]), match[4])
    if not isinstance(written, list) or not written:
        raise ValueError(f'{name} needs its values: write {name} = ["20 %", "40 %"], or a range "20:10:60 %"')
    return written


def _ranged(written: str, first: float, step: float, last: float, unit: str) -> list[str]:
    count = (last - first) / step if step else -1.0
    if count >= MOST_VALUES:
        raise ValueError(f'the range "{written}" has more than {MOST_VALUES} values; make its step greater')
    if count < 0:
        raise ValueError(f'the range "{written}" does not get from its first value to its last; write first:step:last')
    return [f"{first + step * index:.12g} {unit}".strip() for index in range(int(count + 1e-9) + 1)]


def parsed(assignments: Sequence[str]) -> dict[str, Any]:
    """``["speed=40 rad/s", "levels=7"]`` by name: values as TOML reads them, else as text.

    Raises UsageError for one without a name, or given twice.
    """
    given: dict[str, Any] = {}
    for assignment in assignments:
        name, equals, written = assignment.partition("=")
        if not equals or not name:
            raise UsageError(f"--set {assignment}: write it like --set name=value")
        if name in given:
            raise UsageError(f"--set {name}: is given twice; give it once")
        given[name] = _value(written)
    return given


def _value(written: str) -> Any:
    try:
        return tomllib.loads(f"value = {written}")["value"]
    except tomllib.TOMLDecodeError:
        return written


def settled(declared: Mapping[str, Any], given: Mapping[str, Any], place: str) -> dict[str, Any]:
    """The parameters of the file at ``place`` with what was given instead. Raises UsageError for an unknown name."""
    for name, value in given.items():
        if name not in declared:
            raise UsageError(f"--set {name}={value}: {place} has no parameter {toml(name)}; {nearest(name, declared)}")
    return {**declared, **given}
