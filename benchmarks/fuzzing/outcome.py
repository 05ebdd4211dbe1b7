"""What became of a million frames or bytes, and whether it is as it should be."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from scipy.stats import poisson

# How improbable a count may be before it is no longer put down to chance.
_IMPROBABLE = 1e-6


class Judged(NamedTuple):
    """``wrong`` of ``readings`` were not sent, where ``by_chance`` were to be expected by the codec's own checks.

    ``altered`` of them were made on the way, in a form that only a checksum could tell from the device's own.
    """

    readings: int
    wrong: int
    by_chance: float = 0.0
    altered: int = 0


@dataclass(frozen=True)
class Outcome:
    """One codec and one kind of food. ``exceptions`` are those that were raised, as texts."""

    codec: str
    fed: str
    count: int
    unit: str
    judged: Judged
    exceptions: Sequence[str]
    redundancy: str
    seconds: float

    @property
    def good(self) -> bool:
        """No exception, and no more false readings than chance has to do with."""
        return not self.exceptions and self.judged.wrong <= self.allowed

    @property
    def allowed(self) -> int:
        by_chance = self.judged.by_chance
        return int(poisson.isf(_IMPROBABLE, by_chance)) if by_chance else 0
