"""The kinds of quantity in a simulated bench's tables, and what all of its tables have in common."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict

from norton_bench.units import parse_quantity


@dataclass(frozen=True)
class Unit:
    """The unit of a table's field."""

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
