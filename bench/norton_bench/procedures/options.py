"""The options of each step, read from a session file or given by a program.

A session file writes quantities with their units ("400 ms"), under the alias of the field (``dwell``). A program gives
numbers in SI, under the field's name (``dwell_s=0.4``). Amplitudes are fractions of the rig's velocity limit. The
same bounds hold for both. Examples are the defaults as written in a file, or what fits together where nothing is the
default; defaults stand in the table of ``docs/session-file.md``.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator

from norton_bench.segments import Admittance
from norton_bench.units import MOST_IN_RANGE, parse_quantity, parse_range

History = Literal["slow", "fast", "rest"]
MOST_LEVELS = MOST_IN_RANGE  # as many as can be written as a range
LEAST_PUSHES = 4  # trials that are pushed off a path: fewer tell no deviations of what they tell


def _quantity(unit: str) -> BeforeValidator:
    """A number in ``unit`` from a program; a text with a unit from a file, which is read in a context."""

    def read(given: object, info: ValidationInfo) -> object:
        return given if info.context is None else parse_quantity(given, unit)

    return BeforeValidator(read)


def _velocities(given: object, info: ValidationInfo) -> object:
    """A range "-40:8:40 rad/s" or a list of quantities, in rad/s."""
    if info.context is None:
        return given
    if given == []:
        raise ValueError('is empty; write "-40:8:40 rad/s", or leave the key out')
    if isinstance(given, list):
        return tuple(parse_quantity(each, "rad/s") for each in given)
    return parse_range(given, "rad/s")


def _listed(written: object) -> object:
    return tuple(written) if isinstance(written, list) else written


Seconds = Annotated[float, _quantity("s")]
Hertz = Annotated[float, _quantity("Hz")]
Radians = Annotated[float, _quantity("rad")]
RadiansPerSecond = Annotated[float, _quantity("rad/s")]
Damping = Annotated[float, _quantity("N*m*s/rad")]
Inertia = Annotated[float, _quantity("kg*m^2")]
Stiffness = Annotated[float, _quantity("N*m/rad")]
Fraction = Annotated[float, _quantity("")]
Listed = BeforeValidator(_listed)


class Options(BaseModel):
    """Base of every step's options. Raises pydantic's ValidationError for values beyond their bounds."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", validate_by_name=True, validate_by_alias=True)


class TareOptions(Options):
    """Bias and noise at rest."""

    duration_s: Seconds = Field(2.0, alias="duration", ge=0.5, examples=["2 s"])


class CalibrateOptions(Options):
    """The load drive's own dynamics."""

    duration_s: Seconds = Field(8.0, alias="duration", ge=2, examples=["8 s"])


class FreeOptions(Options):
    """Zero torque at the port: a staircase of ``levels`` commands from both sides, then a multisine command.

    ``dwell_s`` is spent on each level of the staircase, ``duration_s`` on the multisine.
    """

    amplitude: Fraction = Field(0.6, gt=0, le=1, examples=["60 %"])
    levels: int = Field(11, ge=3, le=MOST_LEVELS, examples=[11])
    dwell_s: Seconds = Field(0.4, alias="dwell", ge=0.1, examples=["400 ms"])
    duration_s: Seconds = Field(12.0, alias="duration", ge=1, examples=["12 s"])


class BlockedOptions(Options):
    """The shaft held: torque against command, by how standstill was reached.

    ``histories``: "slow" and "fast" approach each level from both sides; "rest" does not move at all.
    """

    levels: int = Field(5, ge=2, le=MOST_LEVELS, examples=[5])
    hold_s: Seconds = Field(0.5, alias="hold", ge=0.1, examples=["500 ms"])
    histories: Annotated[tuple[History, ...], Listed] = Field(
        ("slow",), min_length=1, examples=[["slow", "fast", "rest"]]
    )


class ImposedOptions(Options):
    """Imposed motion: a grid of velocities and commands, then a multisine motion under a multisine command.

    ``velocities_rad_s`` are those of the grid; empty: chosen from ``amplitude``. ``commands`` counts its levels.
    """

    amplitude: Fraction = Field(0.5, gt=0, le=1, examples=["50 %"])
    velocities_rad_s: Annotated[tuple[float, ...], BeforeValidator(_velocities)] = Field(
        (), alias="velocities", examples=["-40:8:40 rad/s"]
    )
    commands: int = Field(3, ge=1, le=MOST_LEVELS, examples=[3])
    duration_s: Seconds = Field(20.0, alias="duration", ge=1, examples=["20 s"])


class RefineOptions(Options):
    """Excitations are chosen round by round, until every 95 % interval is within ± ``until`` of its value."""

    until: Fraction = Field(0.01, gt=0, lt=1, examples=["1 %"])
    at_most_s: Seconds = Field(300.0, alias="at_most", gt=0, examples=["5 min"])


class IterateOptions(Options):
    """One repeated movement: a multisine command up to ``highest_hz`` that fills the free command span.

    ``trials`` is the greatest number of trials.
    """

    trials: int = Field(10, ge=4, le=100, examples=[10])
    duration_s: Seconds = Field(8.0, alias="duration", ge=2, examples=["8 s"])
    highest_hz: Hertz = Field(3.0, alias="highest", gt=0.2, le=20, examples=["3 Hz"])
    seed: int = Field(5, ge=0, examples=[5])


class LawOptions(Options):
    """A law of the port for so long: M dv/dt + B v + K (x − x_ref) = τ_port.

    All three zero is zero torque. ``wall_rad``: the spring begins at this angle, and acts on that side alone.
    """

    mass_kgm2: Inertia = Field(0.0, alias="mass", ge=0, examples=["0 kg*m^2"])
    damping_nms_rad: Damping = Field(0.0, alias="damping", ge=0, examples=["0 N*m*s/rad"])
    stiffness_nm_rad: Stiffness = Field(0.0, alias="stiffness", ge=0, examples=["2 N*m/rad"])
    wall_rad: Radians | None = Field(None, alias="wall", examples=["0.1 rad"])
    duration_s: Seconds = Field(8.0, alias="duration", ge=3, examples=["8 s"])

    @model_validator(mode="after")
    def _is_a_law(self) -> "LawOptions":
        if self.law.shortcoming:
            raise ValueError(self.law.shortcoming)
        return self

    @property
    def law(self) -> Admittance:
        return Admittance.of((self.mass_kgm2, self.damping_nms_rad, self.stiffness_nm_rad), self.wall_rad)


class RenderOptions(LawOptions):
    """A virtual body at the port, from where the shaft stands; then others, without letting go of the shaft.

    The actuator's command is a multisine up to ``highest_hz`` that fills the share ``amplitude`` of the free command
    span. ``then``: laws that follow, each in a straight line within half a second from the one before.
    """

    amplitude: Fraction = Field(1.0, gt=0, le=1, examples=["100 %"])
    highest_hz: Hertz = Field(10.0, alias="highest", gt=0.2, le=20, examples=["10 Hz"])
    then: Annotated[tuple[LawOptions, ...], Listed] = Field((), examples=[[{"stiffness": "2 N*m/rad"}]])

    @property
    def laws(self) -> tuple[LawOptions, ...]:
        """All of them, in turn."""
        return (self, *self.then)


class InSituOptions(Options):
    """One repeated movement while the actuator stays assembled to its load; no torque sensor is used.

    ``trials`` is the greatest number of trials, ``left_alone`` the share, chosen at random, without a driven load.
    ``shake_s`` is the time of shaking before the first trial, to identify load and actuator separately.
    ``viscous_damping_nms_rad`` and ``inertia_kgm2`` of the load are given where they are known, else None; both in
    newton metres of the load drive. ``amplitude`` is the greatest velocity as a share of the rig's limit: of the
    predicted motion source, or, where there is no model, of the loaded actuator. With ``hold_s`` the command stays at
    random levels for so long each, for an actuator that reaches by itself; else it is a multisine. ``pushes`` trials
    more are pushed off the path, each in another way, for the impedance along it.
    """

    trials: int = Field(12, ge=4, le=100, examples=[12])
    duration_s: Seconds = Field(8.0, alias="duration", ge=2, examples=["8 s"])
    shake_s: Seconds = Field(24.0, alias="shake", ge=4, examples=["24 s"])
    highest_hz: Hertz = Field(3.0, alias="highest", gt=0.2, le=20, examples=["3 Hz"])
    hold_s: Seconds | None = Field(None, alias="hold", ge=0.05, examples=["600 ms"])
    amplitude: Fraction = Field(0.5, gt=0, le=1, examples=["50 %"])
    left_alone: Fraction = Field(0.25, ge=0, lt=1, examples=["25 %"])
    pushes: int = Field(0, ge=0, le=100, examples=[8])
    viscous_damping_nms_rad: Damping | None = Field(None, alias="viscous_damping", ge=0, examples=["3e-4 N*m*s/rad"])
    inertia_kgm2: Inertia | None = Field(None, alias="inertia", gt=0, examples=["1.2e-4 kg*m^2"])
    seed: int = Field(6, ge=0, examples=[6])

    @model_validator(mode="after")
    def _held_within_the_movement(self) -> "InSituOptions":
        if self.hold_s is not None and self.hold_s > self.duration_s / 2:
            raise ValueError("hold is longer than half of the duration: the movement goes there and back; shorten it")
        if 0 < self.pushes < LEAST_PUSHES:
            raise ValueError(f"pushes must be {LEAST_PUSHES} or more, or 0: fewer do not tell how sure they are")
        return self


class RestOptions(Options):
    """No command; everything is measured."""

    duration_s: Seconds = Field(10.0, alias="duration", ge=0.1, le=3600, examples=["10 s"])


class _TabulateOptions(Options):
    """Common to both tabulations: slower than ``settled_rad_s`` means at rest; the longest wait is ``at_most_s``."""

    settled_rad_s: RadiansPerSecond = Field(2e-3, alias="settled", gt=0, examples=["2 mrad/s"])
    at_most_s: Seconds = Field(3.0, alias="at_most", gt=0, examples=["3 s"])


class TabulateSourceOptions(_TabulateOptions):
    """The rest position of the free port for each command. Commands are shares of the greatest."""

    levels: int = Field(7, ge=2, le=MOST_LEVELS, examples=[7])
    lowest: Fraction = Field(-1.0, ge=-1, le=1, examples=["-100 %"])
    highest: Fraction = Field(1.0, ge=-1, le=1, examples=["100 %"])
    port: Literal["actuator", "external"] = Field("actuator", examples=["external"])
    read_s: Seconds = Field(0.5, alias="read", ge=0.1, examples=["500 ms"])


class TabulateImpedanceOptions(_TabulateOptions):
    """The torque of the port away from its source, at some commands (shares of the greatest).

    ``displacement_rad`` is the distance to either side, and is reached in ``steps``. ``shake_rad`` is a peak value, and
    ``sweep_rad_s`` the speed from end to end and back; 0 leaves either out.
    """

    commands: int = Field(3, ge=1, le=MOST_LEVELS, examples=[3])
    lowest: Fraction = Field(-0.5, ge=-1, le=1, examples=["-50 %"])
    highest: Fraction = Field(0.5, ge=-1, le=1, examples=["50 %"])
    displacement_rad: Radians = Field(0.05, alias="displacement", gt=0, examples=["50 mrad"])
    steps: int = Field(4, ge=1, examples=[4])
    hold_s: Seconds = Field(0.4, alias="hold", ge=0.2, examples=["400 ms"])
    shake_rad: Radians = Field(5e-3, alias="shake", ge=0, examples=["5 mrad"])
    sweep_rad_s: RadiansPerSecond = Field(0.05, alias="sweep", ge=0, examples=["50 mrad/s"])


class ValidateOptions(Options):
    """A command and a motion that are kept apart from every fit."""

    duration_s: Seconds = Field(8.0, alias="duration", ge=1, examples=["8 s"])
    seed: int = Field(7, ge=0, examples=[7])


STEPS: Mapping[str, type[Options]] = {
    "tare": TareOptions,
    "calibrate": CalibrateOptions,
    "free": FreeOptions,
    "blocked": BlockedOptions,
    "imposed": ImposedOptions,
    "refine": RefineOptions,
    "iterate_zero_torque": IterateOptions,
    "render": RenderOptions,
    "in_situ": InSituOptions,
    "rest": RestOptions,
    "tabulate_source": TabulateSourceOptions,
    "tabulate_impedance": TabulateImpedanceOptions,
    "validate": ValidateOptions,
}
