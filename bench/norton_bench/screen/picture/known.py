"""What is known of the actuator by now, and how it came to be known: live estimates over time, then the final fit."""

from dataclasses import dataclass, field
from math import isfinite

from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameters import Estimate, Status

WIDTH_95 = 1.96
# Enough for any sparkline; thinned by half whenever there are twice as many.
KEPT = 64


def half_width(estimate: Estimate) -> float:
    """Half the 95 % interval over the value; NaN where there is neither."""
    if not (isfinite(estimate.value) and isfinite(estimate.std)) or estimate.value == 0 or estimate.std <= 0:
        return float("nan")
    return WIDTH_95 * estimate.std / abs(estimate.value)


@dataclass
class Known:
    """The newest estimates, and for each parameter its relative half-widths so far, oldest first.

    ``final`` once they are those of the final fit.
    """

    estimates: tuple[Estimate, ...] = ()
    widths: dict[str, list[float]] = field(default_factory=dict)
    final: bool = False
    _stamp_ns: int = -1
    _every: int = 1
    _count: int = 0

    @property
    def valid(self) -> int:
        return sum(estimate.status is Status.VALID for estimate in self.estimates)

    def take(self, live: LiveEstimate) -> None:
        """Learn what the identifier says now; what it said already is no news."""
        if self.final or live.stamp_ns <= self._stamp_ns or not live.estimates:
            return
        self._stamp_ns = live.stamp_ns
        changed, self.estimates = live.estimates != self.estimates, live.estimates
        if not changed:
            return
        self._count += 1
        if self._count % self._every == 0:
            self._remember()

    def settle(self, estimates: tuple[Estimate, ...]) -> None:
        """The final fit takes the place of the live values; where there was none, these stay."""
        if estimates:
            self.estimates, self.final = estimates, True
            self._remember()

    def network(self) -> dict[str, float] | None:
        """The values by name once every one of them is valid, for the curve of the source."""
        if not self.estimates or self.valid < len(self.estimates):
            return None
        return {estimate.name: estimate.value for estimate in self.estimates}

    def _remember(self) -> None:
        for estimate in self.estimates:
            self.widths.setdefault(estimate.name, []).append(half_width(estimate))
        if max(map(len, self.widths.values())) > 2 * KEPT:
            self.widths = {name: widths[1::2] for name, widths in self.widths.items()}
            self._every *= 2
