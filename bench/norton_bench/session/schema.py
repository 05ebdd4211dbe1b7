"""Session files: which procedures run, in which order, with which options; ``docs/session-file.md`` explains them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from norton_bench.errors import UsageError, nearest
from norton_bench.procedures.catalogue import CATALOGUE, make_procedures
from norton_bench.procedures.options import (
    STEPS,
    CalibrateOptions,
    FreeOptions,
    ImposedOptions,
    Options,
    RefineOptions,
    TareOptions,
    ValidateOptions,
)
from norton_bench.rig.files import Mistakes, check_kind, parse_toml, read_text, toml
from norton_bench.rig.rig import Command, Rig
from norton_bench.session.items import Expectation, ExpectModel, Session, Step, WrittenFault, flat
from norton_bench.session.unroll import Unroller, Values, settled

__all__ = [
    "Session",
    "Step",
    "WrittenFault",
    "load_session",
    "parse_session",
    "refining_session",
    "standard_session",
]

# Every procedure that is not adaptive and measures what the fit of a motor needs.
STANDARD = ("tare", "calibrate", "free", "blocked", "imposed", "validate")
# The same for a servo: held at other places, it shows in `imposed` what a motor shows in `blocked`.
SERVO = ("tare", "calibrate", "free", "imposed", "validate")
# The same for an actuator without a model.
TABLES = ("tare", "calibrate", "tabulate_source", "tabulate_impedance")
# Run at several modulations where the rig has a modulator.
MODULATED = ("tabulate_source", "tabulate_impedance")
# Around a refinement: just enough for a first fit, and for the commands of `validate`.
SHORT_FREE = FreeOptions(levels=5, dwell_s=0.3, duration_s=4.0)
SHORT_IMPOSED = ImposedOptions(commands=1, duration_s=4.0)
LEAST_REFINING_S = 10.0


class _SessionFile(BaseModel):
    """The file's own keys."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    rig: str | None = Field(None, examples=["../rigs/sim-odrive.toml"])
    seed: int | None = Field(None, ge=0, examples=[1])
    step: list[Any]
    fault: list[Any] = Field(default_factory=list)
    parameters: dict[str, Any] = Field(default_factory=dict, examples=[{"speed": "40 rad/s"}])
    expect: list[Any] = Field(default_factory=list)


def load_session(path: str | Path, given: Mapping[str, Any] | None = None) -> Session:
    """The session that the file describes; ``given`` are values for its parameters, instead of the file's.

    Raises UsageError: a line for each mistake, with its place and the remedy.
    """
    path = Path(path)
    return parse_session(read_text(path, "session file"), place=str(path), given=given)


def parse_session(text: str, *, place: str, given: Mapping[str, Any] | None = None) -> Session:
    """As :func:`load_session`, from the file's content."""
    mistakes = Mistakes(place)
    written = parse_toml(text, place)
    check_kind(written, "session file", place)
    steps = written.get("step")
    if not isinstance(steps, list) or not steps:
        mistakes.add("[[step]]", 'there is no step; add a section [[step]], in double brackets, with do = "tare"')
        steps = []
    head = mistakes.read(_SessionFile, {**written, "step": steps}, "")
    values = Values(settled(head.parameters if head else {}, given or {}, place))
    read = Unroller(mistakes).read(steps, values)
    names = sorted({step.do for step in flat((*read.steps, *read.always))})
    faults, expectations = _head_tables(head, names, values, mistakes)
    _check_used(values, mistakes)
    mistakes.raise_as(UsageError)
    assert head is not None
    return Session(
        tuple(read.steps),
        place,
        None if head.rig is None else Path(place).parent / head.rig,
        head.seed,
        text,
        faults=faults,
        always=tuple(read.always),
        expectations=expectations,
        parameters=values.given,
    )


def _head_tables(
    head: _SessionFile | None, names: Sequence[str], values: Values, mistakes: Mistakes
) -> tuple[tuple[WrittenFault, ...], tuple[Expectation, ...]]:
    if head is None:
        return (), ()
    faults = [_fault(table, f"fault {n}", names, mistakes) for n, table in enumerate(head.fault, 1)]
    expected = [_expectation(table, f"expect {n}", values, mistakes) for n, table in enumerate(head.expect, 1)]
    return tuple(faults), tuple(each for each in expected if each is not None)


def _expectation(table: object, where: str, values: Values, mistakes: Mistakes) -> Expectation | None:
    try:
        section = mistakes.read(ExpectModel, values.put_in(table), where)
        return None if section is None else section.expectation(where)
    except ValueError as error:
        mistakes.add(f"[{where}]", str(error))
        return None


def _check_used(values: Values, mistakes: Mistakes) -> None:
    """Report unused parameters; only in a file without other mistakes, which may hide their use."""
    if mistakes.sentences:
        return
    for name in values.given:
        if name not in values.used:
            mistakes.add(f"[parameters] {name}", f'is used nowhere; write "${name}" where it belongs, or leave it out')


def _fault(table: object, where: str, steps: Sequence[str], mistakes: Mistakes) -> WrittenFault:
    """Read ``during``; all other keys are read by the simulator."""
    if not isinstance(table, dict):
        mistakes.add(f"[{where}]", f"is a section, not {toml(table)}; write [[fault]] on a line of its own")
        return WrittenFault({})
    during = table.get("during")
    if during is not None and during not in steps:
        mistakes.add(f"[{where}] during", f"{toml(during)} is no step of this session; {nearest(str(during), steps)}")
    return WrittenFault({key: value for key, value in table.items() if key != "during"}, during)


def standard_session(rig: Rig | None = None) -> Session:
    """The built-in session of ``identify``: every step that ``rig`` can perform; if it can perform none, all steps."""
    if rig is None:
        able = STANDARD
    else:
        wanted = TABLES if not rig.modelled else STANDARD if rig.servo is None else SERVO
        able = tuple(name for name in (*wanted, "in_situ") if _performs(rig, name))
    modulations = () if rig is None or rig.modulation is None else _spread(rig.modulation)
    steps = (Step(name, STEPS[name](), modulations=modulations if name in MODULATED else ()) for name in able)
    return Session(tuple(steps), "the standard session")


def _spread(modulation: Command) -> tuple[str, ...]:
    """The lowest, the middle and the highest command of a modulator."""
    least, greatest = modulation.span
    return tuple(f"{value:g} {modulation.unit}" for value in (least, (least + greatest) / 2, greatest))


def refining_session(rig: Rig, until: float, at_most_s: float) -> Session:
    """The built-in session of ``identify --until``: a short first pass, then rounds of chosen excitations.

    ``until`` is the relative half-width asked of all 95 % intervals; ``at_most_s`` is the bench time of the session.
    Raises RigError where the rig has no load drive, UsageError where there is no time for a round.
    """
    around: tuple[tuple[str, Options], ...] = (
        ("tare", TareOptions()),
        ("calibrate", CalibrateOptions()),
        ("free", SHORT_FREE),
        ("imposed", SHORT_IMPOSED),
        ("refine", RefineOptions(until=until)),
        ("validate", ValidateOptions()),
    )
    place = "--until"
    CATALOGUE["refine"].make().require(rig)
    procedures = make_procedures(around, rig, place=place)
    taken_s = sum(procedure.duration_s(rig) for procedure in procedures if procedure.name != "refine")
    if at_most_s - taken_s < LEAST_REFINING_S:
        raise UsageError(
            f"--at-most {at_most_s:g} s: the steps around the refinement take about {taken_s:.0f} s; "
            f'allow at least "{taken_s + LEAST_REFINING_S:.0f} s"'
        )
    refine = RefineOptions(until=until, at_most_s=at_most_s - taken_s)
    steps = [Step(name, refine if name == "refine" else options) for name, options in around]
    return Session(tuple(steps), place, arguments=f'--until {100 * until:g}% --at-most "{at_most_s:g} s"')


def _performs(rig: Rig, name: str) -> bool:
    wiring = rig.wiring
    assembled = wiring.load is not None and wiring.torque_sensor is None
    if name == "tare" or assembled:
        return name in ("tare", "in_situ")
    if wiring.load is not None:
        return name != "in_situ"
    if name == "blocked":
        return wiring.shaft == "clamped" and wiring.torque_sensor is not None
    return name in ("free", "validate", "tabulate_source") and wiring.shaft == "free"
