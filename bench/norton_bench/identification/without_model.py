"""What a recording says without a parametric model, and how well each way predicts what no fit has looked at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification import friction_operators as operators
from norton_bench.identification import loops
from norton_bench.identification.friction_operators import bounded_solution
from norton_bench.identification.impedance_table import ImpedanceTable, impedance_table
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.regression import Regression
from norton_bench.identification.results import FitResult, Trace, trace
from norton_bench.identification.rows import Aligned, align, usable_of
from norton_bench.identification.search_box import S_PER_RAD
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.signals import Signals
from norton_bench.records import SegmentInfo

# Yield displacements of each kind, evenly spread in the logarithm over what the fit of the network searches too.
ELEMENTS = 20
YIELD_RAD = np.geomspace(1 / S_PER_RAD[1], 1 / S_PER_RAD[0], ELEMENTS)
# The command's last values: so many ticks, beginning this much before it was sent (the torque's own delay counts).
COMMAND_TICKS = 20
LEAD_TICKS = 4


# The impedance without a friction law: a generalised Maxwell-slip (Prandtl-Ishlinskii) operator of the motion.
#
# τ(t) = Σ_k g_k·c(t − k·Δ) − I·ω̇ − B·ω − Σ_j w_j·h_j(θ)(t) − Σ_j b_j·ḣ_j(θ)(t), w_j, b_j >= 0
#
# Each h_j is an element in -1 .. 1 that follows the motion like a spring and yields at a displacement of its own.
# Half of them yield all at once (stops: ideal springs in series with sliders), half gradually (the share that still
# holds decays with the way travelled); which kind friction is made of, and at what displacements it yields, is left
# to the data. All weights are linear, so they come from one least squares with some of them held non-negative. The
# command acts through its own last values, each with a weight: no first-order amplifier either.
@dataclass(frozen=True)
class StopOperator:
    """Weights of the operator.

    ``strength_nm`` (2, elements) is what each element holds once it has yielded, the abrupt ones before the gradual
    ones; ``damping_nms`` (2, elements) is torque per rate of its share. ``response`` (ticks,) is torque per
    command, tick by tick from ``LEAD_TICKS`` before it was sent.
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
    nonnegative, retained = np.zeros(normal.moment.size, dtype=bool), np.ones(normal.moment.size, dtype=bool)
    nonnegative[friction] = True
    retained[friction] = np.repeat([True, gradual, True, gradual], ELEMENTS)
    weights = normal.solution(nonnegative, retained)
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


@dataclass(frozen=True)
class Prediction:
    """Torque under unseen motion: ``share`` of it could be predicted at all, the errors are over that share."""

    torque_rms_nm: float
    torque_relative: float
    share: float


@dataclass(frozen=True)
class WithoutModel:
    """``fitted`` is the operator's torque where it was fitted, for its loops; ``unseen`` on the validation segments.

    ``stops_alone`` tells what the classical operator of ideal stops would have come to there. None where nothing was
    measured that could tell.
    """

    table: ImpedanceTable | None
    operator: StopOperator | None
    fitted: Trace | None = None
    unseen: Trace | None = None
    table_prediction: Prediction | None = None
    operator_prediction: Prediction | None = None
    stops_alone: Prediction | None = None


def without_model(
    result: FitResult,
    stretches: Sequence[Signals],
    unseen: Sequence[Signals],
    segments: Sequence[SegmentInfo],
) -> WithoutModel | None:
    """Table and operator from ``stretches``, each tried on ``unseen``; of ``result`` only the delays and zero are used.

    None where no torque was measured.
    """
    if any(stretch.torque_nm is None for stretch in (*stretches, *unseen)):
        return None
    seen, bias = align(stretches, result.motion_delay_s), _bias(stretches)
    columns = operator_columns(seen)
    normal = Normal.of(np.concatenate([columns, bias]), usable_of(seen, [each.torque_nm for each in seen]))
    table = impedance_table(seen, segments, result.torque_bias_nm)
    operator = fit_operator(normal)
    fitted = trace(tuple(stretches), *_pair(seen, operator.predict(columns), bias))
    if not unseen:
        return WithoutModel(table, operator, fitted)
    new, new_bias = align(unseen, result.motion_delay_s), _bias(unseen)
    new_columns = operator_columns(new)
    pair = _pair(new, operator.predict(new_columns), new_bias)
    stops = fit_operator(normal, gradual=False)
    return WithoutModel(
        table,
        operator,
        fitted,
        trace(tuple(unseen), *pair),
        None if table is None else _prediction(*_pair(new, table.predict(new), new_bias)),
        _prediction(*pair),
        _prediction(*_pair(new, stops.predict(new_columns), new_bias)),
    )


def _bias(stretches: Sequence[Signals]) -> FloatArray:
    return Regression.of(tuple(stretches), FULL_BAND).bias()


def _pair(stretches: Sequence[Aligned], predicted: FloatArray, bias: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Torque measured and predicted, with the sensor's slow zero, which nothing predicts, put into the latter."""
    measured = usable_of(stretches, [each.torque_nm for each in stretches])
    known = np.isfinite(predicted)
    if not known.any():
        return measured, predicted
    return measured, predicted + linear_solution(bias[:, known], (measured - predicted)[known]) @ bias


def _prediction(measured: FloatArray, predicted: FloatArray) -> Prediction:
    known = np.isfinite(predicted)
    share = float(np.mean(known))
    if not known.any():
        return Prediction(float("nan"), float("nan"), share)
    rms = float(np.sqrt(np.mean((measured - predicted)[known] ** 2)))
    return Prediction(rms, rms / float(np.sqrt(np.mean(measured[known] ** 2))), share)
