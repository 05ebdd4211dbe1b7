"""The command that makes the load's amplifier deliver a given torque, one arrival ahead."""

from dataclasses import dataclass, field
from math import exp

import numpy as np

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

    def begin(self, torque_nm: float) -> None:
        """As if ``torque_nm`` had been asked for all along."""
        self.shares[:] = self._clipped(torque_nm / self.gain)
        self.torque_nm = self._arriving_nm = self.gain * float(self.shares[0])

    def ask(self, torque_nm: float) -> None:
        """Find this tick's share, so that the torque is there when the next command arrives."""
        stays = exp(-self.bandwidth_rad_s * self.tick_s)
        share = (torque_nm - stays * self._arriving_nm) / ((1 - stays) * self.gain)
        self.shares[0] = self._clipped(share)
        self._arriving_nm += (1 - stays) * (self.gain * float(self.shares[0]) - self._arriving_nm)

    def advance(self) -> None:
        """Let one tick pass."""
        for command, lasts_s in ((self.whole + 1, self.fraction_s), (self.whole, self.tick_s - self.fraction_s)):
            share = self.gain * float(self.shares[command])
            self.torque_nm += (1 - exp(-self.bandwidth_rad_s * lasts_s)) * (share - self.torque_nm)
        self.shares[1:] = self.shares[:-1]

    def _clipped(self, command_nm: float) -> float:
        return min(max(command_nm, -self.limit_nm), self.limit_nm)
