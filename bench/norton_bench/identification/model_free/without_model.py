"""What a recording says without a parametric model, and how well each way predicts what no fit has looked at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.aligned import Aligned, align, usable_of
from norton_bench.identification.fit import trace
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.model_free.impedance_table import ImpedanceTable, impedance_table
from norton_bench.identification.model_free.stop_operator import Normal, StopOperator, fit_operator, operator_columns
from norton_bench.identification.regression import Regression
from norton_bench.identification.results import FitResult, Trace
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.signals import Signals
from norton_bench.records import SegmentInfo


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
