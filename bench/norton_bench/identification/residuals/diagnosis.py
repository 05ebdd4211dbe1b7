"""What the residual of a fit still tells: whether it remembers itself, and which measured signal it follows.

The residual lives in the fit's band: neighbouring samples are alike even if nothing is wrong. So it is thinned to the
band and freed of the colour that the fit's own low-pass gives to white noise; only then is whiteness judged. Variances
may change over time (the encoder's noise weighs more where the shaft accelerates): no test assumes otherwise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.aligned import Aligned, align
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.residuals.dependence import (
    MEMORY_LAGS,
    ORDER,
    Dependence,
    Memory,
    dependence,
    memory,
    whiten,
)
from norton_bench.identification.residuals.position_lines import Harmonic, position_harmonics
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import Signals
from norton_bench.identification.validation import network_trace

# Thinned by this, the samples are as many as the band holds.
STRIDE = 3
# Inputs that hold the encoder's noise.
OWN_NOISE = ("velocity", "acceleration")
# Slower than this share of the fastest is rest: no direction.
REST_SHARE = 0.005


@dataclass(frozen=True)
class ResidualTests:
    """All tests of one residual. ``spectrum_nm`` (MOST_PERIODS,) is amplitude by periods a turn, from 1 on; NaN where
    the shaft did not turn enough, or too fast, to tell.

    ``memory`` is None where the residual is one of the motion itself: the encoder's noise, differentiated twice, is
    coloured by nature.
    """

    rms_nm: float
    memory: Memory | None
    dependences: tuple[Dependence, ...]
    harmonics: tuple[Harmonic, ...]
    spectrum_nm: FloatArray


@dataclass(frozen=True)
class Thinned:
    """Signals on one uniform grid, gaps as NaN: residual (n,), each input (n,), the shaft's position and velocity."""

    step_s: float
    residual: FloatArray
    inputs: Mapping[str, FloatArray]
    position_rad: FloatArray
    velocity_rad_s: FloatArray


def diagnose(result: FitResult, stretches: tuple[Signals, ...]) -> ResidualTests | None:
    """Of what the network of a fit leaves of ``stretches``; None where too little was fitted to judge."""
    told = network_trace(result, stretches, free_motion=result.ratios_only)
    ends = np.cumsum([len(stretch.time_s) for stretch in stretches])[:-1]
    parts = np.split(told.measured - told.predicted, ends)
    return residual_tests(parts, align(stretches, result.motion_delay_s), of_motion=result.ratios_only)


def residual_tests(
    residual: Sequence[FloatArray], stretches: Sequence[Aligned], *, of_motion: bool = False
) -> ResidualTests | None:
    """Of residuals (n,), one a stretch, NaN where nothing was fitted; None where too few are left to judge.

    A residual ``of_motion`` shares its noise with velocity and acceleration, and follows them for that alone: neither
    they nor its memory are then looked at.
    """
    together = _thinned(residual, stretches)
    whitened = whiten(together.residual, FULL_BAND, STRIDE)
    if np.count_nonzero(np.isfinite(whitened)) < 10 * MEMORY_LAGS:
        return None
    rms = float(np.sqrt(np.nanmean(together.residual**2)))
    dependences = []
    for name, values in together.inputs.items():
        if of_motion and name in OWN_NOISE:
            continue
        found = dependence(whitened, whiten(values, FULL_BAND, STRIDE), together.step_s, name, rms)
        if found is not None:
            dependences.append(found)
    spectrum, harmonics = position_harmonics(
        together.residual, together.position_rad, together.velocity_rad_s, together.step_s, together.step_s / STRIDE
    )
    remembered = None if of_motion else memory(whitened, together.step_s)
    return ResidualTests(rms, remembered, tuple(dependences), harmonics, spectrum)


def _thinned(residual: Sequence[FloatArray], stretches: Sequence[Aligned]) -> Thinned:
    """All stretches on the thinned grid, kept apart by gaps longer than any lag."""
    gap = np.full(MEMORY_LAGS + ORDER, np.nan)

    def joined(parts: Sequence[FloatArray]) -> FloatArray:
        return np.concatenate([piece for part in parts for piece in (part[::STRIDE], gap)])

    fastest = max(float(np.max(np.abs(each.velocity_rad_s))) for each in stretches)
    direction = [
        each.rows.of_tick_signal(np.sign(each.velocity_rad_s) * (np.abs(each.velocity_rad_s) > REST_SHARE * fastest))
        for each in stretches
    ]
    velocity = joined([each.velocity_rad_s for each in stretches])
    return Thinned(
        step_s=STRIDE * stretches[0].signals.tick_s,
        residual=joined(residual),
        inputs={
            "command": joined([each.command for each in stretches]),
            "velocity": velocity,
            "acceleration": joined([each.acceleration_rad_s2 for each in stretches]),
            "direction": joined(direction),
        },
        position_rad=joined([each.position_rad for each in stretches]),
        velocity_rad_s=velocity,
    )
