"""Procedures by the name a session file gives them, and the order in which they build on each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.errors import UsageError
from bench.procedures.blocked import BlockedProcedure
from bench.procedures.calibrate import CalibrateProcedure
from bench.procedures.free import FreeProcedure
from bench.procedures.imposed import ImposedProcedure
from bench.procedures.knowledge import Adaptive, Procedure
from bench.procedures.refine import RefineProcedure
from bench.procedures.tare import TareProcedure
from bench.procedures.validate import ValidateProcedure
from bench.rig.rig import Rig


@dataclass(frozen=True)
class Entry:
    """How a procedure is made from its options, and which must have run before it, with a load drive and without."""

    make: type[Any]
    after: tuple[str, ...] = ()
    after_alone: tuple[str, ...] = ()


CATALOGUE: Mapping[str, Entry] = {
    "tare": Entry(TareProcedure),
    "calibrate": Entry(CalibrateProcedure, after=("tare",)),
    "free": Entry(FreeProcedure, after=("calibrate",)),
    "blocked": Entry(BlockedProcedure, after=("calibrate",)),
    "imposed": Entry(ImposedProcedure, after=("calibrate",)),
    # Chosen from a first fit, which needs something to fit.
    "refine": Entry(RefineProcedure, after=("calibrate", "imposed")),
    # Commands that nobody has tried free may drive the shaft beyond its limit.
    "validate": Entry(ValidateProcedure, after=("calibrate", "free"), after_alone=("free",)),
}


def make_procedures(steps: Sequence[tuple[str, Any]], rig: Rig, *, place: str) -> tuple[Procedure | Adaptive, ...]:
    """The procedures for ``steps`` of (name, options), each checked against the rig before anything moves.

    Raises RigError for what the rig cannot do, UsageError for steps out of order.
    """
    made: list[Procedure | Adaptive] = []
    for number, (name, options) in enumerate(steps, 1):
        entry = CATALOGUE[name]
        procedure: Procedure | Adaptive = entry.make(options)
        procedure.require(rig)
        needed = entry.after_alone if rig.wiring.load is None else entry.after
        missing = [before for before in needed if before not in {earlier.name for earlier in made}]
        if missing:
            raise UsageError(
                f"{place}: step {number} '{name}' builds on '{missing[0]}': put a step do = \"{missing[0]}\" before it"
            )
        made.append(procedure)
    return tuple(made)
