"""What every plausibility check is: it looks at a tick, and says in a sentence what cannot be."""

from typing import Protocol

from norton_bench.guard.commands import Commands
from norton_bench.guard.model import GuardModel
from norton_bench.sample import Sample

# A reading that is wrong once is a glitch; wrong as often as this, one after the other, it is a fault.
STRIKES = 3
# A position that stays where it was for so long, while it should move, is stuck.
PATIENCE_NS = 100_000_000
# An older reading of an encoder tells nothing: it is the business of [limits] stale_after.
FRESH_NS = 30_000_000
# Two positions may differ by so many steps of their resolution, and by this angle.
STEPS = 4
LEAST_RAD = 0.05


class Check(Protocol):
    """One relation between signals that must hold. Its name is the one that ``[guard] leave_out`` knows."""

    @property
    def name(self) -> str: ...

    def begin(self, sample: Sample) -> None:
        """The drives were just enabled at zero."""
        ...

    def learn(self, model: GuardModel) -> None:
        """From now on, use what was measured."""
        ...

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        """What is wrong, with place, numbers and mend; None where nothing is. ``sent`` is what acts since last tick."""
        ...
