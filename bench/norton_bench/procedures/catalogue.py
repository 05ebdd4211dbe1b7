"""Procedures by their name in a session file, and which of them need which before."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.on_demand import deferred
from norton_bench.procedures.knowledge import Adaptive, Procedure
from norton_bench.rig.rig import Rig


@dataclass(frozen=True)
class ProcedureEntry:
    """How a procedure is made from its options, and which must have run before it, with a load drive and without."""

    make: Callable[..., Procedure | Adaptive]
    after: tuple[str, ...] = ()
    after_alone: tuple[str, ...] = ()


def _entry(made_by: str, **needs: tuple[str, ...]) -> ProcedureEntry:
    """``made_by`` is "module:class" of this folder; the module is imported when a session has the step."""
    return ProcedureEntry(deferred(f"norton_bench.procedures.{made_by}"), **needs)


CATALOGUE: Mapping[str, ProcedureEntry] = {
    "tare": _entry("tare:TareProcedure"),
    "calibrate": _entry("calibrate:CalibrateProcedure", after=("tare",)),
    "free": _entry("free:FreeProcedure", after=("calibrate",)),
    "blocked": _entry("blocked:BlockedProcedure", after=("calibrate",)),
    "imposed": _entry("imposed:ImposedProcedure", after=("calibrate",)),
    # Chosen from a first fit, which needs data.
    "refine": _entry("refine:RefineProcedure", after=("calibrate", "imposed")),
    "iterate_zero_torque": _entry("iterate:IterateProcedure", after=("calibrate", "free")),
    # Its command is one that was tried on the free shaft.
    "render": _entry("render:RenderProcedure", after=("calibrate", "free")),
    "in_situ": _entry("in_situ:InSituProcedure", after=("tare",)),
    "rest": _entry("tare:RestProcedure"),
    "tabulate_source": _entry("tabulate_source:TabulateSourceProcedure", after=("calibrate",)),
    "tabulate_impedance": _entry("tabulate_impedance:TabulateImpedanceProcedure", after=("calibrate",)),
    # Commands that were not tried on the free shaft may drive it beyond its limit.
    "validate": _entry("validate:ValidateProcedure", after=("calibrate", "free"), after_alone=("free",)),
}


def make_procedures(steps: Sequence[tuple[str, Any]], rig: Rig, *, place: str) -> tuple[Procedure | Adaptive, ...]:
    """The procedures for ``steps`` of (name, options), each checked against the rig before anything moves.

    Raises RigError for what the rig cannot do, UsageError for steps out of order.
    """
    made: list[Procedure | Adaptive] = []
    for number, (name, options) in enumerate(steps, 1):
        before = {earlier.name for earlier in made}
        made.append(make_procedure(name, options, rig, before, place=f"{place}: step {number}"))
    return tuple(made)


def make_procedure(name: str, options: Any, rig: Rig, before: Collection[str], *, place: str) -> Procedure | Adaptive:
    """One of them; ``before`` are the names of those that will have run by then. Raises as :func:`make_procedures`."""
    procedure = CATALOGUE[name].make(options)
    procedure.require(rig)
    missing = [needed for needed in needed_by(name, rig) if needed not in before]
    if missing:
        raise UsageError(f"{place} '{name}' needs '{missing[0]}': put a step do = \"{missing[0]}\" before it")
    return procedure


def needed_by(name: str, rig: Rig) -> tuple[str, ...]:
    """What must have run before procedure ``name`` on this rig."""
    entry = CATALOGUE[name]
    return entry.after_alone if rig.wiring.load is None else entry.after
