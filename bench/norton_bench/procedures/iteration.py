"""How far a repeated movement has come: its trials, what they taught, and whether they converge."""

from dataclasses import dataclass, replace

from norton_bench.arrays import FloatArray
from norton_bench.identification.trials import TrialFigures, averaged, diverge, settled
from norton_bench.procedures.learning import Correction

# Lessons are averaged until their noise has a quarter of the power that one has: the next would take off a twentieth.
AVERAGED = 4


@dataclass(frozen=True, eq=False)
class Iteration:
    """The state of one iteration over a movement.

    ``command`` (ticks,) is the actuator's, the same in every trial; ``start_rad`` is where the load stands when one
    begins. ``reasons`` say, once ``finished``, why it has not converged.
    """

    command: FloatArray
    start_rad: float
    trials: tuple[TrialFigures, ...] = ()
    corrections: tuple[Correction, ...] = ()
    finished: bool = False
    reasons: tuple[str, ...] = ()

    def after(self, trial: TrialFigures, correction: Correction) -> "Iteration":
        return replace(self, trials=(*self.trials, trial), corrections=(*self.corrections, correction))

    @property
    def converged(self) -> bool:
        return self.finished and not self.reasons

    @property
    def settled(self) -> bool:
        return settled(self.trials)

    @property
    def averaged(self) -> bool:
        """Whether another trial would hardly lessen the noise that was learnt."""
        return averaged(len(self.trials)) >= AVERAGED

    @property
    def diverges(self) -> bool:
        return diverge(self.trials)

    def ended(self, *reasons: str) -> "Iteration":
        return replace(self, finished=True, reasons=reasons)
