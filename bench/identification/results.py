"""What an identification says: estimates with their confidence, residuals, and what the data cannot tell."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from bench.models.network import NortonNetwork
from bench.models.parameters import Estimate

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """Measured beside predicted, arrays of shape (n,); NaN between segments."""

    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray
    unit: str


@dataclass(frozen=True)
class FitResult:
    """One fit of the Norton network.

    ``torque_rms_nm`` is the rms of the torque residual, ``torque_relative`` that over the rms of the torque. Delays are
    relative to the torque stream; positive means later. ``verdict`` says in words what the data cannot tell.
    """

    estimates: tuple[Estimate, ...]
    network: NortonNetwork
    converged: bool
    torque_rms_nm: float
    torque_relative: float
    samples: int
    command_delay_s: float
    command_delay_std_s: float
    motion_delay_s: float
    motion_delay_std_s: float
    trace: Trace
    torque_bias_nm: float = 0.0  # what the torque reads with nothing at the port, in the sign of the port looked at
    verdict: tuple[str, ...] = ()

    def estimate(self, name: str) -> Estimate:
        """Raises KeyError for a name that was not estimated."""
        return {estimate.name: estimate for estimate in self.estimates}[name]


@dataclass(frozen=True)
class Validation:
    """Prediction of segments that no fit has seen: torque under the measured motion, and the free motion itself."""

    torque_rms_nm: float
    torque_relative: float
    velocity_rms_rad_s: float
    velocity_relative: float
    torque: Trace
    velocity: Trace


@dataclass(frozen=True)
class SourceMap:
    """The static motion source as measured: steady free velocity against command; arrays of shape (levels,).

    ``rising`` says from which side each level was approached.
    """

    command: FloatArray
    velocity_rad_s: FloatArray
    velocity_std_rad_s: FloatArray
    rising: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class BlockedMap:
    """The Thévenin experiment: torque at standstill against command, by the side from which standstill was reached."""

    command: FloatArray
    torque_nm: FloatArray
    torque_std_nm: FloatArray
    from_above: npt.NDArray[np.bool_]  # True: the shaft came to rest from positive velocity


@dataclass(frozen=True)
class LiveEstimate:
    """The state of the live identification at ``stamp_ns``. ``network`` is there once every parameter is valid."""

    stamp_ns: int
    estimates: tuple[Estimate, ...] = ()
    network: NortonNetwork | None = None
    samples: int = field(default=0)
