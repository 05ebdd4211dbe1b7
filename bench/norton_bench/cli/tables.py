"""Results of steps that few sessions have, as JSON and for a terminal: tables, repeated movements, a refinement."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from norton_bench.cli.output import plain_table
from norton_bench.identification.averages import Branch, Mean, Setting
from norton_bench.identification.exertion_table import ExertionTable, Shaken
from norton_bench.identification.impedance_along import ImpedanceAlong
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.modulation import Modulated, ModulatorPlaces, modulated
from norton_bench.identification.path_impedance import PathImpedance
from norton_bench.identification.rendered import Rendered
from norton_bench.identification.results import FitResult
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.table_conditions import two_ports
from norton_bench.identification.trials import TrialFigures, last_driven, settled
from norton_bench.procedures.refinement import Refinement, in_percent, widest_of, words
from norton_bench.report.facts_tables import modulation_sentences, modulator_sentence, tabulated
from norton_bench.report.words import Facts
from norton_bench.result import Result


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
    }


def tables_view(result: Result) -> list[RenderableType]:
    """The same for a terminal, without single readings."""
    effect = modulated(result.source, result.exertion)
    sentences = () if effect is None else modulation_sentences(effect, result.units)
    stood = () if result.modulator is None else (modulator_sentence(result.modulator, result.units),)
    return [*(facts_table(facts) for facts in tabulated(result)), *sentences, *stood]


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


def _columns(branch: Branch) -> dict[str, list[float]]:
    names = ("displacement_rad", "torque_nm", "half_width_nm")
    return {name: column.tolist() for name, column in zip(names, branch, strict=True)}


def _setting(setting: Setting) -> dict[str, float | None]:
    return {"command": setting.command, "modulation": setting.modulation}


def _mean(mean: Mean) -> dict[str, float]:
    return {"value": mean.value, "half_width": mean.half_width}


def facts_table(facts: Facts) -> Table:
    """For a terminal: the first column left, numbers right."""
    table = plain_table()
    for place, heading in enumerate(facts.head):
        table.add_column(heading, justify="left" if place == 0 else "right")
    for row in facts.rows:
        table.add_row(*row)
    return table


def trials_figures(trials: Sequence[TrialFigures]) -> dict[str, Any]:
    """A repeated movement, trial by trial."""
    return {
        "converged": settled(trials),
        "below_first_db": last_driven(trials).below_db(trials[0]),
        "torque_nm": [trial.torque_nm for trial in trials],
        "with_noise_nm": [trial.with_noise_nm for trial in trials],
        "noise_nm": [trial.noise_nm for trial in trials],
        "hidden_nm": [trial.hidden_nm for trial in trials],
    }


def rendered_figures(result: Rendered) -> dict[str, Any]:
    """A law that the load rendered: as asked for, as measured, and what of the port's torque neither explains."""
    names = ("mass_kgm2", "damping_nms_rad", "stiffness_nm_rad")
    return {
        "asked": {**dict(zip(names, result.asked.values, strict=True)), "wall_rad": result.asked.wall_rad},
        "measured": dict(zip(names, result.measured, strict=True)),
        "half_interval": dict(zip(names, result.half, strict=True)),
        "torque_nm": result.torque_nm,
        "off_nm": result.off_nm,
        "left_nm": result.left_nm,
        "shortcoming": result.shortcoming,
    }


def in_situ_figures(result: InSituResult, source: Path | None) -> dict[str, Any] | None:
    """The actuator in situ: its trials, and where its motion source lies."""
    if not result.trials:
        return None
    scatter = None if result.source is None else result.source.scatter_rad_s
    return {
        **trials_figures(result.trials),
        "converged": result.converged,
        "driven": [trial.driven for trial in result.trials],
        "assembly": list(result.assembly),
        "reasons": list(result.reasons),
        "source": source,
        "source_scatter_rad_s": scatter,
        "impedance": None if result.impedance is None else _impedance(result.impedance),
        "impedance_along": None if result.along is None else _impedance_along(result.along),
    }


def _impedance(about: PathImpedance) -> dict[str, Any]:
    names = ("inertia_kgm2", "damping_nms_rad", "stiffness_nm_rad")
    return {
        **dict(zip(names, about.values, strict=True)),
        "half_interval": dict(zip(names, about.half, strict=True)),
        "explained": about.explained,
        "linear": about.linear,
    }


def _impedance_along(along: ImpedanceAlong) -> dict[str, Any]:
    values = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in asdict(along).items()}
    return {**values, "linear": along.linear}


def until_figures(refined: Refinement, fit: FitResult, bench_time_s: float) -> dict[str, Any]:
    """The results of ``--until`` as ``--json`` prints them; whether the target was reached is judged by the final
    fit."""
    widest = widest_of(fit.estimates)
    return {
        "asked": refined.target,
        "reached": refined.reached and widest is not None and widest[1] <= refined.target,
        "rounds": refined.rounds,
        "bench_time_s": bench_time_s,
        "widest": None if widest is None else {"parameter": widest[0], "half_width": widest[1]},
        "reasons": list(refined.sentences),
    }


def until_sentences(until: Mapping[str, Any]) -> str:
    """The same in words."""
    rounds = f"{until['rounds']} round{'' if until['rounds'] == 1 else 's'}"
    verb = "Reached" if until["reached"] else "Did not reach"
    head = f"{verb} {in_percent(until['asked'])} after {rounds}, {until['bench_time_s']:.0f} s of bench time"
    widest = until["widest"]
    if widest is not None:
        head += f"; the widest interval is that of {words(widest['parameter'])}, {in_percent(widest['half_width'])}"
    return " ".join([f"{head}.", *until["reasons"]])
