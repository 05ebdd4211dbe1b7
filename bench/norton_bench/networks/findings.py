"""What is said of a condition, and what the modes of a free port say of its stability."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import ComplexArray

# What is said of a condition.
VERDICTS = {True: "holds", False: "does not hold", None: "cannot be told"}
# Modes this much slower than the fastest are at zero: rounding leaves them a little beside it.
AT_ZERO = 1e-7
# A mode that decays by less than this share of its own speed does not: rounding again.
UNDAMPED = 1e-6


@dataclass(frozen=True)
class Finding:
    """A condition, whether it holds (None: cannot be told), and why, in a sentence.

    ``interval_rad`` is the widest range of displacement without exertion that was found, where the zero is not unique.
    """

    condition: str
    holds: bool | None
    why: str
    interval_rad: float | None = None


def of_modes(zeros: ComplexArray) -> tuple[bool | None, str]:
    """Whether a port left alone comes to rest, from its modes, and why; None where only modes at zero leave it open."""
    if not zeros.size:
        return True, "there are none"
    speeds = np.abs(zeros)
    at_zero = speeds <= AT_ZERO * speeds.max()
    others = zeros[~at_zero]
    lasting = others[others.real > -UNDAMPED * np.abs(others)]
    if lasting.size:
        worst = lasting[np.argmax(lasting.real)]
        grows = worst.real > UNDAMPED * abs(worst)
        return False, (
            f"one grows, at {worst.real:.4g} rad/s"
            if grows
            else f"an oscillation at {abs(worst):.4g} rad/s does not decay"
        )
    slowest = f"the slowest lies at {others.real.max():.4g} rad/s" if others.size else ""
    if not at_zero.any():
        return True, slowest
    count = int(np.count_nonzero(at_zero))
    number = "one is zero" if count == 1 else f"{count} are zero"
    return None, f"{number}, {slowest} beside" if slowest else number
