"""Session files: which procedures run, in which order, with which options; ``docs/session-file.md`` explains them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from bench.errors import UsageError
from bench.procedures.catalogue import make_procedures
from bench.procedures.options import (
    BlockedOptions,
    CalibrateOptions,
    FreeOptions,
    ImposedOptions,
    Options,
    RefineOptions,
    TareOptions,
    ValidateOptions,
)
from bench.procedures.refine import RefineProcedure
from bench.rig.files import parse_toml, read_text
from bench.rig.mistakes import Mistakes, nearest, toml
from bench.rig.rig import Rig
from bench.units import parse_quantity, parse_range, quantity_in


@dataclass(frozen=True)
class Step:
    """One procedure to run: its name and its options."""

    do: str
    options: Options


@dataclass(frozen=True)
class WrittenFault:
    """A fault to rehearse: what the simulator reads of it, and the step during which it is to happen, if one."""

    table: Mapping[str, Any]
    during: str | None = None


@dataclass(frozen=True)
class Session:
    """What to do, in order. ``place`` names where it came from; ``rig`` is the rig file, if the session names one.

    ``arguments`` are those of ``identify`` that made a built-in session what it is. ``faults`` are for a simulation.
    """

    steps: tuple[Step, ...]
    place: str
    rig: Path | None = None
    seed: int | None = None
    text: str = ""
    arguments: str = ""
    faults: tuple[WrittenFault, ...] = ()


def _velocities(written: object) -> tuple[float, ...]:
    """A range "-40:8:40 rad/s" or a list of quantities, in rad/s."""
    if written == []:
        raise ValueError('names no velocity; write "-40:8:40 rad/s", or leave the key out')
    if isinstance(written, list):
        return tuple(parse_quantity(each, "rad/s") for each in written)
    return parse_range(written, "rad/s")


Seconds = Annotated[float, quantity_in("s")]
Fraction = Annotated[float, quantity_in("")]


class StepModel(BaseModel):
    """Base of every step's options; fields are named as in :mod:`bench.procedures.options`."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


class _Tare(StepModel):
    duration_s: Seconds = Field(TareOptions.duration_s, alias="duration", ge=0.5, examples=["2 s"])


class _Calibrate(StepModel):
    duration_s: Seconds = Field(CalibrateOptions.duration_s, alias="duration", ge=2, examples=["8 s"])


class _Free(StepModel):
    amplitude: Fraction = Field(FreeOptions.amplitude, gt=0, le=1, examples=["60 %"])
    levels: int = Field(FreeOptions.levels, ge=3, examples=[11])
    dwell_s: Seconds = Field(FreeOptions.dwell_s, alias="dwell", ge=0.1, examples=["400 ms"])
    duration_s: Seconds = Field(FreeOptions.duration_s, alias="duration", ge=1, examples=["12 s"])


class _Blocked(StepModel):
    levels: int = Field(BlockedOptions.levels, ge=2, examples=[5])
    hold_s: Seconds = Field(BlockedOptions.hold_s, alias="hold", ge=0.1, examples=["500 ms"])


class _Imposed(StepModel):
    amplitude: Fraction = Field(ImposedOptions.amplitude, gt=0, le=1, examples=["50 %"])
    velocities_rad_s: Annotated[tuple[float, ...], BeforeValidator(_velocities)] = Field(
        ImposedOptions.velocities_rad_s, alias="velocities", examples=["-40:8:40 rad/s"]
    )
    commands: int = Field(ImposedOptions.commands, ge=1, examples=[3])
    duration_s: Seconds = Field(ImposedOptions.duration_s, alias="duration", ge=1, examples=["20 s"])


class _Refine(StepModel):
    until: Fraction = Field(RefineOptions.until, gt=0, lt=1, examples=["1 %"])
    at_most_s: Seconds = Field(RefineOptions.at_most_s, alias="at_most", gt=0, examples=["5 min"])


class _Validate(StepModel):
    duration_s: Seconds = Field(ValidateOptions.duration_s, alias="duration", ge=1, examples=["8 s"])
    seed: int = Field(ValidateOptions.seed, ge=0, examples=[7])


STEPS: Mapping[str, tuple[type[StepModel], type[Options]]] = {
    "tare": (_Tare, TareOptions),
    "calibrate": (_Calibrate, CalibrateOptions),
    "free": (_Free, FreeOptions),
    "blocked": (_Blocked, BlockedOptions),
    "imposed": (_Imposed, ImposedOptions),
    "refine": (_Refine, RefineOptions),
    "validate": (_Validate, ValidateOptions),
}
# Every procedure that is not decided as it goes.
STANDARD = tuple(name for name in STEPS if name != "refine")
# Around a refinement, which does the rest: just enough for a first fit, and for commands to validate with.
SHORT_FREE = FreeOptions(levels=5, dwell_s=0.3, duration_s=4.0)
SHORT_IMPOSED = ImposedOptions(commands=1, duration_s=4.0)
LEAST_REFINING_S = 10.0


class _File(BaseModel):
    """The file's own keys."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    rig: str | None = Field(None, examples=["../rigs/sim-odrive.toml"])
    seed: int | None = Field(None, ge=0, examples=[1])
    step: list[Any]
    fault: list[Any] = Field(default_factory=list)


def load_session(path: str | Path) -> Session:
    """The session that the file describes. Raises UsageError: one line a mistake, each with its place and the mend."""
    path = Path(path)
    return parse_session(read_text(path, "session file"), place=str(path))


def parse_session(text: str, *, place: str) -> Session:
    """As :func:`load_session`, from the file's content."""
    mistakes = Mistakes(place)
    written = parse_toml(text, place)
    steps = written.get("step")
    if not isinstance(steps, list) or not steps:
        mistakes.add("[[step]]", 'there is no step; add a section [[step]], in double brackets, with do = "tare"')
        steps = []
    head = mistakes.read(_File, {**written, "step": steps}, "")
    read = [_step(table, number, mistakes) for number, table in enumerate(steps, 1)]
    names = [step.do for step in read if step is not None]
    faults = (
        () if head is None else [_fault(table, f"fault {n}", names, mistakes) for n, table in enumerate(head.fault, 1)]
    )
    mistakes.raise_as(UsageError)
    assert head is not None
    rig = None if head.rig is None else Path(place).parent / head.rig
    steps_read = tuple(step for step in read if step is not None)
    return Session(steps_read, place, rig, head.seed, text, faults=tuple(faults))


def _step(table: object, number: int, mistakes: Mistakes) -> Step | None:
    where = f"step {number}"
    if not isinstance(table, dict):
        mistakes.add(f"[{where}]", f"is a section, not {toml(table)}; write [[step]] on a line of its own")
        return None
    do = table.get("do")
    if do is None:
        mistakes.add(f"[{where}] do", f"is missing; add do = ... (one of {', '.join(STEPS)})")
        return None
    if not isinstance(do, str) or do not in STEPS:
        mistakes.add(f"[{where}] do", f"{toml(do)} is not a procedure; {nearest(str(do), STEPS)}")
        return None
    model, options = STEPS[do]
    rest = {key: value for key, value in table.items() if key != "do"}
    section = mistakes.read(model, rest, f"{where}, {do}")
    return None if section is None else Step(do, options(**section.model_dump(exclude_unset=True)))


def _fault(table: object, where: str, steps: Sequence[str], mistakes: Mistakes) -> WrittenFault:
    """What else stands in the table is for the simulator to read."""
    if not isinstance(table, dict):
        mistakes.add(f"[{where}]", f"is a section, not {toml(table)}; write [[fault]] on a line of its own")
        return WrittenFault({})
    during = table.get("during")
    if during is not None and during not in steps:
        mistakes.add(f"[{where}] during", f"{toml(during)} is no step of this session; {nearest(str(during), steps)}")
    return WrittenFault({key: value for key, value in table.items() if key != "during"}, during)


def standard_session(rig: Rig | None = None) -> Session:
    """The built-in session of ``identify``: everything that ``rig`` can perform, or everything there is."""
    able = STANDARD if rig is None else [name for name in STANDARD if _performs(rig, name)]
    return Session(tuple(Step(name, STEPS[name][1]()) for name in able), "the standard session")


def refining_session(rig: Rig, until: float, at_most_s: float) -> Session:
    """The built-in session of ``identify --until``: a short first pass, then rounds that choose themselves.

    ``until`` is the half-width of the 95 % intervals asked for, relative; ``at_most_s`` the bench time of all together.
    Raises RigError where the rig has no load drive, UsageError where there is no time for a round.
    """
    around: tuple[tuple[str, Options], ...] = (
        ("tare", TareOptions()),
        ("calibrate", CalibrateOptions()),
        ("free", SHORT_FREE),
        ("imposed", SHORT_IMPOSED),
        ("refine", RefineOptions(until)),
        ("validate", ValidateOptions()),
    )
    place = "--until"
    RefineProcedure().require(rig)
    procedures = make_procedures(around, rig, place=place)
    taken_s = sum(procedure.duration_s(rig) for procedure in procedures if procedure.name != "refine")
    if at_most_s - taken_s < LEAST_REFINING_S:
        raise UsageError(
            f"--at-most {at_most_s:g} s: the steps around the refinement take about {taken_s:.0f} s; "
            f'allow at least "{taken_s + LEAST_REFINING_S:.0f} s"'
        )
    refine = RefineOptions(until, at_most_s - taken_s)
    steps = [Step(name, refine if name == "refine" else options) for name, options in around]
    return Session(tuple(steps), place, arguments=f'--until {100 * until:g}% --at-most "{at_most_s:g} s"')


def _performs(rig: Rig, name: str) -> bool:
    wiring = rig.wiring
    if wiring.load is not None or name == "tare":
        return True
    if name == "blocked":
        return wiring.shaft == "clamped" and wiring.torque_sensor is not None
    return name in ("free", "validate") and wiring.shaft == "free"
