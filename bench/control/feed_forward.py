"""The command that makes the load's amplifier deliver a given torque, one arrival ahead."""

from dataclasses import dataclass, field
from math import exp

import numpy as np

from bench.control import core
from bench.control.dynamics import FloatArray


@dataclass
class FeedForward:
    """Inverts the amplifier's lag exactly at the instants at which commands arrive.

    ``shares`` holds the commands asked for, this tick's first; ``torque_nm`` is what they alone make the amplifier
    deliver at this tick.
    """

    gain: float
    bandwidth_rad_s: float
    tick_s: float
    fraction_s: float  # how far into a tick commands arrive
    whole: int
    limit_nm: float
    torque_nm: float = field(default=0.0, init=False)
    _arriving_nm: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self.shares: FloatArray = np.zeros(self.whole + 2)
        # What stays of a difference over a tick, over its part before a command arrives, and over that after.
        self._stays, self._stays_before, self._stays_after = (
            exp(-self.bandwidth_rad_s * lasts_s)
            for lasts_s in (self.tick_s, self.fraction_s, self.tick_s - self.fraction_s)
        )

    def begin(self, torque_nm: float) -> None:
        """As if ``torque_nm`` had been asked for all along."""
        self.shares[:] = self._clipped(torque_nm / self.gain)
        self.torque_nm = self._arriving_nm = self.gain * float(self.shares[0])

    def ask(self, torque_nm: float) -> None:
        """Find this tick's share, so that the torque is there when the next command arrives."""
        stays = self._stays
        share = self._clipped((torque_nm - stays * self._arriving_nm) / ((1 - stays) * self.gain))
        self.shares[0] = share
        self._arriving_nm += (1 - stays) * (self.gain * share - self._arriving_nm)

    def advance(self) -> None:
        """Let one tick pass."""
        for command, stays in ((self.whole + 1, self._stays_before), (self.whole, self._stays_after)):
            self.torque_nm += (1 - stays) * (self.gain * float(self.shares[command]) - self.torque_nm)
        core.put_first(self.shares, self.shares[0])

    def _clipped(self, command_nm: float) -> float:
        return min(max(command_nm, -self.limit_nm), self.limit_nm)
