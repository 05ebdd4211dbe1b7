"""The sections that lean on no parametric model, and the one that asks the residual what the model lacks."""

from math import isfinite

import numpy as np

from norton_bench.identification.model_free.stop_operator import StopOperator
from norton_bench.identification.model_free.without_model import Prediction, WithoutModel
from norton_bench.identification.residuals.dependence import SIGNIFICANCE, Dependence
from norton_bench.identification.residuals.diagnosis import ResidualTests
from norton_bench.identification.residuals.position_lines import Harmonic
from norton_bench.identification.residuals.whiteness import Memory
from norton_bench.identification.results import SourceMap
from norton_bench.report.data import ReportData
from norton_bench.report.figures_residuals import residual_tests_figure
from norton_bench.report.figures_without_model import impedance_table_figure, operator_figure
from norton_bench.report.loops import Loop, presliding_loops
from norton_bench.report.section import Facts, Section
from norton_bench.report.svg import svg
from norton_bench.report.words import number, percent, pretty_unit

# Dependences smaller than this share of the residual's variance are told, but not explained.
WORTH_A_WORD = 0.01
# The operator's friction is said to yield one way where that way has this share of it.
MOSTLY = 0.8
# Of the highest frequency that the tests see: beyond this, noise that differentiation amplifies prevails.
BAND_EDGE = 0.8
_MEANING = {
    "command": "the forward path is not quite a first-order lag, or its delay wanders",
    "velocity": "damping that is not quite viscous",
    "acceleration": "inertia or a resonance",
    "direction": "friction of another shape than the one assumed, or different in the two directions",
}
_ARTICLE = {
    "command": "the command",
    "velocity": "velocity",
    "acceleration": "acceleration",
    "direction": "the direction",
}


def source_sentences(source: SourceMap, unit: str) -> list[str]:
    """What the measured branches say on their own: where the shaft rests, and whether they differ."""
    sentences = []
    for rising, name in ((True, "rising"), (False, "falling")):
        zone = source.dead_zone(rising)
        if zone is not None:
            low, high = (number(edge, 3) for edge in zone.width_interval)
            sentences.append(
                f"Measured with the command {name}, the dead zone is {number(zone.width, 3)} {unit} wide "
                f"(95\u00a0%: {low}\u00a0…\u00a0{high})."
            )
    if source.port_torque_nm.size:
        most = number(1e3 * float(np.max(np.abs(source.port_torque_nm))), 2)
        sentences.append(
            f"Velocities are those without torque at the port: up to {most}\u00a0mN·m of it, as read while a level was "
            "held, have been taken off by the measured slope."
        )
    found = source.hysteresis()
    if found is not None:
        size, band = number(abs(found.difference_rad_s), 2), number(found.band_rad_s, 2)
        sentences.append(
            f"The branches differ by {size} rad/s at {number(found.command, 3)} {unit}; chance gives {band}."
            if found.significant
            else f"The two branches are one to within what chance gives ({band} rad/s): no hysteresis shows."
        )
    return sentences


def without_model_section(data: ReportData) -> Section | None:
    found = data.without_model
    if found is None or data.fit is None:
        return None
    network, figures = data.fit.network, []
    sentences = ["The same recording without assuming a motor."]
    if found.table is not None:
        caption = (
            "Mean torque while a velocity and a command were held, and what the identified network leaves of it. "
            "Bars are 95 % intervals of the mean."
        )
        picture = svg(impedance_table_figure(found.table, network, data.command_unit), "impedance-table", caption)
        figures.append((picture, caption))
        sentences += _table_sentences(found)
    if found.operator is not None:
        caption = (
            "Left: loops too small for friction to slide freely. Right: the operator's elements, each a spring that "
            "yields at its own displacement; no friction law was assumed, only that none pushes."
        )
        deflection_rad = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
        picture = svg(
            operator_figure(_loops(data, deflection_rad), found.operator, deflection_rad), "operator", caption
        )
        figures.append((picture, caption))
        sentences += _operator_sentences(found.operator, found.stops_alone, pretty_unit(data.command_unit) or "N·m")
    tables: tuple[Facts, ...] = ()
    if found.operator_prediction is not None:
        tables = (_predictions(data, found),)
        sentences.append("At the end stands how well each way predicts the torque of motion that no fit has looked at.")
    return Section("without-model", "Without a model", tuple(sentences), tuple(figures), tables)


def _loops(data: ReportData, deflection_rad: float) -> list[tuple[Loop, Loop]]:
    if data.measured is None or data.fit is None or data.without_model is None or data.without_model.fitted is None:
        return []
    network = presliding_loops(data.measured, data.fit.trace, deflection_rad)
    operator = presliding_loops(data.measured, data.without_model.fitted, deflection_rad)
    return list(zip(network, operator, strict=False))


def _table_sentences(found: WithoutModel) -> list[str]:
    table = found.table
    if table is None:
        return []
    rows, columns = table.torque_nm.shape
    sentences = [f"The table holds {rows} commands at {columns} velocities."]
    if table.empty:
        empty = "cell is" if table.empty == 1 else "cells are"
        sentences.append(f"{table.empty} {empty} empty: nothing was measured there, and nothing is made up.")
    if isfinite(table.left_out_rms_nm()):
        sentences.append(
            f"A cell lies {number(1e3 * table.left_out_rms_nm(), 2)} mN·m (rms) off the line between its neighbours."
        )
    return sentences


def _operator_sentences(operator: StopOperator, stops_alone: Prediction | None, unit: str) -> list[str]:
    share = operator.abrupt_share
    sentences = [
        f"The operator's friction holds {number(1e3 * operator.coulomb_torque_nm, 3)} mN·m in all; its command gives "
        f"{number(operator.torque_gain, 4)} N·m per {unit}."
    ]
    if share >= MOSTLY:
        sentences.append("Its friction yields all at once, like sliders behind springs.")
    elif share <= 1 - MOSTLY:
        sentences.append("Its friction yields gradually: the deflected contact gives way before it slides.")
    elif isfinite(share):
        sentences.append(f"{percent(share)} of its friction yields all at once, the rest gradually.")
    if stops_alone is not None and isfinite(stops_alone.torque_rms_nm):
        sentences.append(
            f"Ideal stops alone (Prandtl-Ishlinskii) would be {number(1e3 * stops_alone.torque_rms_nm, 3)} mN·m off."
        )
    return sentences


def _predictions(data: ReportData, found: WithoutModel) -> Facts:
    """Who predicts what no fit has looked at, and how well."""
    rows = []
    if data.validation is not None and isfinite(data.validation.torque_rms_nm):
        network = Prediction(data.validation.torque_rms_nm, data.validation.torque_relative, 1.0)
        rows.append(("network", "seven parameters", *_figures(network)))
    if found.operator_prediction is not None:
        rows.append(("operator", "history of the motion", *_figures(found.operator_prediction)))
    if found.table_prediction is not None:
        rows.append(("table", "steady motion only: no inertia, no memory", *_figures(found.table_prediction)))
    return Facts(("predicted by", "which knows", "rms off [mN·m]", "of the torque", "covered"), tuple(rows))


def _figures(prediction: Prediction) -> tuple[str, str, str]:
    return (
        number(1e3 * prediction.torque_rms_nm, 3),
        percent(prediction.torque_relative),
        percent(prediction.share) if prediction.share < 1 else "all",
    )


def residuals_section(data: ReportData) -> Section | None:
    tests = data.residuals
    if tests is None:
        return None
    caption = (
        "What the network, with its parameters alone, leaves of the torque: within the band, freed of the band's own "
        "colour; and its amplitude by periods a turn of the shaft. Shaded is where chance keeps correlations 95 times "
        "in 100."
    )
    unit = "N·m"
    if data.fit is not None and data.fit.ratios_only:
        unit = f"{pretty_unit(data.command_unit) or 'N·m'} of command"
    picture = svg(residual_tests_figure(tests, unit), "residual-tests", caption)
    sentences = tuple(residual_sentences(tests, unit))
    return Section("residuals", "What the residual tells", sentences, ((picture, caption),))


def residual_sentences(tests: ResidualTests, unit: str = "N·m") -> list[str]:
    """What the tests found, largest first, and what it may mean."""
    sentences = [_harmonic_sentence(each, unit) for each in tests.harmonics]
    proven = [each for each in tests.dependences if each.p_value < SIGNIFICANCE / max(1, len(tests.dependences))]
    highest_hz = 0.0 if tests.memory is None else 0.5 / float(tests.memory.lags_s[0])
    greatest = sorted(proven, key=lambda each: -each.share)
    sentences += [_dependence_sentence(each, highest_hz, unit) for each in greatest if each.share >= WORTH_A_WORD]
    small = [_ARTICLE.get(each.name, each.name) for each in proven if each.share < WORTH_A_WORD]
    if small:
        sentences.append(
            f"It also follows {' and '.join(small)}, by less than {percent(WORTH_A_WORD)} of its variance."
        )
    if not sentences:
        looked_at = [_ARTICLE.get(each.name, each.name) for each in tests.dependences]
        sentences.append(f"The residual follows none of {', '.join([*looked_at, 'position'])}.")
    if tests.memory is not None:
        sentences.append(_memory_sentence(tests.memory))
    return [sentences[0].replace("It ", "The residual ", 1), *sentences[1:]]


def _harmonic_sentence(harmonic: Harmonic, unit: str) -> str:
    times = "once a turn" if harmonic.periods_per_turn == 1 else f"with {harmonic.periods_per_turn:g} periods a turn"
    what = "cogging" if harmonic.periods_per_turn > 2 else "an eccentric or bent part"
    return f"The residual follows position {times}: {what} of {number(1e3 * harmonic.amplitude_nm, 2)} m{unit}."


def _dependence_sentence(each: Dependence, highest_hz: float, unit: str) -> str:
    meaning = _MEANING.get(each.name, "something the model lacks")
    if each.name == "acceleration" and each.peak_hz > 0:
        at = f"{number(each.peak_hz, 2)} Hz"
        meaning = (
            f"at the upper edge of the band ({at}), so the encoder's own noise, or a resonance beyond"
            if each.peak_hz > BAND_EDGE * highest_hz
            else f"{meaning} near {at}"
        )
    return (
        f"It follows {_ARTICLE.get(each.name, each.name)} ({number(1e3 * each.rms_nm, 2)} m{unit} rms, "
        f"{percent(each.share)} of its variance): {meaning}."
    )


def _memory_sentence(memory: Memory) -> str:
    reach_ms = number(1e3 * float(memory.lags_s[-1]), 2)
    if memory.p_value >= SIGNIFICANCE:
        return f"It remembers nothing of itself over {reach_ms} ms (p = {number(memory.p_value, 2)}): it may be noise."
    chance = "p < 0.001" if memory.p_value < 1e-3 else f"p = {number(memory.p_value, 1)}"
    greatest = number(memory.greatest, 2)
    return (
        f"It is not white ({chance} over {reach_ms} ms; correlations up to {greatest}): the deviations in the table "
        "above allow for that."
    )
