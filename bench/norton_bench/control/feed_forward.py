"""The command that makes the load's amplifier deliver a given torque, one arrival ahead."""

from dataclasses import dataclass
from math import exp

import numpy as np

from norton_bench.control import core
from norton_bench.control.dynamics import FloatArray


@dataclass
class FeedForward:
    """Inverts the amplifier's lag exactly at the instants at which commands arrive.

    ``shares`` holds the commands asked for, this tick's first; ``delivered`` is what they alone make the amplifier
    deliver at this tick, and when the next command arrives.
    """

    gain: float
    bandwidth_rad_s: float
    tick_s: float
    fraction_s: float  # how far into a tick commands arrive
    whole: int
    limit_nm: float

    def __post_init__(self) -> None:
        self.shares: FloatArray = np.zeros(self.whole + 2)
        self.delivered: FloatArray = np.zeros(2)
        # What stays of a difference over a tick, over its part before a command arrives, and over that after.
        stays, stays_before, stays_after = (
            exp(-self.bandwidth_rad_s * lasts_s)
            for lasts_s in (self.tick_s, self.fraction_s, self.tick_s - self.fraction_s)
        )
        self.lag: FloatArray = np.array([self.gain, self.limit_nm, stays, stays_before, stays_after])

    def advance(self) -> None:
        """Let one tick pass."""
        core.pass_on(self.shares, self.delivered, self.lag)
