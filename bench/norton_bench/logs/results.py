"""What the fit of a foreign log says."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.results import Trace
from norton_bench.models.parameters import Estimate


@dataclass(frozen=True)
class ErrorFigures:
    """How far a prediction is from what was measured, ``rms`` and ``mean_absolute`` in ``unit``.

    ``relative`` is the rms over that of the quantity: of exertion as it stands, of a position about its mean.
    """

    rms: float
    relative: float
    mean_absolute: float
    unit: str

    @classmethod
    def of(cls, residual: FloatArray, scale: float, unit: str) -> "ErrorFigures | None":
        """None where there is no sample."""
        if not residual.size:
            return None
        rms = float(np.sqrt(np.mean(residual**2)))
        return cls(rms, rms / scale if scale > 0 else float("nan"), float(np.mean(np.abs(residual))), unit)


@dataclass(frozen=True)
class Errors:
    """Of one side of the split; None for what was not measured or cannot be predicted."""

    exertion: ErrorFigures | None = None
    motion: ErrorFigures | None = None


@dataclass(frozen=True)
class Step:
    """One model of the ladder; relative errors are over the rms of the exertion."""

    model: str
    train_relative: float
    held_out_relative: float
    held_out_std: float
    selected: bool
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class LogFit:
    """One fit. ``doubtful`` says that the log contradicts itself or the equation: no estimate is then valid."""

    model: str
    estimates: tuple[Estimate, ...]
    verdict: tuple[str, ...]
    converged: bool
    doubtful: bool
    train: Errors
    test: Errors
    ladder: tuple[Step, ...]
    exertion: Trace
