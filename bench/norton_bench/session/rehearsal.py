"""The faults of a session: checked before anything moves, and injected when their step begins."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.session.schema import Session
from norton_drivers.ports import Backend
from norton_drivers.rehearsal import Rehearsal


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
