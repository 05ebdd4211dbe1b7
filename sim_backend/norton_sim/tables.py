"""What is wrong in a table that a user wrote for the simulator: each mistake in one sentence, with place and mend."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from norton_bench.units import parse_quantity


def complaints(
    error: ValidationError, model: type[BaseModel], written: Mapping[str, Any], *, place: str, name: str
) -> list[str]:
    """A sentence for each mistake in ``written``, the table called ``name`` in the file ``place``."""
    return [_sentence(mistake, model, written, place, name) for mistake in error.errors()]


def keys_of(model: type[BaseModel]) -> dict[str, Any]:
    """A table's fields, by the keys they are written under."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def nearest(key: str, known: Iterable[str]) -> str:
    """The mend for a key that is not ``known``: the one that was meant, or all there are."""
    choices = list(known)
    close = get_close_matches(key.lower(), choices, n=1)
    return f'did you mean "{close[0]}"?' if close else f"known here: {', '.join(choices)}"


def _sentence(mistake: ErrorDetails, model: type[BaseModel], written: Mapping[str, Any], place: str, name: str) -> str:
    *tables, key = (name, *map(str, mistake["loc"]))
    where = f"{place}: [{'.'.join(tables)}] {key}" if tables else f"{place}: [{key}]"
    match mistake["type"]:
        case "missing":
            return f"{where} is missing; add {_example(model, mistake['loc'], name)}"
        case "extra_forbidden":
            return f"{where} is not known; {nearest(key, keys_of(_table_at(model, mistake['loc'][:-1])))}"
        case "value_error":
            return f"{where}: {mistake['ctx']['error']}"
        case "model_type" | "model_attributes_type":
            return f"{where} should be a table of its own: write [{'.'.join((*tables, key))}]"
        case _:
            expected = mistake["msg"].removeprefix("Input should be ")
            return f"{where} = {_found(written, mistake['loc'])!r} should be {expected}"


def _found(written: Any, loc: tuple[int | str, ...]) -> object:
    """What stands in the file where a path of keys leads to."""
    for key in loc:
        written = written[key]
    return written


def _table_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> type[BaseModel]:
    """The schema of the table that a path of keys leads to."""
    for key in loc:
        annotation = keys_of(model)[str(key)].annotation
        candidates = getattr(annotation, "__args__", (annotation,))
        model = next(kind for kind in candidates if isinstance(kind, type) and issubclass(kind, BaseModel))
    return model


def _example(model: type[BaseModel], loc: tuple[int | str, ...], name: str) -> str:
    """What to write where a key is missing."""
    key = str(loc[-1])
    examples = keys_of(_table_at(model, loc[:-1]))[key].examples
    if not examples:
        return f"a table [{'.'.join((name, *map(str, loc)))}]"
    return f"{key} = {json.dumps(examples[0])}"


@dataclass(frozen=True)
class Unit:
    """The kinds of quantity in a simulated bench's tables, and what all of its tables have in common.

    The unit of a table's field.
    """

    text: str


def _in(unit: str) -> BeforeValidator:
    return BeforeValidator(lambda text: parse_quantity(text, unit))


def _nanoseconds(text: object) -> int:
    return round(parse_quantity(text, "s") * 1e9)


Number = Annotated[float, _in("dimensionless"), Unit("1")]
Angle = Annotated[float, _in("rad"), Unit("rad")]
Rate = Annotated[float, _in("rad/s"), Unit("rad/s")]
Torque = Annotated[float, _in("N*m"), Unit("N*m")]
TorqueDrift = Annotated[float, _in("N*m/s"), Unit("N*m/s")]
Inertia = Annotated[float, _in("kg*m^2"), Unit("kg*m^2")]
Stiffness = Annotated[float, _in("N*m/rad"), Unit("N*m/rad")]
Stiffening = Annotated[float, _in("N*m/rad^2"), Unit("N*m/rad^2")]
CubicStiffness = Annotated[float, _in("N*m/rad^3"), Unit("N*m/rad^3")]
Damping = Annotated[float, _in("N*m*s/rad"), Unit("N*m*s/rad")]
QuadraticDrag = Annotated[float, _in("N*m*s^2/rad^2"), Unit("N*m*s^2/rad^2")]
TorqueConstant = Annotated[float, _in("N*m/A"), Unit("N*m/A")]
Current = Annotated[float, _in("A"), Unit("A")]
Seconds = Annotated[float, _in("s"), Unit("s")]
Nanoseconds = Annotated[int, BeforeValidator(_nanoseconds)]
Sign = Literal[1, -1]
Device = dict[str, Any]  # how it is really set up, where that is not what the rig says; norton_sim.hookup reads it


class Table(BaseModel):
    """Base of every table: attributes carry the unit in their name, and are written without it."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
