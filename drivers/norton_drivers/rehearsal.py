"""What a simulated backend may offer beyond ports and a clock: injected faults, and a record of the true state.

Optional: a backend that has these methods has them all, and nothing of a real run asks for them.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

from norton_drivers.ports import Backend


class TrueState(NamedTuple):
    """A simulated bench at one instant, whatever its devices say of it; signs are the bench's.

    ``driving`` are the roles of the drives whose amplifiers head for a current other than zero, ``armed`` of those
    whose firmware has its loop closed.
    """

    stamp_ns: int
    torque_nm: float  # at the port
    velocity_rad_s: float  # of the actuator
    load_velocity_rad_s: float
    driving: tuple[str, ...]
    armed: tuple[str, ...]


class InjectedFault(Protocol):
    """What became of a fault; None for what has not happened yet."""

    @property
    def begun_ns(self) -> int | None: ...
    @property
    def ended_ns(self) -> int | None: ...
    @property
    def hits(self) -> int:
        """Frames or writes that it lost, held up or changed, where it is a fault of those."""
        ...

    @property
    def said(self) -> str:
        """What it is, in words."""
        ...


@runtime_checkable
class Rehearsal(Backend, Protocol):
    """A backend whose world can be made to fail."""

    def read_faults(self, tables: object, *, place: str) -> tuple[Any, ...]:
        """The faults written as ``[[fault]]`` tables in the file ``place``. Raises WiringError with place and mend."""
        ...

    def inject(self, *faults: Any) -> tuple[InjectedFault, ...]:
        """Let them happen, their times counted from now. Raises WiringError for what this bench has no place for."""
        ...

    @property
    def injected(self) -> Sequence[InjectedFault]:
        """Every fault so far, those of the rig file first."""
        ...

    def watch(self) -> Sequence[TrueState]:
        """From now on note what is true, four times a millisecond; the sequence grows as time passes."""
        ...
