"""What was found without a model, and what the residual tells, as ``--json`` prints it."""

from typing import Any

import numpy as np

from norton_bench.identification.model_free.branches import TAILS, DeadZone, Hysteresis
from norton_bench.identification.model_free.impedance_table import ImpedanceTable
from norton_bench.identification.model_free.without_model import Prediction, StopOperator, WithoutModel
from norton_bench.identification.residuals.diagnosis import ResidualTests
from norton_bench.identification.results import SourceMap


def model_free(source: SourceMap | None, found: WithoutModel | None) -> dict[str, Any] | None:
    """None where nothing was measured that could tell."""
    if source is None and found is None:
        return None
    known = found if found is not None else WithoutModel(None, None)
    return {
        "source": None if source is None else _source(source),
        "table": None if known.table is None else _table(known.table),
        "operator": None if known.operator is None else _operator(known.operator),
        "predicted": {
            "operator": _prediction(known.operator_prediction),
            "stops_alone": _prediction(known.stops_alone),
            "table": _prediction(known.table_prediction),
        },
    }


def residual_figures(tests: ResidualTests | None) -> dict[str, Any] | None:
    """None where too little was fitted to judge."""
    if tests is None:
        return None
    return {
        "rms_nm": tests.rms_nm,
        "white_p": None if tests.memory is None else tests.memory.p_value,
        "greatest_autocorrelation": None if tests.memory is None else tests.memory.greatest,
        "inputs": {
            each.name: {"p": each.p_value, "share": each.share, "rms_nm": each.rms_nm, "peak_hz": each.peak_hz}
            for each in tests.dependences
        },
        "position": [
            {"periods_per_turn": each.periods_per_turn, "amplitude_nm": each.amplitude_nm, "p": each.p_value}
            for each in tests.harmonics
        ],
    }


def _source(source: SourceMap) -> dict[str, Any]:
    known = bool(len(source.resampled_rad_s))
    unknown = np.full((2, source.command.size), np.nan)
    low, high = np.quantile(source.resampled_rad_s, TAILS, axis=0) if known else unknown
    return {
        "command": source.command.tolist(),
        "rising": source.rising.tolist(),
        "velocity_rad_s": source.velocity_rad_s.tolist(),
        "low_rad_s": low.tolist(),
        "high_rad_s": high.tolist(),
        "settling_s": source.settling_s,
        "port_torque_nm": source.port_torque_nm.tolist(),
        "port_torque_std_nm": source.port_torque_std_nm.tolist(),
        "dead_zone": {"rising": _zone(source.dead_zone(True)), "falling": _zone(source.dead_zone(False))},
        "hysteresis": _hysteresis(source.hysteresis()),
    }


def _zone(zone: DeadZone | None) -> dict[str, Any] | None:
    if zone is None:
        return None
    return {
        "low": zone.low,
        "high": zone.high,
        "width": zone.width,
        "low_interval": list(zone.low_interval),
        "high_interval": list(zone.high_interval),
        "width_interval": list(zone.width_interval),
    }


def _hysteresis(found: Hysteresis | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "command": found.command,
        "difference_rad_s": found.difference_rad_s,
        "chance_rad_s": found.band_rad_s,
        "significant": found.significant,
    }


def _table(table: ImpedanceTable) -> dict[str, Any]:
    return {
        "command": table.command.tolist(),
        "velocity_rad_s": table.velocity_rad_s.tolist(),
        "torque_nm": table.torque_nm.tolist(),
        "half_width_nm": table.half_width_nm.tolist(),
        "empty_cells": table.empty,
        "left_out_rms_nm": table.left_out_rms_nm(),
    }


def _operator(operator: StopOperator) -> dict[str, Any]:
    return {
        "torque_gain": operator.torque_gain,
        "inertia_kgm2": operator.inertia_kgm2,
        "viscous_damping_nms_rad": operator.viscous_damping_nms_rad,
        "coulomb_torque_nm": operator.coulomb_torque_nm,
        "abrupt_share": operator.abrupt_share,
        "yield_rad": operator.yield_rad.tolist(),
        "abrupt_nm": operator.strength_nm[0].tolist(),
        "gradual_nm": operator.strength_nm[1].tolist(),
    }


def _prediction(prediction: Prediction | None) -> dict[str, float] | None:
    if prediction is None:
        return None
    return {
        "torque_rms_nm": prediction.torque_rms_nm,
        "torque_relative": prediction.torque_relative,
        "share": prediction.share,
    }
