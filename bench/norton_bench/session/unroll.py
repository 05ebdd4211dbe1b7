"""From the tables of a session file to its steps: parameters replaced, sweeps and repetitions expanded, groups
nested."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from norton_bench.errors import UsageError, nearest
from norton_bench.procedures.options import STEPS
from norton_bench.rig.files import Mistakes, toml
from norton_bench.session.items import ASK, CONTROL, GROUP, MODELS, Block, Condition, ControlModel, Item, Step
from norton_bench.units import RANGE

NAMED = re.compile(r"\$(\$|[A-Za-z_]\w*)")
NAME = re.compile(r"[A-Za-z_]\w*")
MOST_VALUES = 1000


@dataclass
class Values:
    """The parameters of a session file, by name: from the file, from ``--set``, and from sweeps.

    ``used`` collects the names that were replaced.
    """

    given: Mapping[str, Any]
    used: set[str] = field(default_factory=set)

    def with_(self, more: Mapping[str, Any]) -> "Values":
        """These and ``more``, for the inside of a sweep; both share ``used``."""
        return Values({**self.given, **more}, self.used)

    def put_in(self, written: Any) -> Any:
        """``written`` with every ``$name`` replaced. A text that is only ``$name`` becomes the value itself, of any
        type.

        Raises ValueError for a name without a value.
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

    Raises ValueError where a name or its values cannot be used.
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
        raise ValueError(f'the range "{written}" has more than {MOST_VALUES} values; give it a larger step')
    if count < 0:
        raise ValueError(f'the step of the range "{written}" leads away from its last value; write first:step:last')
    return [f"{first + step * index:.12g} {unit}".strip() for index in range(int(count + 1e-9) + 1)]


def parsed(assignments: Sequence[str]) -> dict[str, Any]:
    """Parse ``["speed=40 rad/s", "levels=7"]``; by name. A value is read as TOML if it is TOML, else it is a text.

    Raises UsageError for an assignment without a name, and for a name given twice.
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
    """The parameters of the file at ``place``, with the ``given`` values. Raises UsageError for an unknown name."""
    for name, value in given.items():
        if name not in declared:
            raise UsageError(f"--set {name}={value}: {place} has no parameter {toml(name)}; {nearest(name, declared)}")
    return {**declared, **given}


MOST_STEPS = 10_000
KNOWN = (*MODELS, GROUP)
# Every step but a prompt may have this key: the modulations of the impedance under which it runs.
MODULATION = "modulation"
MODULATION_MEND = 'write it like "2 N*m/rad", or a list of such quantities'


@dataclass
class ReadSteps:
    """The ``steps`` in order, and those that ``always`` run at the end."""

    steps: list[Item] = field(default_factory=list)
    always: list[Item] = field(default_factory=list)


@dataclass
class Unroller:
    """Reads the tables of one file, and collects its mistakes."""

    mistakes: Mistakes
    _count: int = field(default=0, init=False)

    def read(self, tables: Sequence[object], values: Values) -> ReadSteps:
        """All steps of the file."""
        read = ReadSteps()
        for number, table in enumerate(tables, 1):
            items, always = self._read(table, str(number), values)
            if always:
                read.always += items
            elif read.always and items:
                self.mistakes.add(f"[step {number}]", "comes after a step with always = true; these must be the last")
            else:
                read.steps += items
        return read

    def _read(self, table: object, number: str, values: Values) -> tuple[list[Item], bool]:
        where = f"step {number}"
        if not isinstance(table, dict):
            self.mistakes.add(f"[{where}]", f"is a section, not {toml(table)}; write [[step]] on a line of its own")
            return [], False
        do = table.get("do")
        if do is None:
            self.mistakes.add(f"[{where}] do", f"is missing; add do = ... (one of {', '.join(KNOWN)})")
            return [], False
        if not isinstance(do, str) or do not in KNOWN:
            self.mistakes.add(f"[{where}] do", f"{toml(do)} is not a procedure; {nearest(str(do), KNOWN)}")
            return [], False
        where = f"{where}, {do}"
        control = self._control(table, where, values)
        if control is None:
            return [], False
        return self._written_out(table, do, where, number, control, values), control.always

    def _control(self, table: Mapping[str, Any], where: str, values: Values) -> ControlModel | None:
        written = self._put_in({key: value for key, value in table.items() if key in CONTROL}, where, values)
        return None if written is None else self.mistakes.read(ControlModel, written, where)

    def _written_out(
        self, table: Mapping[str, Any], do: str, where: str, number: str, control: ControlModel, values: Values
    ) -> list[Item]:
        try:
            swept = sweeps(control.sweep)
        except ValueError as error:
            self.mistakes.add(f"[{where}] for", str(error))
            return []
        items: list[Item] = []
        for combination in swept:
            for turn in range(1, control.repeat + 1):
                label = _label(combination, turn, control.repeat)
                before = len(self.mistakes.sentences)
                body = self._body(table, do, where, number, values.with_(combination), label)
                items += _controlled(body, control, do, where)
                self._count += len(body)
                # A mistake that repeats in every repetition is reported once.
                if len(self.mistakes.sentences) > before or self._too_many(where):
                    return items
        return items

    def _too_many(self, where: str) -> bool:
        if self._count > MOST_STEPS:
            self.mistakes.add(f"[{where}]", f"makes more than {MOST_STEPS} steps of the session; repeat less")
        return self._count > MOST_STEPS

    def _body(
        self, table: Mapping[str, Any], do: str, where: str, number: str, values: Values, label: str
    ) -> list[Item]:
        rest = {key: value for key, value in table.items() if key != "do" and key not in CONTROL}
        if do == GROUP:
            return self._group(rest, where, number, values, label)
        written = self._put_in(rest, where, values)
        if written is None:
            return []
        modulations = self._modulations(written.pop(MODULATION, []), where) if do in STEPS else ()
        options = self.mistakes.read(MODELS[do], written, where, also_known=(*CONTROL, MODULATION))
        if options is None:
            return []
        return [Step(do, options, label=label, where=where, modulations=modulations)]

    def _modulations(self, written: object, where: str) -> tuple[str, ...]:
        """Quantities; their unit depends on the rig, and is checked later."""
        quantities = written if isinstance(written, list) else [written]
        if not all(isinstance(each, str) for each in quantities):
            self.mistakes.add(f"[{where}] {MODULATION}", f"{toml(written)} is not a quantity; {MODULATION_MEND}")
            return ()
        return tuple(quantities)

    def _group(self, rest: Mapping[str, Any], where: str, number: str, values: Values, label: str) -> list[Item]:
        tables = rest.get("step")
        for key in rest:
            if key != "step":
                self.mistakes.add(f"[{where}] {key}", f"unknown key; {nearest(key, ('step', *CONTROL))}")
        if not isinstance(tables, list) or not tables:
            self.mistakes.add(f"[{where}]", 'holds no step; add [[step.step]] with do = "imposed" below it')
            return []
        items: list[Item] = []
        for inner, table in enumerate(tables, 1):
            inside, always = self._read(table, f"{number}.{inner}", values)
            if always:
                self.mistakes.add(f"[step {number}.{inner}] always", "is for steps of the file itself, not of a group")
            items += inside
        return [_labelled(item, label) for item in items]

    def _put_in(self, written: Mapping[str, Any], where: str, values: Values) -> dict[str, Any] | None:
        filled = {}
        for key, value in written.items():
            try:
                filled[key] = values.put_in(value)
            except ValueError as error:
                self.mistakes.add(f"[{where}] {key}", str(error))
                return None
        return filled


def _controlled(body: list[Item], control: ControlModel, do: str, where: str) -> list[Item]:
    when = None if control.when is None else control.when.condition()
    until = control.repeat_until
    if until is not None:
        return [Block(tuple(body), when, until.condition(), until.at_most, where)] if body else []
    if when is None:
        return body
    if do == GROUP:
        return [Block(tuple(body), when, where=where)]
    return [_when(item, when) for item in body]


def _when(item: Item, when: Condition) -> Item:
    return replace(item, when=when)


def _label(combination: Mapping[str, Any], turn: int, turns: int) -> str:
    parts = [f"{name} = {value}" for name, value in combination.items()]
    if turns > 1:
        parts.append(f"{turn} of {turns}")
    return ", ".join(parts)


def _labelled(item: Item, label: str) -> Item:
    if not label:
        return item
    if isinstance(item, Block):
        return replace(item, steps=tuple(_labelled(inner, label) for inner in item.steps))
    return replace(item, label=", ".join(filter(None, (label, item.label))))


def asks(step: Step) -> bool:
    """Whether the step is a prompt."""
    return step.do == ASK
