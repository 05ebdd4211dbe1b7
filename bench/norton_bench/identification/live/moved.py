"""Live values at the session's end beside the final ones: a parameter that moved meanwhile is said to have moved."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.identification.model_error import widened
from norton_bench.identification.results import FitResult
from norton_bench.models.parameters import Estimate, Status

# Deviations. Chance passes it in less than one session of a hundred where seven parameters are compared (Bonferroni).
SIGNIFICANT = 3.2
COMPARABLE = (Status.VALID, Status.INADEQUATE)


@dataclass(frozen=True)
class Change:
    """One parameter, known at the end of the session and from all of it."""

    live: Estimate
    final: Estimate

    @property
    def deviations(self) -> float:
        """The difference over its deviation, at least: both come from the same data, so their errors agree in part."""
        return float((self.live.value - self.final.value) / np.hypot(self.live.std, self.final.std))

    @property
    def significant(self) -> bool:
        return abs(self.deviations) > SIGNIFICANT

    @property
    def sentence(self) -> str:
        name, unit = self.final.name.replace("_", " ").capitalize(), self.final.unit
        return (
            f"{name} moved during the session: {self.live.value:.4g} ± {self.live.half_interval:.2g} {unit} at its "
            f"end, {self.final.value:.4g} {unit} over all of it. Its interval holds the values in between."
        )


def changes(live: Sequence[Estimate], final: FitResult) -> tuple[Change, ...]:
    """Of what is valid in both; what another model would change in the final fit is compared too."""
    before = {estimate.name: estimate for estimate in live if estimate.status is Status.VALID and estimate.std > 0.0}
    return tuple(
        Change(before[each.name], each)
        for each in final.estimates
        if each.name in before and each.status in COMPARABLE and each.std > 0.0
    )


def with_what_moved(result: FitResult, fit: FitResult, live: Sequence[Estimate]) -> FitResult:
    """``result`` with a sentence on each parameter whose live values end elsewhere than ``fit``, wide enough for them.

    ``result`` is ``fit`` with the deviations that the model's error gives. What moves evenly past its mean deviates
    from it by the distance to either end over the square root of 3.
    """
    moved = {change.final.name: change for change in changes(live, fit) if change.significant}
    if not moved:
        return result
    estimates = tuple(_wider(each, moved[each.name]) if each.name in moved else each for each in result.estimates)
    sentences = tuple(change.sentence for change in moved.values())
    return replace(
        result, estimates=estimates, network=widened(result, estimates), verdict=(*sentences, *result.verdict)
    )


def _wider(estimate: Estimate, change: Change) -> Estimate:
    over_time = abs(change.live.value - change.final.value) / np.sqrt(3.0)
    return replace(estimate, std=max(estimate.std, float(np.hypot(change.final.std, over_time))))
