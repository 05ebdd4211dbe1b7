"""A column map file to a :class:`ColumnMap`: every mistake in it is told at once, in a sentence each."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from norton_bench.errors import UsageError
from norton_bench.logs.schema import (
    ActuatorSection,
    ColumnSection,
    ColumnsSection,
    FilterSection,
    Given,
    LoadSection,
    LogSection,
    LoopSection,
    MapFile,
    ModelSection,
    SplitSection,
)
from norton_bench.rig.files import check_kind, parse_toml, read_text
from norton_bench.rig.mistakes import Mistakes
from norton_bench.units import conversion


@dataclass(frozen=True)
class Units:
    """The SI units of a log: those of motion and exertion, and of the command, which keeps its own.

    ``drive`` is the unit of what acts on the motor: volt where the command is the share of a supply.
    """

    motion: str
    exertion: str
    inertia: str
    command: str
    drive: str

    @classmethod
    def of(cls, motion: str, command: str, *, supplied: bool) -> "Units":
        drive = "V" if supplied else command
        if motion == "translation":
            return cls("m", "N", "kg", command, drive)
        return cls("rad", "N*m", "kg*m^2", command, drive)

    @property
    def columns(self) -> Mapping[str, str]:
        """The unit that each column is converted to."""
        return {
            "time": "s",
            "position": self.motion,
            "velocity": f"{self.motion}/s",
            "command": self.command,
            "exertion": self.exertion,
            "goal": self.motion,
            "enabled": "",
            "supply": "V",
            "temperature": "degC",
            "normal": "N",
        }

    @property
    def gain(self) -> str:
        """The unit of exertion per drive."""
        return f"{self.exertion}/({self.drive})" if self.drive else self.exertion

    @property
    def givens(self) -> Mapping[tuple[str, str], str]:
        """The unit of each number that a section may give."""
        command = self.command or "1"
        return {
            ("actuator", "torque_gain"): self.gain,
            ("actuator", "resistance"): "ohm",
            ("load", "inertia"): self.inertia,
            ("load", "gravity"): self.exertion,
            ("load", "gravity_zero"): self.motion,
            ("loop", "proportional"): f"({command})/{self.motion}",
            ("loop", "derivative"): f"({command})*s/{self.motion}",
            ("loop", "limit"): self.command,
            ("model", "cogging_period"): self.motion,
        }


@dataclass(frozen=True)
class ColumnMap:
    """What a log's columns mean. ``place`` is the file it came from."""

    place: str
    units: Units
    title: str
    source: str
    log: LogSection
    columns: ColumnsSection
    actuator: ActuatorSection
    load: LoadSection
    loop: LoopSection | None
    model: ModelSection
    filter: FilterSection
    split: SplitSection

    @property
    def translation(self) -> bool:
        return self.log.motion == "translation"

    def mapped(self) -> Mapping[str, ColumnSection]:
        """The columns that the map names, by what they hold."""
        every = {name: getattr(self.columns, name) for name in ColumnsSection.model_fields}
        return {name: column for name, column in every.items() if column is not None}

    def givens(self) -> Mapping[tuple[str, str], Given]:
        """The numbers that the map gives, by section and key."""
        sections = {name: getattr(self, name) for name, _ in self.units.givens}
        every = {(name, key): getattr(sections[name], key, None) for name, key in self.units.givens}
        return {place: given for place, given in every.items() if given is not None}


def load_map(path: Path) -> ColumnMap:
    """The column map in the file. Raises UsageError: one line for each mistake, with its place and the mend."""
    return parse_map(read_text(path, "column map"), place=str(path))


def parse_map(text: str, *, place: str) -> ColumnMap:
    """As :func:`load_map`, from the file's content."""
    mistakes = Mistakes(place)
    written = parse_toml(text, place)
    check_kind(written, "column map", place)
    read = mistakes.read(MapFile, written, "")
    mistakes.raise_as(UsageError)
    assert read is not None  # it was told, and raised, otherwise
    command, supply = read.columns.command, read.columns.supply
    units = Units.of(read.log.motion, command.unit if command else "", supplied=supply is not None)
    made = ColumnMap(place=place, units=units, **dict(read))
    _check_units(made, mistakes)
    _check_sense(made, mistakes)
    mistakes.raise_as(UsageError)
    return made


def _check_units(column_map: ColumnMap, mistakes: Mistakes) -> None:
    """Every unit must be of the dimension that is meant: an angle is not a length."""
    for name, column in column_map.mapped().items():
        _check_unit(column.unit, column_map.units.columns[name], f"[columns.{name}] unit", mistakes)
    for (section, key), given in column_map.givens().items():
        _check_unit(given.unit, column_map.units.givens[section, key], f"[{section}] {key}", mistakes)


def _check_unit(unit: str, wanted: str, where: str, mistakes: Mistakes) -> None:
    try:
        conversion(unit, wanted)
    except ValueError as wrong:
        mistakes.add(where, str(wrong))


def _check_sense(column_map: ColumnMap, mistakes: Mistakes) -> None:
    """What must be there for anything to be learned."""
    columns = column_map.columns
    if columns.supply is not None and (columns.command is None or columns.command.unit):
        mistakes.add(
            "[columns] supply", "is for a command that is a share of it, a plain number; leave one of them out"
        )
    if columns.time is None and column_map.log.rate_hz is None:
        mistakes.add("[columns] time", 'is missing; add time = { name = "t", unit = "s" }, or [log] rate = "1 kHz"')
    if columns.position is None and columns.velocity is None:
        mistakes.add(
            "[columns] position", f'is missing; add position = {{ name = "q", unit = "{column_map.units.motion}" }}'
        )
    if columns.command is None and columns.exertion is None:
        mistakes.add("[columns]", "neither command nor exertion is given; add the one that the log holds")
    if columns.command is None and column_map.actuator.torque_gain is not None:
        mistakes.add("[actuator] torque_gain", "has no command to act on; add [columns] command, or leave it out")
    if column_map.loop is not None and columns.goal is None:
        mistakes.add("[loop]", "needs a goal; add [columns] goal, or leave [loop] out")
    if column_map.model.temperature and columns.temperature is None:
        mistakes.add("[model] temperature", 'needs one; add [columns] temperature = "name", or leave it out')
    if column_map.model.refine is not None:
        _check_refinement(column_map, mistakes)


def _check_refinement(column_map: ColumnMap, mistakes: Mistakes) -> None:
    """What a motion is simulated from, and what gives it a scale."""
    columns = column_map.columns
    if columns.position is None or columns.command is None:
        mistakes.add("[model] refine", "needs a position to follow and a command; map both, or leave it out")
    if columns.exertion is not None:
        mistakes.add("[model] refine", "is for a log without a torque sensor; leave it out, or the exertion")
    if column_map.load.inertia is None:
        mistakes.add("[model] refine", 'needs a known load; add [load] inertia = "0.005 kg*m^2", or leave it out')
