"""The faults of a session: read before anything moves, and let happen when their step begins."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.session.schema import Session
from norton_drivers.ports import Backend
from norton_drivers.rehearsal import Rehearsal


@dataclass(frozen=True)
class Rehearsed:
    """``faults`` by the step they belong to, None for those of the whole session."""

    backend: Rehearsal | None = None
    faults: Mapping[str | None, tuple[Any, ...]] = field(default_factory=dict)

    def begin(self, step: str | None) -> None:
        """Give the world what is to happen from now on: in that step, or with None in the session."""
        if self.backend is not None:
            self.backend.inject(*self.faults.get(step, ()))

    def happened(self) -> list[tuple[int, str]]:
        """When each fault that has begun did [ns], and in words which it was; those of the rig file too."""
        injected = () if self.backend is None else self.backend.injected
        return [(fault.begun_ns, fault.said) for fault in injected if fault.begun_ns is not None]


def rehearsed(session: Session, backend: Backend) -> Rehearsed:
    """The session's faults, for a backend that can rehearse them.

    Raises UsageError where it has some and the backend is no simulation, WiringError, with place and mend, for wrong
    ones.
    """
    if not isinstance(backend, Rehearsal):
        if session.faults:
            raise UsageError(
                f"{session.place}: [[fault]] is for the simulated backend alone, and this run is not on it; "
                "leave the section out, or add --backend simulated"
            )
        return Rehearsed()
    read = backend.read_faults([fault.table for fault in session.faults], place=session.place)
    by_step: dict[str | None, tuple[Any, ...]] = {}
    for written, fault in zip(session.faults, read, strict=True):
        by_step[written.during] = (*by_step.get(written.during, ()), fault)
    return Rehearsed(backend, by_step)
