"""What every plausibility check is: it looks at a tick, and says in a sentence what cannot be."""

from typing import Protocol

from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

# A reading that is wrong once is a glitch; wrong as often as this, one after the other, it is a fault.
STRIKES = 3


class Check(Protocol):
    """One relation between signals that must hold. Its name is the one that ``[guard] leave_out`` knows."""

    @property
    def name(self) -> str: ...

    def begin(self, sample: Sample) -> None:
        """The drives were just enabled at zero."""
        ...

    def know(self, known: Known) -> None:
        """From now on, lean on this."""
        ...

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        """What is wrong, with place, numbers and mend; None where nothing is. ``sent`` is what acts since last tick."""
        ...
