"""Tables of an actuator without a model, as JSON and for a terminal."""

from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from norton_bench.cli.output import plain_table
from norton_bench.identification.averages import Branch, Mean, Setting
from norton_bench.identification.branches import TAILS, DeadZone, Hysteresis
from norton_bench.identification.exertion_table import ExertionTable, Shaken
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.modulation import Modulated, ModulatorPlaces, modulated
from norton_bench.identification.residual_tests import ResidualTests
from norton_bench.identification.results import BlockedMap, SourceMap
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.table_conditions import two_ports
from norton_bench.identification.without_model import Prediction, StopOperator, WithoutModel
from norton_bench.report.facts_tables import modulation_sentences, modulator_sentence
from norton_bench.report.words import Facts
from norton_bench.result import Result
from norton_bench.session.summary import tabulated


def tables_data(result: Result) -> dict[str, Any]:
    """What ``--json`` prints; half-widths are those of 95 % intervals."""
    return {
        "source": None if result.source is None else _source(result.source),
        "exertion": None if result.exertion is None else _exertion(result.exertion),
        "two_ports": [
            {
                **_setting(row.setting),
                "external_rad": _mean(row.external),
                "actuator_rad": _mean(row.actuator),
                "apart_rad": row.apart_rad,
                "load_nm": _mean(row.load),
                "exertion_nm": _mean(row.exertion),
            }
            for row in two_ports(result.source, result.exertion)
        ],
        "modulation": _modulated(modulated(result.source, result.exertion)),
        "modulator": None if result.modulator is None else _modulator(result.modulator),
        "blocked": None if result.blocked_map is None else _blocked(result.blocked_map),
    }


def tables_view(result: Result) -> list[RenderableType]:
    """The same for a terminal, without single readings."""
    effect = modulated(result.source, result.exertion)
    sentences = () if effect is None else modulation_sentences(effect, result.units)
    stood = () if result.modulator is None else (modulator_sentence(result.modulator, result.units),)
    return [*(_table(facts) for facts in tabulated(result)), *sentences, *stood]


def _source(table: SourceTable) -> list[dict[str, Any]]:
    return [
        {
            "port": level.port,
            **_setting(level.setting),
            "rising": level.rising,
            "position_rad": _mean(level.position),
            "torque_nm": _mean(level.torque),
            "velocity_rad_s": level.velocity_rad_s,
            "settled": level.settled,
            "settling_s": level.settling_s,
        }
        for level in table.levels
    ]


def _exertion(table: ExertionTable) -> dict[str, Any]:
    return {
        "commands": [
            {
                **_setting(line.setting),
                "source_rad": _mean(line.source),
                "stiffness_nm_rad": _mean(line.stiffness),
                "hysteresis_nm": line.hysteresis_nm,
                "sliding_friction_nm": None if line.sweep is None else _mean(line.sweep.friction),
                "sweep_rad_s": None if line.sweep is None else line.sweep.speed_rad_s,
                "zero_range_rad": None if line.zeros is None else _mean(line.zeros.width),
            }
            for line in table.lines()
        ],
        "held": [
            {
                **_setting(held.setting),
                "displacement_rad": held.displacement_rad,
                "rising": held.rising,
                "torque_nm": _mean(held.torque),
            }
            for held in table.held
        ],
        "swept": [
            {
                **_setting(way.setting),
                "rising": way.rising,
                "speed_rad_s": way.speed_rad_s,
                **_columns(way.branch),
            }
            for way in table.swept
        ],
        "shaken": [_shaken(row) for row in table.shaken],
    }


def _shaken(row: Shaken) -> dict[str, Any]:
    return {
        **_setting(row.setting),
        "displacement_rad": row.displacement_rad,
        "frequency_hz": row.frequency_hz,
        "real_nm_rad": row.stiffness_nm_rad.real,
        "imaginary_nm_rad": row.stiffness_nm_rad.imag,
        "half_width_nm_rad": row.half_width_nm_rad,
    }


def _modulated(effect: Modulated | None) -> dict[str, Any] | None:
    if effect is None:
        return None
    shift = effect.shift
    return {
        "stiffness": [
            {"modulation": row.modulation, "stiffness_nm_rad": _mean(row.stiffness)} for row in effect.stiffness
        ],
        "stiffens": effect.stiffens,
        "source_shift": None
        if shift is None
        else {"command": shift.command, "low": shift.low, "high": shift.high, "shift_rad": _mean(shift.shift)},
        "source_shifts": None if shift is None else shift.shows,
    }


def _modulator(places: ModulatorPlaces) -> dict[str, Any]:
    return {
        "followed": places.followed,
        "same_rad": places.same_rad,
        "stood": [{"modulation": each.modulation, "places_rad": list(each.places_rad)} for each in places.stood],
    }


def _blocked(blocked: BlockedMap) -> list[dict[str, Any]]:
    histories = blocked.histories or ("slow",) * len(blocked.command)
    columns = (blocked.command, blocked.torque_nm, blocked.torque_std_nm, blocked.from_above, histories)
    return [
        {
            "command": float(command),
            "torque_nm": float(torque),
            "torque_std_nm": float(std),
            "from_above": None if history == "rest" else bool(above),
            "history": history,
        }
        for command, torque, std, above, history in zip(*columns, strict=True)
    ]


def _columns(branch: Branch) -> dict[str, list[float]]:
    names = ("displacement_rad", "torque_nm", "half_width_nm")
    return {name: column.tolist() for name, column in zip(names, branch, strict=True)}


def _setting(setting: Setting) -> dict[str, float | None]:
    return {"command": setting.command, "modulation": setting.modulation}


def _mean(mean: Mean) -> dict[str, float]:
    return {"value": mean.value, "half_width": mean.half_width}


def _table(facts: Facts) -> Table:
    table = plain_table()
    for place, heading in enumerate(facts.head):
        table.add_column(heading, justify="left" if place == 0 else "right")
    for row in facts.rows:
        table.add_row(*row)
    return table


def model_free(source: SourceMap | None, without_model: WithoutModel | None) -> dict[str, Any] | None:
    """The results without a model, and the tests of the residual, as ``--json`` prints them.

    None where nothing was measured for them.
    """
    if source is None and without_model is None:
        return None
    known = without_model if without_model is not None else WithoutModel(None, None)
    return {
        "source": None if source is None else _source_data(source),
        "table": None if known.table is None else _table_data(known.table),
        "operator": None if known.operator is None else _operator(known.operator),
        "predicted": {
            "operator": _prediction(known.operator_prediction),
            "stops_alone": _prediction(known.stops_alone),
            "table": _prediction(known.table_prediction),
        },
    }


def residual_figures(tests: ResidualTests | None) -> dict[str, Any] | None:
    """The tests of the residual; None where too little was fitted."""
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


def _source_data(source: SourceMap) -> dict[str, Any]:
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


def _hysteresis(hysteresis: Hysteresis | None) -> dict[str, Any] | None:
    if hysteresis is None:
        return None
    return {
        "command": hysteresis.command,
        "difference_rad_s": hysteresis.difference_rad_s,
        "chance_rad_s": hysteresis.band_rad_s,
        "significant": hysteresis.significant,
    }


def _table_data(table: ImpedanceTable) -> dict[str, Any]:
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
