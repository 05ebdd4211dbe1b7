"""A session as plain data: its steps, what repeats them, and what is expected of the result."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from norton_bench.procedures.options import Options, Texts
from norton_bench.session.conditions import Condition


class AskOptions(Options):
    """A prompt: what it is called, what is asked, and the answers allowed (none: any)."""

    name: str = Field(pattern=r"^[\w.-]+$", examples=["fixture"])
    text: str = Field(min_length=1, examples=["Which fixture is mounted?"])
    choices: Annotated[tuple[str, ...], Texts] = Field((), examples=[["A", "B"]])


@dataclass(frozen=True)
class Step:
    """One procedure to run, or a prompt: its name and its options.

    It runs ``when`` that holds. ``label`` tells it from its like, and ``where`` is its place in the file.
    ``modulations`` are those it runs under, one after the other, as quantities in the unit of the rig's modulator.
    """

    do: str
    options: Options
    when: Condition | None = None
    label: str = ""
    where: str = ""
    modulations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Block:
    """Steps that run one after the other ``when`` that holds, and again until ``until`` does, ``at_most`` times."""

    steps: tuple["Step | Block", ...]
    when: Condition | None = None
    until: Condition | None = None
    at_most: int = 1
    where: str = ""


Item = Step | Block


@dataclass(frozen=True)
class Expectation:
    """What is expected of the result: of a parameter, or of the prediction of what no fit has seen.

    ``reference`` and ``within`` go together. ``validation`` is "torque" or "velocity", ``at_most`` its relative error.
    """

    where: str
    condition: Condition | None = None
    reference: str = ""
    within: str = ""
    validation: str = ""
    at_most: float = 0.0


@dataclass(frozen=True)
class WrittenFault:
    """A fault to rehearse: what the simulator reads of it, and the step during which it is to happen, if one."""

    table: Mapping[str, Any]
    during: str | None = None


@dataclass(frozen=True)
class Session:
    """What to do, in order. ``place`` names where it came from; ``rig`` is the rig file, if the session names one.

    ``always`` are the steps that run at the end however it comes. ``parameters`` are those of the file with what was
    set instead. ``arguments`` are those of ``identify`` that made a built-in session what it is. ``faults`` are for a
    simulation.
    """

    steps: tuple[Item, ...]
    place: str
    rig: Path | None = None
    seed: int | None = None
    text: str = ""
    arguments: str = ""
    faults: tuple[WrittenFault, ...] = ()
    always: tuple[Item, ...] = ()
    expectations: tuple[Expectation, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def every_step(self) -> Iterator[Step]:
        """All of them in the order of the file, whatever repeats them; the last ones are those that always run."""
        return flat((*self.steps, *self.always))


def flat(items: Sequence[Item]) -> Iterator[Step]:
    """The steps in ``items``, each as often as it stands there."""
    for item in items:
        if isinstance(item, Step):
            yield item
        else:
            yield from flat(item.steps)
