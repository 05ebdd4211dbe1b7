"""Procedures by their name in a session file, and which of them need which before."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.procedures.blocked import BlockedProcedure
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.free import FreeProcedure
from norton_bench.procedures.imposed import ImposedProcedure
from norton_bench.procedures.in_situ import InSituProcedure
from norton_bench.procedures.iterate import IterateProcedure
from norton_bench.procedures.knowledge import Adaptive, Procedure
from norton_bench.procedures.refine import RefineProcedure
from norton_bench.procedures.tabulate_impedance import TabulateImpedanceProcedure
from norton_bench.procedures.tabulate_source import TabulateSourceProcedure
from norton_bench.procedures.tare import RestProcedure, TareProcedure
from norton_bench.procedures.validate import ValidateProcedure
from norton_bench.rig.rig import Rig


@dataclass(frozen=True)
class ProcedureEntry:
    """How a procedure is made from its options, and which must have run before it, with a load drive and without."""

    make: type[Any]
    after: tuple[str, ...] = ()
    after_alone: tuple[str, ...] = ()


CATALOGUE: Mapping[str, ProcedureEntry] = {
    "tare": ProcedureEntry(TareProcedure),
    "calibrate": ProcedureEntry(CalibrateProcedure, after=("tare",)),
    "free": ProcedureEntry(FreeProcedure, after=("calibrate",)),
    "blocked": ProcedureEntry(BlockedProcedure, after=("calibrate",)),
    "imposed": ProcedureEntry(ImposedProcedure, after=("calibrate",)),
    # Chosen from a first fit, which needs data.
    "refine": ProcedureEntry(RefineProcedure, after=("calibrate", "imposed")),
    "iterate_zero_torque": ProcedureEntry(IterateProcedure, after=("calibrate", "free")),
    "in_situ": ProcedureEntry(InSituProcedure, after=("tare",)),
    "rest": ProcedureEntry(RestProcedure),
    "tabulate_source": ProcedureEntry(TabulateSourceProcedure, after=("calibrate",)),
    "tabulate_impedance": ProcedureEntry(TabulateImpedanceProcedure, after=("calibrate",)),
    # Commands that were not tried on the free shaft may drive it beyond its limit.
    "validate": ProcedureEntry(ValidateProcedure, after=("calibrate", "free"), after_alone=("free",)),
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
    procedure: Procedure | Adaptive = CATALOGUE[name].make(options)
    procedure.require(rig)
    missing = [needed for needed in needed_by(name, rig) if needed not in before]
    if missing:
        raise UsageError(f"{place} '{name}' needs '{missing[0]}': put a step do = \"{missing[0]}\" before it")
    return procedure


def needed_by(name: str, rig: Rig) -> tuple[str, ...]:
    """What must have run before procedure ``name`` on this rig."""
    entry = CATALOGUE[name]
    return entry.after_alone if rig.wiring.load is None else entry.after
