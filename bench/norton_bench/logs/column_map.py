"""A column map file to a :class:`ColumnMap`: every mistake in it is told at once, in a sentence each."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from norton_bench.errors import UsageError
from norton_bench.logs.log_units import Units
from norton_bench.rig.files import Mistakes, check_kind, parse_toml, read_text, toml
from norton_bench.units import QUANTITY, check_unit, conversion, quantity_in

UnitText = Annotated[str, BeforeValidator(lambda text: check_unit(text) if isinstance(text, str) else text)]


# The sections of a column map, as they are written; ``docs/logs.md`` explains them.
class MapSection(BaseModel):
    """Base of every section: nothing is guessed, nothing unknown is passed over."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


class Given(MapSection):
    """A number known beforehand: ``"35 N/V"``, or the product of numbers that stand in the log itself."""

    key: str | None = Field(None, examples=["mass"])
    keys: tuple[str, ...] = Field((), examples=[["mass", "length"]])
    number: float = Field(1.0, alias="scale", examples=[9.81])
    unit: UnitText = Field("", examples=["kg"])
    default: float | None = Field(None, examples=[1.0])
    optional: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Every name in the log whose number is a factor."""
        return (*self.keys, *((self.key,) if self.key is not None else ()))


def _given(written: object) -> object:
    """A quantity in quotes, a bare number or a table, as the table."""
    if isinstance(written, (int, float)) and not isinstance(written, bool):
        return {"scale": float(written)}
    if isinstance(written, str):
        match = QUANTITY.fullmatch(written)
        if match is None:
            raise ValueError(
                f'{toml(written)} is not a quantity; write it like "1 kg", or {{ key = "mass", unit = "kg" }}'
            )
        return {"scale": float(match[1]), "unit": match[2]}
    return _listed(written, "keys")


def _listed(written: object, key: str) -> object:
    """TOML lists as the tuples that a strict model wants."""
    if isinstance(written, dict) and isinstance(written.get(key), list):
        return {**written, key: tuple(written[key])}
    return written


class Factor(NamedTuple):
    """A number with a unit."""

    number: float
    unit: str


def _factor(written: object) -> object:
    match = QUANTITY.fullmatch(written) if isinstance(written, str) else None
    if match is None:
        raise ValueError(f'{toml(written)} is not a quantity; write it like "0.12 N*m/A"')
    return Factor(float(match[1]), check_unit(match[2]))


GivenQuantity = Annotated[Given, BeforeValidator(_given)]


class ColumnSection(MapSection):
    """One column of the log: value = sign · (scale · written + offset), in ``unit``, at its time + ``shift``.

    Without a unit, it has the one that stands in brackets behind its name in the log. ``gain`` is another factor, with
    a unit of its own, and ``side`` that of the gear on which it was measured.
    """

    name: str = Field(examples=["qm"])
    unit: UnitText | None = Field(None, examples=["rad"])
    scale: float = Field(1.0, examples=[0.001])
    offset: float = Field(0.0, examples=[-2.5])
    sign: Literal[1, -1] = 1
    gain: Annotated[Factor | None, BeforeValidator(_factor)] = Field(None, examples=["0.12 N*m/A"])
    side: Literal["joint", "motor"] = "joint"
    bits: int | None = Field(None, ge=2, le=64, examples=[16])
    shift_s: Annotated[float, quantity_in("s")] = Field(0.0, alias="shift", examples=["-2 ms"])
    missing: float | None = Field(None, examples=[-999])
    optional: bool = False

    def of_product(self, unit: str) -> str:
        """The unit of a value in ``unit`` times the gain."""
        return unit if self.gain is None else f"({unit or '1'})*({self.gain.unit or '1'})"

    @model_validator(mode="before")
    @classmethod
    def _numbers(cls, written: Any) -> Any:
        """A bare name is a column in SI; whole numbers serve as numbers."""
        if isinstance(written, str):
            return {"name": written}
        if isinstance(written, dict):
            return {
                k: float(v) if k in ("scale", "offset", "missing") and type(v) is int else v for k, v in written.items()
            }
        return written


class LogSection(MapSection):
    """``[log]``: the file as a whole."""

    motion: Literal["rotation", "translation"] = Field(examples=["rotation"])
    format: Literal["csv", "tsv", "mat", "hdf5", "parquet", "jsonl", "json", "bag"] | None = None
    entries: str | None = Field(None, examples=["entries"])
    joint: str | None = Field(None, examples=["elbow"])
    separator: str | None = Field(None, min_length=1, max_length=1, examples=[";"])
    header: bool = True
    skip: int = Field(0, ge=0, examples=[2])
    rate_hz: Annotated[float, quantity_in("Hz")] | None = Field(None, alias="rate", gt=0, examples=["1 kHz"])
    gap_s: Annotated[float, quantity_in("s")] | None = Field(None, alias="gap", gt=0, examples=["50 ms"])


class ColumnsSection(MapSection):
    """``[columns]``: what each column of the log holds."""

    time: ColumnSection | None = Field(None, examples=[{"name": "t", "unit": "s"}])
    position: ColumnSection | None = Field(None, examples=[{"name": "q", "unit": "rad"}])
    velocity: ColumnSection | None = Field(None, examples=[{"name": "w", "unit": "rad/s"}])
    link_position: ColumnSection | None = Field(None, examples=[{"name": "q_link", "unit": "rad"}])
    command: ColumnSection | None = Field(None, examples=[{"name": "u", "unit": "V"}])
    exertion: ColumnSection | None = Field(None, examples=[{"name": "torque", "unit": "N*m"}])
    goal: ColumnSection | None = Field(None, examples=[{"name": "goal", "unit": "rad"}])
    enabled: ColumnSection | None = Field(None, examples=[{"name": "torque_enable"}])
    supply: ColumnSection | None = Field(None, examples=[{"name": "volts", "unit": "V"}])
    temperature: ColumnSection | None = Field(None, examples=[{"name": "temp", "unit": "degC"}])
    normal: ColumnSection | None = Field(None, examples=[{"name": "normal", "unit": "N"}])
    load: ColumnSection | None = Field(None, examples=[{"name": "gear_torque", "unit": "N*m"}])


class ActuatorSection(MapSection):
    """``[actuator]``: what is known of the amplifier and the motor."""

    torque_gain: GivenQuantity | None = Field(None, examples=["35 N/V"])
    voltage_driven: bool = False
    resistance: GivenQuantity | None = Field(None, examples=["4 ohm"])
    gear_ratio: GivenQuantity | None = Field(None, examples=[50])


class LoadSection(MapSection):
    """``[load]``: what is known of the load that hangs at the port."""

    inertia: GivenQuantity | None = Field(None, examples=["0.0049 kg*m^2"])
    gravity: GivenQuantity | None = Field(None, examples=["0.48 N*m"])
    gravity_zero: GivenQuantity | None = Field(None, examples=["0 rad"])
    mass: GivenQuantity | None = Field(None, examples=["0.5 kg"])
    length: GivenQuantity | None = Field(None, examples=["0.1 m"])


class LoopSection(MapSection):
    """``[loop]``: the device's own law, command = proportional · (goal − position) − derivative · velocity, limited."""

    proportional: GivenQuantity = Field(examples=["20 V/rad"])
    derivative: GivenQuantity | None = Field(None, examples=["0.1 V*s/rad"])
    limit: GivenQuantity | None = Field(None, examples=["12 V"])


class ModelSection(MapSection):
    """``[model]``: what is fitted."""

    friction: str = Field("best", examples=["coulomb-viscous"])
    candidates: Annotated[tuple[str, ...], BeforeValidator(lambda it: tuple(it) if isinstance(it, list) else it)] = (
        Field((), examples=[["coulomb-viscous", "dahl"]])
    )
    refine: Literal["motion"] | None = None
    inertia: bool = True
    offset: bool = True
    gravity: bool | Annotated[int, Field(ge=1, le=8)] = False
    temperature: bool = False
    delays: bool = True
    drift_s: Annotated[float, quantity_in("s")] | None = Field(None, alias="drift", gt=0, examples=["30 s"])
    cogging_period: GivenQuantity | None = Field(None, examples=["0.01 m"])


class FilterSection(MapSection):
    """``[filter]``: how derivatives are taken."""

    cutoff_hz: Annotated[float, quantity_in("Hz")] | None = Field(None, alias="cutoff", gt=0, examples=["100 Hz"])
    rate_hz: Annotated[float, quantity_in("Hz")] | None = Field(None, alias="rate", gt=0, examples=["100 Hz"])


class SplitSection(MapSection):
    """``[split]``: what is fitted and what is only predicted, where the command line says nothing."""

    train: str | None = Field(None, examples=["0:12.5 s"])
    test: str | None = Field(None, examples=["12.5:25 s"])


class MapFile(MapSection):
    """The file."""

    title: str = Field("", examples=["My machine"])
    source: str = Field("", examples=["who measured it, and where it can be had"])
    log: LogSection = Field(examples=[{"motion": "rotation"}])
    columns: ColumnsSection = Field(examples=[{"time": "t", "position": "q"}])
    actuator: ActuatorSection = ActuatorSection.model_validate({})
    load: LoadSection = LoadSection.model_validate({})
    loop: LoopSection | None = None
    model: ModelSection = ModelSection.model_validate({})
    filter: FilterSection = FilterSection.model_validate({})
    split: SplitSection = SplitSection.model_validate({})


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

    def unit_of(self, name: str) -> str:
        """The unit that a mapped column is converted to; the motor turns also where the joint slides."""
        return self._units_at(self.mapped()[name].side).columns[name]

    def unit_of_given(self, section: str, key: str) -> str:
        """The unit that a known number is converted to."""
        command, position = self.columns.command, self.columns.position
        of = {"torque_gain": command, "proportional": position, "derivative": position}.get(key)
        return self._units_at("joint" if of is None else of.side).givens[section, key]

    def _units_at(self, side: str) -> Units:
        if side == "joint":
            return self.units
        return Units.of("rotation", self.units.command, supplied=self.columns.supply is not None)

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
    """The column map in the file. Raises UsageError: one line for each mistake, with its place and the remedy."""
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
    units = Units.of(read.log.motion, (command.unit or "") if command else "", supplied=supply is not None)
    made = ColumnMap(place=place, units=units, **dict(read))
    _check_units(made, mistakes)
    _check_sense(made, mistakes)
    mistakes.raise_as(UsageError)
    return made


def _check_units(column_map: ColumnMap, mistakes: Mistakes) -> None:
    """Every unit must be of the dimension that is meant: an angle is not a length."""
    for name, column in column_map.mapped().items():
        unit = column_map.unit_of(name)
        _check_unit(
            column.of_product(column.unit or "") if column.gain or column.unit is not None else unit,
            unit,
            f"[columns.{name}] unit",
            mistakes,
        )
    command = column_map.columns.command
    for (section, key), given in column_map.givens().items():
        # The units of a header are not known yet: those of numbers that go with the command are the map's.
        bare = command is not None and command.unit is None and key in ("torque_gain", *LoopSection.model_fields)
        mend = "; or give the command its unit in [columns]" if bare else ""
        _check_unit(given.unit, column_map.unit_of_given(section, key), f"[{section}] {key}", mistakes, mend)


def _check_unit(unit: str, wanted: str, where: str, mistakes: Mistakes, mend: str = "") -> None:
    try:
        conversion(unit, wanted)
    except ValueError as wrong:
        mistakes.add(where, f"{wrong}{mend}")


def _check_sense(column_map: ColumnMap, mistakes: Mistakes) -> None:
    """What must be there for anything to be learned."""
    columns = column_map.columns
    if columns.supply is not None and (columns.command is None or columns.command.unit):
        mistakes.add(
            "[columns] supply", "is for a command that is a share of it, a plain number; leave one of them out"
        )
    if columns.position is None and columns.velocity is None:
        mistakes.add(
            "[columns] position", f'is missing; add position = {{ name = "q", unit = "{column_map.units.motion}" }}'
        )
    if columns.link_position is not None and columns.position is None:
        mistakes.add("[columns] link_position", "is beyond a joint that gives; add the motor's as [columns] position")
    if columns.command is None and columns.exertion is None:
        mistakes.add("[columns]", "neither command nor exertion is given; add the one that the log holds")
    if columns.command is None and column_map.actuator.torque_gain is not None:
        mistakes.add("[actuator] torque_gain", "has no command to act on; add [columns] command, or leave it out")
    _check_load(column_map, mistakes)
    geared = [name for name, section in column_map.mapped().items() if section.side == "motor"]
    if geared and column_map.actuator.gear_ratio is None:
        mistakes.add(
            f"[columns.{geared[0]}] side", "is the motor's, so the ratio is needed; add [actuator] gear_ratio = 50"
        )
    if not geared and column_map.actuator.gear_ratio is not None:
        mistakes.add(
            "[actuator] gear_ratio", 'acts on nothing; write side = "motor" at the columns of the motor\'s side'
        )
    if column_map.loop is not None and columns.goal is None:
        mistakes.add("[loop]", "needs a goal; add [columns] goal, or leave [loop] out")
    if column_map.model.temperature and columns.temperature is None:
        mistakes.add("[model] temperature", 'needs one; add [columns] temperature = "name", or leave it out')
    if column_map.model.gravity and column_map.translation:
        mistakes.add("[model] gravity", "is of a turning joint; on a slide the offset holds it: leave it out")
    if column_map.model.refine is not None:
        _check_refinement(column_map, mistakes)


def _check_load(column_map: ColumnMap, mistakes: Mistakes) -> None:
    mass, length = column_map.load.mass, column_map.load.length
    if (mass is None) != (length is None):
        named, other = ("mass", "length") if length is None else ("length", "mass")
        mistakes.add(f"[load] {named}", f"needs a {other} for the torque of gravity; add it, or leave it out")
    elif _without_scale(column_map):
        mistakes.add(
            "[load]",
            "does not tell the size of any torque or force: as much more gain, inertia and friction would do as well; "
            'add gravity (of a turning load), [actuator] torque_gain = "...", or [columns] exertion',
        )
    elif mass is not None and column_map.translation:
        mistakes.add("[load] mass", 'is of a turning load; for a slide write inertia = "2 kg", and gravity = "3 N"')


def _without_scale(column_map: ColumnMap) -> bool:
    """Whether a load is known that only adds to the inertia or to a constant, and nothing else gives a scale.

    A load's inertia does if the actuator's own is not fitted.
    """
    load = column_map.load
    if load.inertia is not None and not column_map.model.inertia:
        return False
    pulls = not column_map.translation and (load.gravity is not None or load.mass is not None)
    told = column_map.columns.exertion is not None or column_map.actuator.torque_gain is not None
    return (load.inertia is not None or load.gravity is not None) and not pulls and not told


def _check_refinement(column_map: ColumnMap, mistakes: Mistakes) -> None:
    """What a motion is simulated from, and what gives it a scale."""
    columns = column_map.columns
    if columns.position is None or columns.command is None:
        mistakes.add("[model] refine", "needs a position to follow and a command; map both, or leave it out")
    if columns.link_position is not None:
        mistakes.add("[model] refine", "is of a joint that does not give; leave it out, or [columns] link_position")
    if columns.exertion is not None:
        mistakes.add("[model] refine", "is for a log without a torque sensor; leave it out, or the exertion")
    if column_map.load.inertia is None:
        mistakes.add("[model] refine", 'needs a known load; add [load] inertia = "0.005 kg*m^2", or leave it out')
