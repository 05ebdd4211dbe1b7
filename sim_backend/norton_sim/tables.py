"""What is wrong in a table that a user wrote for the simulator: each mistake in one sentence, with place and mend."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails

from norton_bench.models.parameters import DahlMotor
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


# The kinds of quantity in a simulated bench's tables, and what all of its tables have in common.
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
Mass = Annotated[float, _in("kg"), Unit("kg")]
Length = Annotated[float, _in("m"), Unit("m")]
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


# What the machines of a simulated bench are made of: a drive, and a body with its friction.
class Cogging(Table):
    """Torque that goes with the rotor's position: amplitude · sin(periods · θ + phase), opposing the motor's torque."""

    amplitude_nm: Torque = Field(alias="amplitude", ge=0, examples=["0.3 mN*m"])
    periods_per_turn: int | float = Field(gt=0, examples=[42])
    phase_rad: Angle = Field(alias="phase", default=0.0)


class Gravity(Table):
    """An arm that hangs on the shaft: amplitude · sin(θ − zero), opposing the motor's torque (paper, section III).

    The shaft begins at θ = 0: with another ``zero`` the arm falls from there.
    """

    amplitude_nm: Torque = Field(alias="amplitude", ge=0, examples=["50 mN*m"])
    zero_rad: Angle = Field(alias="zero", default=0.0)


class Drive(Table):
    """Amplifier and encoder of a machine."""

    amplifier_bandwidth_rad_s: Rate = Field(alias="amplifier_bandwidth", gt=0, examples=["600 rad/s"])
    counts_per_turn: int = Field(default=131072, ge=1)
    encoder_bandwidth_rad_s: Rate = Field(alias="encoder_bandwidth", default=1000.0, gt=0, lt=8000)
    current_noise_a: Current = Field(alias="current_noise", default=0.0, ge=0)
    mounted: Sign = 1
    device: Device = Field(default_factory=dict)


class Machine(Drive):
    """What the torque motor and the load machine have in common: drive and body, with friction that never ends."""

    inertia_kg_m2: Inertia = Field(alias="inertia", gt=0, examples=["5e-5 kg*m^2"])
    viscous_damping_nm_s_rad: Damping = Field(alias="viscous_damping", gt=0, examples=["1e-3 N*m*s/rad"])
    coulomb_torque_nm: Torque = Field(alias="coulomb_torque", gt=0, examples=["0.02 N*m"])
    presliding_stiffness_nm_rad: Stiffness = Field(alias="presliding_stiffness", gt=0, examples=["10 N*m/rad"])
    presliding_damping_nm_s_rad: Damping = Field(alias="presliding_damping", default=0.0, ge=0)
    cogging: Cogging | None = None
    gravity: Gravity | None = None

    def _motor(self, torque_constant_nm_a: float, amplifier_gain: float) -> DahlMotor:
        return DahlMotor(
            Ka=amplifier_gain,
            beta=self.amplifier_bandwidth_rad_s,
            Km=torque_constant_nm_a,
            Im=self.inertia_kg_m2,
            B=self.viscous_damping_nm_s_rad,
            sigma_0=self.presliding_stiffness_nm_rad,
            sigma_1=self.presliding_damping_nm_s_rad,
            tau_c=self.coulomb_torque_nm,
        )


class Commanded(Table):
    """``amplifier_gain`` is in amperes per unit of the actuator's command, whatever that unit is."""

    amplifier_gain: float = Field(gt=0, examples=["18 A/(N*m)"])

    @field_validator("amplifier_gain", mode="before")
    @classmethod
    def _per_unit_of_command(cls, text: object, info: ValidationInfo) -> float:
        return parse_quantity(text, f"A/({info.context['command_unit']})" if info.context else "A/(N*m)")


class Body(Table):
    """An inertia that turns, with as much friction as is written, by the equations of the motor's (section IV.D)."""

    inertia_kg_m2: Inertia = Field(alias="inertia", gt=0, examples=["5e-5 kg*m^2"])
    viscous_damping_nm_s_rad: Damping = Field(alias="viscous_damping", default=0.0, ge=0)
    coulomb_torque_nm: Torque = Field(alias="coulomb_torque", default=0.0, ge=0)
    presliding_stiffness_nm_rad: Stiffness = Field(alias="presliding_stiffness", default=0.0, ge=0)
    presliding_damping_nm_s_rad: Damping = Field(alias="presliding_damping", default=0.0, ge=0)
    gravity: Gravity | None = None

    @model_validator(mode="after")
    def _slides_from_somewhere(self) -> "Body":
        if (self.coulomb_torque_nm > 0) != (self.presliding_stiffness_nm_rad > 0):
            raise ValueError(
                "coulomb_torque and presliding_stiffness belong together; "
                'add the other, such as presliding_stiffness = "10 N*m/rad", or leave out both'
            )
        return self
