"""The impedance without a friction law: a generalised Maxwell-slip (Prandtl-Ishlinskii) operator of the motion.

    τ(t) = Σ_k g_k·c(t − k·Δ) − I·ω̇ − B·ω − Σ_j w_j·h_j(θ)(t) − Σ_j b_j·ḣ_j(θ)(t),    w_j, b_j >= 0

Each h_j is an element in -1 .. 1 that follows the motion like a spring and yields at a displacement of its own. Half of
them yield all at once (stops: ideal springs in series with sliders), half gradually (the share that still holds decays
with the way travelled); which kind friction is made of, and at what displacements it yields, is left to the data. All
weights are linear, so they come from one least squares with some of them held non-negative. The command acts through
its own last values, each with a weight: no first-order amplifier either.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification import loops
from norton_bench.identification.aligned import Aligned, usable_of
from norton_bench.identification.friction import operators
from norton_bench.identification.friction.bounded import bounded_solution
from norton_bench.identification.separable import S_PER_RAD

# Yield displacements of each kind, evenly spread in the logarithm over what the fit of the network searches too.
ELEMENTS = 20
YIELD_RAD = np.geomspace(1 / S_PER_RAD[1], 1 / S_PER_RAD[0], ELEMENTS)
# The command's last values: so many ticks, beginning this much before it was sent (the torque's own delay counts).
COMMAND_TICKS = 20
LEAD_TICKS = 4


@dataclass(frozen=True)
class StopOperator:
    """Weights of the operator.

    ``strength_nm`` (2, elements) is what each element holds once it has yielded, the abrupt ones before the gradual
    ones; ``damping_nms`` (2, elements) is torque per rate of its share. ``response`` (ticks,) is torque per command,
    tick by tick from ``LEAD_TICKS`` before it was sent.
    """

    yield_rad: FloatArray
    strength_nm: FloatArray
    damping_nms: FloatArray
    inertia_kgm2: float
    viscous_damping_nms_rad: float
    response: FloatArray

    @property
    def coulomb_torque_nm(self) -> float:
        """What all elements hold together once everything slides."""
        return float(np.sum(self.strength_nm))

    @property
    def torque_gain(self) -> float:
        """Torque per steady command."""
        return float(np.sum(self.response))

    @property
    def abrupt_share(self) -> float:
        """How much of the friction yields all at once, 0 .. 1; NaN where there is none."""
        total = self.coulomb_torque_nm
        return float(np.sum(self.strength_nm[0])) / total if total > 0 else float("nan")

    def predict(self, columns: FloatArray) -> FloatArray:
        """Port torque [N m] under the motion and command that ``columns`` were made of, shape (samples,).

        Elements begin unstrained at each stretch; what they really held fades as the shaft turns.
        """
        linear = [self.inertia_kgm2, self.viscous_damping_nms_rad]
        weights = np.concatenate([self.response, linear, self.strength_nm.ravel(), self.damping_nms.ravel()])
        return np.asarray(weights @ columns)


def operator_columns(stretches: Sequence[Aligned]) -> FloatArray:
    """What the weights multiply, at every usable instant: shape (COMMAND_TICKS + 2 + 4 ELEMENTS, samples)."""
    return usable_of(stretches, [_columns(each, YIELD_RAD) for each in stretches])


@dataclass(frozen=True)
class Normal:
    """The normal equations: all that least squares needs of the samples."""

    gram: FloatArray
    moment: FloatArray

    @classmethod
    def of(cls, columns: FloatArray, target: FloatArray) -> "Normal":
        return cls(columns @ columns.T, columns @ target)

    def solution(self, nonnegative: BoolArray, kept: BoolArray) -> FloatArray:
        """The weights, zero where not ``kept``."""
        weights = np.zeros(self.moment.size)
        weights[kept] = bounded_solution(self.gram[np.ix_(kept, kept)], self.moment[kept], nonnegative[kept])
        return weights


def fit_operator(normal: Normal, *, gradual: bool = True) -> StopOperator:
    """The operator nearest to the torque; columns of ``normal`` beyond the operator's own are no part of it.

    Without ``gradual`` elements it is the classical Prandtl-Ishlinskii operator, of ideal stops alone.
    """
    friction = slice(COMMAND_TICKS + 2, COMMAND_TICKS + 2 + 4 * ELEMENTS)
    nonnegative, kept = np.zeros(normal.moment.size, dtype=bool), np.ones(normal.moment.size, dtype=bool)
    nonnegative[friction] = True
    kept[friction] = np.repeat([True, gradual, True, gradual], ELEMENTS)
    weights = normal.solution(nonnegative, kept)
    strength, damping = weights[friction].reshape(2, 2, ELEMENTS)
    return StopOperator(
        yield_rad=YIELD_RAD,
        strength_nm=strength,
        damping_nms=damping,
        inertia_kgm2=float(weights[COMMAND_TICKS]),
        viscous_damping_nms_rad=float(weights[COMMAND_TICKS + 1]),
        response=weights[:COMMAND_TICKS],
    )


def _columns(stretch: Aligned, yield_rad: FloatArray) -> FloatArray:
    """Command values, then less ω̇, ω, elements (abrupt, gradual) and their rates: (COMMAND_TICKS + 2 + 4 e, n)."""
    count = stretch.command.size
    lags = np.arange(COMMAND_TICKS)[:, None] - LEAD_TICKS
    delayed = stretch.command[np.clip(np.arange(count) - lags, 0, count - 1)]
    path = stretch.signals.path_rad
    begin = np.full(path.size, np.nan)
    begin[0] = 0.0
    abrupt = operators.stops(path, begin, yield_rad)
    gradual = loops.friction_bank(path, path[0], 1 / yield_rad, np.zeros(yield_rad.size))
    shares = [stretch.rows.of_fine_signal(share, (0, 1), stretch.motion_delay_s) for share in (*abrupt, *gradual)]
    elements = np.stack(shares, axis=1).reshape(-1, count)
    return np.concatenate([delayed, -stretch.acceleration_rad_s2[None], -stretch.velocity_rad_s[None], -elements])
