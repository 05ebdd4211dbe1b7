"""Torque, motion and command at the same instants and in the same band, whatever is to be made of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.regression import Rows
from norton_bench.identification.signals import FINE, Signals

# As a bandwidth, this makes no lag: the command as it is held.
NO_LAG_RAD_S = 1e9


@dataclass(frozen=True)
class Aligned:
    """One stretch at its ticks, arrays of shape (n,), all through one low-pass, on the torque's time.

    ``command`` is the command as it was held, not delayed: what comes of it later is for others to find out.
    """

    rows: Rows
    motion_delay_s: float
    torque_nm: FloatArray
    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    command: FloatArray

    @property
    def signals(self) -> Signals:
        return self.rows.signals

    @property
    def usable(self) -> npt.NDArray[np.bool_]:
        return self.signals.usable


def align(stretches: Sequence[Signals], motion_delay_s: float) -> tuple[Aligned, ...]:
    """Every stretch; positive ``motion_delay_s`` where motion comes later than torque."""
    return tuple(_align(Rows(stretch, FULL_BAND), motion_delay_s) for stretch in stretches)


def usable_of(stretches: Sequence[Aligned], parts: Sequence[FloatArray]) -> FloatArray:
    """Parts (..., n), one a stretch, cut to what may be used and joined."""
    return np.concatenate([part[..., each.usable] for part, each in zip(parts, stretches, strict=True)], axis=-1)


def _align(rows: Rows, motion_delay_s: float) -> Aligned:
    signals = rows.signals
    held = loops.mean_lag_of_held(
        signals.sent_s,
        signals.command,
        NO_LAG_RAD_S,
        signals.time_s[0],
        signals.tick_s / FINE,
        signals.position_rad.size,
        signals.released_at_zero,
    )
    position, velocity, acceleration = rows.of_fine_signal(signals.position_rad, (0, 1, 2), motion_delay_s)
    return Aligned(
        rows,
        motion_delay_s,
        rows.torque(),
        position,
        velocity,
        acceleration,
        rows.of_fine_signal(held, (0,), 0.0, of_means=True)[0],
    )
