"""The steps and faults of a session file as an experiment: checked against the rig, planned, and made a script."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.events import PlannedStep
from norton_bench.on_demand import deferred
from norton_bench.procedures.catalogue import make_procedure
from norton_bench.procedures.knowledge import Adaptive, Procedure
from norton_bench.rig.rig import Rig
from norton_bench.session.items import AskOptions, Block, Condition, Item, Session, Step, check_expectation, flat
from norton_bench.session.script import Ask, Experiment, Planned, Remark, Script, SoFar, Turn
from norton_bench.units import parse_quantity
from norton_drivers.ports import Backend, Rehearsal

# An hour, as with `rest`. A step's excitation and readings are held in memory at once, and fitted: at 1 kHz an hour is
# 3.6 million ticks of 224 bytes, with some 150 bytes of readings each: 1.3 GB.
MOST_STEP_S = 3600.0
# A day. The fit holds all of a session in memory: the standard session's 2 minutes are 50 MB of recording, a day 37 GB.
MOST_SESSION_S = 24 * 3600.0
# These need no earlier step: they are possible at the end, however far the session came.
ALWAYS_POSSIBLE = ("tare", "rest", "ask")
modulated = deferred("norton_bench.procedures.modulated:modulated")


@dataclass(frozen=True)
class Made:
    """A step that is checked: its action, and its number in the plan."""

    step: Step
    action: Planned
    index: int

    def script(self, so_far: SoFar) -> Script:
        if self.step.when is None or self.step.when.holds(so_far):
            yield Turn(self.index, self.action)
        else:
            yield Remark(f"left out '{self.step.do}': not ({self.step.when})")


@dataclass(frozen=True)
class MadeBlock:
    """A block that is checked; every repetition has its own ``stride`` steps in the plan."""

    block: Block
    items: tuple["Made | MadeBlock", ...]
    stride: int

    def script(self, so_far: SoFar) -> Script:
        block = self.block
        if block.when is not None and not block.when.holds(so_far):
            yield Remark(f"left out [{block.where}]: not ({block.when})")
            return
        for turn in range(block.at_most):
            for item in self.items:
                yield from moved(item, turn * self.stride).script(so_far)
            if block.until is None or block.until.holds(so_far):
                return
        yield Remark(f"[{block.where}] was repeated {block.at_most} times, and still not: {block.until}")


def moved(item: Made | MadeBlock, steps: int) -> Made | MadeBlock:
    """The same item, ``steps`` steps later in the plan."""
    if isinstance(item, Made):
        return replace(item, index=item.index + steps)
    return replace(item, items=tuple(moved(inner, steps) for inner in item.items))


@dataclass
class _Maker:
    """Checks the items of one session, and plans them."""

    session: Session
    rig: Rig
    plan: list[PlannedStep] = field(default_factory=list)
    asked: set[str] = field(default_factory=set)

    def items(self, items: Sequence[Item], before: set[str], *, certain: bool = True) -> tuple[Made | MadeBlock, ...]:
        """Check ``items``; ``before`` are procedures that certainly run before; those of ``items`` are added."""
        return tuple(self._item(item, before, certain) for item in items)

    def _item(self, item: Item, before: set[str], certain: bool) -> Made | MadeBlock:
        self._check(item.when, item.where)
        if isinstance(item, Step):
            return self._step(item, before, certain)
        return self._block(item, before, certain)

    def _step(self, step: Step, before: set[str], certain: bool) -> Made:
        index, action = len(self.plan), self._action(step, before)
        certain = certain and step.when is None
        duration_s = 0.0 if isinstance(action, Ask) else action.duration_s(self.rig)
        self._check_duration(step, action, duration_s)
        self.plan.append(PlannedStep(step.do, duration_s, _label(step), certain))
        if certain:
            before.add(step.do)
        return Made(step, action, index)

    def _block(self, block: Block, before: set[str], certain: bool) -> MadeBlock:
        begin, certain = len(self.plan), certain and block.when is None
        inside = before if certain else set(before)
        items = self.items(block.steps, inside, certain=certain)
        once = self.plan[begin:]
        for turn in range(1, block.at_most):
            self.plan += [_again(step, turn + 1) for step in once]
        if block.at_most > 1:
            self.plan[begin : begin + len(once)] = [replace(step, label=_joined(step.label, "1")) for step in once]
        self._check(block.until, block.where)
        return MadeBlock(block, items, len(once))

    def _action(self, step: Step, before: set[str]) -> Planned:
        if isinstance(step.options, AskOptions):
            self.asked.add(step.options.name)
            return Ask(step.options.name, step.options.text, step.options.choices)
        place = f"{self.session.place}: [{step.where}]" if step.where else f"{self.session.place}: step"
        action = make_procedure(step.do, step.options, self.rig, before, place=place)
        if not step.modulations:
            return action
        held: Procedure | Adaptive = modulated(action, _in_units(step.modulations, self.rig, place))
        held.require(self.rig)
        return held

    def _check_duration(self, step: Step, action: Planned, duration_s: float) -> None:
        """Raises UsageError for a step that is too long; an adaptive one consists of shorter pieces."""
        if duration_s > MOST_STEP_S and not isinstance(action, Adaptive):
            where = f"[{step.where}]" if step.where else f"step '{step.do}'"
            raise UsageError(
                f"{self.session.place}: {where}: takes {duration_s:.4g} s; one step may take {MOST_STEP_S:g} s at "
                "most; make it shorter, or repeat it (repeat = 2)"
            )

    def _check(self, condition: Condition | None, where: str) -> None:
        if condition is None:
            return
        if condition.answer and condition.answer not in self.asked:
            raise UsageError(
                f'{self.session.place}: [{where}]: no prompt "{condition.answer}" comes before it; '
                'put a step do = "ask" with that name there'
            )
        check_unit(condition, self.rig, f"{self.session.place}: [{where}]")


def _label(step: Step) -> str:
    """The label of the step, with its modulations."""
    under = f"modulation {', '.join(step.modulations)}" if step.modulations else ""
    return ", ".join(filter(None, (step.label, under)))


def _in_units(modulations: Sequence[str], rig: Rig, place: str) -> tuple[float, ...]:
    """Convert to the unit of the rig's modulator. Raises UsageError. Without a modulator the step itself is refused."""
    if rig.modulation is None:
        return ()
    try:
        return tuple(parse_quantity(each, rig.modulation.unit) for each in modulations)
    except ValueError as error:
        raise UsageError(f"{place}: modulation: {error}") from None


def _again(step: PlannedStep, turn: int) -> PlannedStep:
    return replace(step, label=_joined(step.label, str(turn)), certain=False)


def _joined(label: str, turn: str) -> str:
    return f"{label}, turn {turn}" if label else f"turn {turn}"


@dataclass(frozen=True)
class Program:
    """The checked items of a session, and the plan of all of them."""

    steps: tuple[Made | MadeBlock, ...]
    always: tuple[Made | MadeBlock, ...]
    plan: tuple[PlannedStep, ...]

    def every_turn(self) -> Iterator[Made]:
        """Every step of the plan, in order; a repeated step occurs as often as it may run."""
        return turns((*self.steps, *self.always))

    def script(self, so_far: SoFar) -> Script:
        """One item after the other; at the end, also after a failure, those that always run."""
        try:
            for item in self.steps:
                yield from item.script(so_far)
        finally:
            for item in self.always:
                yield from item.script(so_far)


def make_program(session: Session, rig: Rig) -> Program:
    """The session's steps, ready to run on ``rig``.

    Raises RigError for what the rig cannot do, UsageError for steps out of order and conditions that cannot be judged.
    """
    maker = _Maker(session, rig)
    steps = maker.items(session.steps, set())
    _check_always(session)
    always = maker.items(session.always, set())
    _check_length(maker.plan, session.place)
    for expectation in session.expectations:
        check_expectation(expectation, rig, session.place)
    return Program(steps, always, tuple(maker.plan))


def make_experiment(session: Session, rig: Rig) -> Experiment:
    """The session as an experiment. Raises as :func:`make_program` does."""
    program = make_program(session, rig)
    asks = [made.action for made in program.every_turn() if isinstance(made.action, Ask)]
    return Experiment(program.script, program.plan, tuple(dict.fromkeys(ask.prompt for ask in asks)))


def of_procedures(procedures: Sequence[Procedure | Adaptive], rig: Rig) -> Experiment:
    """An experiment of ``procedures``, one after the other."""

    def script(_so_far: SoFar) -> Script:
        yield from procedures

    return Experiment(script, tuple(PlannedStep(each.name, each.duration_s(rig)) for each in procedures), ())


def turns(items: Sequence[Made | MadeBlock]) -> Iterator[Made]:
    """Every step, as often as it may run."""
    for item in items:
        if isinstance(item, Made):
            yield item
            continue
        for turn in range(item.block.at_most):
            yield from turns([moved(inner, turn * item.stride) for inner in item.items])


def check_unit(condition: Condition, rig: Rig, place: str) -> None:
    """Raises UsageError where the condition's value is not a quantity in the parameter's unit."""
    try:
        condition.check(rig.command.unit)
    except ValueError as error:
        raise UsageError(f"{place}: {error}") from None


def _check_length(plan: Sequence[PlannedStep], place: str) -> None:
    whole_s = sum(step.duration_s for step in plan)
    if whole_s > MOST_SESSION_S:
        raise UsageError(
            f"{place}: takes up to {whole_s:.4g} s in all; a session may take {MOST_SESSION_S / 3600:g} h at most: "
            "the fit holds all data in memory; divide it into several sessions"
        )


def _check_always(session: Session) -> None:
    for step in flat(session.always):
        if step.do not in ALWAYS_POSSIBLE:
            raise UsageError(
                f"{session.place}: [{step.where}]: needs other steps, which may have failed by then; "
                f"always = true is for {', '.join(ALWAYS_POSSIBLE)}"
            )


@dataclass(frozen=True)
class Rehearsed:
    """``faults`` by the step in which they happen; None for those of the whole session."""

    backend: Rehearsal | None = None
    faults: Mapping[str | None, tuple[Any, ...]] = field(default_factory=dict)

    def begin(self, step: str | None) -> None:
        """Inject the faults of ``step``, or those of the whole session (None)."""
        if self.backend is not None:
            self.backend.inject(*self.faults.get(step, ()))

    def happened(self) -> list[tuple[int, str]]:
        """Time [ns] and description of each fault that has begun, those of the rig file included."""
        injected = () if self.backend is None else self.backend.injected
        return [(fault.begun_ns, fault.said) for fault in injected if fault.begun_ns is not None]


def rehearsed(session: Session, backend: Backend) -> Rehearsed:
    """The faults of the session, for a backend that can inject them.

    Raises UsageError where there are faults and the backend is no simulation; WiringError for faults that are wrong.
    """
    if not isinstance(backend, Rehearsal):
        if session.faults:
            raise UsageError(
                f"{session.place}: [[fault]] is for the simulated backend only; "
                "leave the section out, or add --backend simulated"
            )
        return Rehearsed()
    read = backend.read_faults([fault.table for fault in session.faults], place=session.place)
    by_step: dict[str | None, tuple[Any, ...]] = {}
    for written, fault in zip(session.faults, read, strict=True):
        by_step[written.during] = (*by_step.get(written.during, ()), fault)
    return Rehearsed(backend, by_step)
