"""The sections of a column map, as they are written; ``docs/logs.md`` explains them."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from norton_bench.rig.mistakes import toml
from norton_bench.units import QUANTITY, check_unit, quantity_in

UnitText = Annotated[str, BeforeValidator(lambda text: check_unit(text) if isinstance(text, str) else text)]


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


GivenQuantity = Annotated[Given, BeforeValidator(_given)]


class ColumnSection(MapSection):
    """One column of the log: value = sign · (scale · written + offset), in ``unit``, at its time + ``shift``."""

    name: str = Field(examples=["qm"])
    unit: UnitText = Field("", examples=["rad"])
    scale: float = Field(1.0, examples=[0.001])
    offset: float = Field(0.0, examples=[-2.5])
    sign: Literal[1, -1] = 1
    bits: int | None = Field(None, ge=2, le=64, examples=[16])
    shift_s: Annotated[float, quantity_in("s")] = Field(0.0, alias="shift", examples=["-2 ms"])
    missing: float | None = Field(None, examples=[-999])
    optional: bool = False

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
    format: Literal["csv", "tsv", "mat", "hdf5", "parquet", "jsonl", "json"] | None = None
    entries: str | None = Field(None, examples=["entries"])
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
    command: ColumnSection | None = Field(None, examples=[{"name": "u", "unit": "V"}])
    exertion: ColumnSection | None = Field(None, examples=[{"name": "torque", "unit": "N*m"}])
    goal: ColumnSection | None = Field(None, examples=[{"name": "goal", "unit": "rad"}])
    enabled: ColumnSection | None = Field(None, examples=[{"name": "torque_enable"}])
    supply: ColumnSection | None = Field(None, examples=[{"name": "volts", "unit": "V"}])
    temperature: ColumnSection | None = Field(None, examples=[{"name": "temp", "unit": "degC"}])
    normal: ColumnSection | None = Field(None, examples=[{"name": "normal", "unit": "N"}])


class ActuatorSection(MapSection):
    """``[actuator]``: what is known of the amplifier and the motor."""

    torque_gain: GivenQuantity | None = Field(None, examples=["35 N/V"])
    voltage_driven: bool = False
    resistance: GivenQuantity | None = Field(None, examples=["4 ohm"])


class LoadSection(MapSection):
    """``[load]``: what is known of the load that hangs at the port."""

    inertia: GivenQuantity | None = Field(None, examples=["0.0049 kg*m^2"])
    gravity: GivenQuantity | None = Field(None, examples=["0.48 N*m"])
    gravity_zero: GivenQuantity | None = Field(None, examples=["0 rad"])


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
    gravity: bool = False
    temperature: bool = False
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
