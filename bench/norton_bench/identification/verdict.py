"""What the data cannot tell, in words: from the directions of parameter space in which the estimate is loose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.parameters import Estimate, Status

# A combination of parameters less certain than this, relative, is not known.
LOOSE_BEYOND = 0.5
# A parameter takes part in a direction with at least this share of the greatest part.
TAKES_PART = 0.3
# All that grow by the same factor, to within this, are known up to a common factor.
COMMON_WITHIN = 0.25
MEND = {
    "torque_gain": "impose motion and measure torque to fix it",
    "amplifier_bandwidth": "command faster changes",
    "inertia": "impose faster motion",
    "viscous_damping": "impose a wider range of velocities",
    "coulomb_torque": "turn the shaft both ways, well beyond presliding",
    "presliding_stiffness": "impose slow motion of small amplitude",
    "presliding_damping": "impose small, fast motion about a standstill",
}


@dataclass(frozen=True)
class Direction:
    """Parameters that may move together at no cost: relative deviation along it, and each one's part."""

    deviation: float
    names: tuple[str, ...]
    parts: FloatArray

    @property
    def common_factor(self) -> bool:
        """Whether all parts are one and the same."""
        return bool(np.ptp(self.parts) <= COMMON_WITHIN * np.max(np.abs(self.parts)))


def loose_directions(names: Sequence[str], relative_covariance: FloatArray) -> tuple[Direction, ...]:
    """The singular directions of the information, the loosest first; ``relative_covariance`` is of logarithms."""
    variance, vectors = np.linalg.eigh(relative_covariance)
    found = []
    for k in reversed(range(len(variance))):
        deviation = float(np.sqrt(max(variance[k], 0.0)))
        if not deviation > LOOSE_BEYOND:
            break
        largest = int(np.argmax(np.abs(vectors[:, k])))
        vector = vectors[:, k] * np.sign(vectors[largest, k])
        taking = np.flatnonzero(np.abs(vector) >= TAKES_PART * np.max(np.abs(vector)))
        found.append(Direction(deviation, tuple(names[int(i)] for i in taking), vector[taking]))
    return tuple(found)


def words(direction: Direction) -> str:
    """One sentence: what is loose, and what would fix it."""
    names = [name.replace("_", " ") for name in direction.names]
    mend = MEND.get(direction.names[int(np.argmax(np.abs(direction.parts)))], "excite it more")
    if len(names) == 1:
        return f"The data hardly excite {names[0]}: uncertain by more than half of the value; {mend}."
    together = f"{', '.join(names[:-1])} and {names[-1]}"
    if direction.common_factor:
        return f"Known only up to a common factor are {together}: {MEND['torque_gain']}."
    return f"Known only in combination are {together}: one can make up for another; {mend}."


def verdict(
    estimates: Sequence[Estimate],
    directions: Sequence[Direction],
    *,
    ratios: Sequence[Estimate],
    converged: bool,
    has_current: bool,
) -> tuple[str, ...]:
    """All sentences. ``ratios`` are what is known per unit of torque gain where the scale is not."""
    sentences = []
    if not converged:
        sentences.append("The fit did not converge: treat every number as provisional, and measure longer or faster.")
    sentences += [words(direction) for direction in directions]
    if ratios:
        sentences.append(_ratio_sentence(ratios))
    names = [estimate.name.replace("_", " ") for estimate in estimates if estimate.status is Status.AT_BOUND]
    if names:
        these = "it is" if len(names) == 1 else "they are"
        sentences.append(f"At the edge of what was searched: {', '.join(names)}; {these} no estimate.")
    if not has_current:
        sentences.append("Torque constant and amplifier gain are known only as a product: no current was measured.")
    return tuple(sentences)


def _ratio_sentence(ratios: Sequence[Estimate]) -> str:
    known = [
        f"{estimate.name.replace('_', ' ')} / torque gain = {estimate.value:.4g} ± {estimate.half_interval:.2g}"
        for estimate in ratios
    ]
    return f"Known are the ratios {', '.join(known)} (per command unit; ± is half of a 95 % interval)."
