"""The sections that test the model: its errors, its residual, other friction models, and the same without a model."""

from collections.abc import Sequence
from math import isfinite
from typing import Protocol

import numpy as np

from norton_bench.identification.friction_laws import CONTAINS, EXCESS
from norton_bench.identification.residual_tests import SIGNIFICANCE, Dependence, Harmonic, Memory, ResidualTests
from norton_bench.identification.results import Cogging, SourceMap
from norton_bench.identification.without_model import Prediction, StopOperator, WithoutModel
from norton_bench.models.parameters import UNITS
from norton_bench.report.figures_fit import impedance_table_figure, operator_figure, residual_tests_figure
from norton_bench.report.figures_network import ImpedanceLoop, presliding_loops
from norton_bench.report.svg import picture
from norton_bench.report.words import Facts, Section, number, percent, pretty_unit, within
from norton_bench.result import Result

# Dependences below this share of the residual's variance are listed, but not explained.
EXPLAINED_FROM = 0.01
# The friction of the operator is described by one kind of yielding if that has this share of it.
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
    """Sentences from the measured branches: where the shaft rests, and whether the branches differ."""
    sentences = []
    for rising, name in ((True, "rising"), (False, "falling")):
        zone = source.dead_zone(rising)
        if zone is not None:
            low, high = (number(edge, 3) for edge in zone.width_interval)
            sentences.append(
                f"With the command {name}, the shaft rests over a range of {number(zone.width, 3)} {unit} "
                f"(95\u00a0% interval {low}\u00a0…\u00a0{high})."
            )
    if source.port_torque_nm.size:
        most = number(1e3 * float(np.max(np.abs(source.port_torque_nm))), 2)
        sentences.append(f"The velocities are corrected for the torque left at the port, up to {most}\u00a0mN·m.")
    hysteresis = source.hysteresis()
    if hysteresis is not None:
        size, band = number(abs(hysteresis.difference_rad_s), 2), number(hysteresis.band_rad_s, 2)
        command = number(hysteresis.command, 3)
        sentences.append(
            f"Rising and falling commands give velocities that differ by {size} rad/s at {command} "
            f"{unit}, more than the {band} rad/s that noise explains: hysteresis."
            if hysteresis.significant
            else f"Rising and falling commands give the same velocities to within noise ({band} rad/s): no hysteresis."
        )
    return sentences


def without_model_section(data: Result) -> Section | None:
    results = data.without_model
    if results is None or data.fit is None:
        return None
    network, figures = data.fit.network, []
    sentences = [
        "The same recording, evaluated without assuming that the actuator is a motor with this friction: a table of "
        "torque by velocity and command, and an operator that sums many elastic elements, each of which yields at a "
        "displacement of its own. Agreement supports the model's form; a difference shows what it lacks."
    ]
    if results.table is not None:
        figures.append(
            picture(
                impedance_table_figure(results.table, network, data.command_unit),
                "impedance-table",
                "Check the model's steady torque against plain averages of the readings.",
                "Mean torque while a velocity and a command were held (left), and measured minus model (right). "
                "Bars are 95 % intervals of the mean.",
            )
        )
        sentences += _table_sentences(results)
    if results.operator is not None:
        deflection_rad = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
        figures.append(
            picture(
                operator_figure(_loops(data, deflection_rad), results.operator, deflection_rad),
                "operator",
                "Check the friction law: does friction without a model yield where the model's does (τc/σ0)?",
                "Left: loops too small for friction to slide freely. Right: how much friction yields at which "
                "displacement.",
            )
        )
        sentences += _operator_sentences(results.operator, results.stops_alone, pretty_unit(data.command_unit) or "N·m")
    tables: tuple[Facts, ...] = ()
    if results.operator_prediction is not None:
        tables = (_predictions(data, results),)
        sentences.append("The table at the end compares how well each predicts the torque of motion kept apart.")
    return Section("without-model", "The same without a motor model", tuple(sentences), tuple(figures), tables)


def _loops(data: Result, deflection_rad: float) -> list[tuple[ImpedanceLoop, ImpedanceLoop]]:
    if data.measured is None or data.fit is None or data.without_model is None or data.without_model.fitted is None:
        return []
    network = presliding_loops(data.measured, data.fit.trace, deflection_rad)
    operator = presliding_loops(data.measured, data.without_model.fitted, deflection_rad)
    return list(zip(network, operator, strict=False))


def _table_sentences(results: WithoutModel) -> list[str]:
    table = results.table
    if table is None:
        return []
    rows, columns = table.torque_nm.shape
    sentences = [f"The table holds {rows} commands at {columns} velocities."]
    if table.empty:
        empty = "cell is" if table.empty == 1 else "cells are"
        sentences.append(f"{table.empty} {empty} empty: nothing was measured there, and nothing is interpolated.")
    if isfinite(table.left_out_rms_nm()):
        sentences.append(
            f"A cell differs by {number(1e3 * table.left_out_rms_nm(), 2)} mN·m rms from a line between its neighbours."
        )
    return sentences


def _operator_sentences(operator: StopOperator, stops_alone: Prediction | None, unit: str) -> list[str]:
    share = operator.abrupt_share
    sentences = [
        f"The operator finds a friction of {number(1e3 * operator.coulomb_torque_nm, 3)} mN·m and a torque of "
        f"{number(operator.torque_gain, 4)} N·m per {unit}."
    ]
    if share >= MOSTLY:
        sentences.append("Its friction yields all at once, like blocks that slide behind springs.")
    elif share <= 1 - MOSTLY:
        sentences.append("Its friction yields gradually, as Dahl friction does.")
    elif isfinite(share):
        sentences.append(f"{percent(share)} of its friction yields all at once, the rest gradually.")
    if stops_alone is not None and isfinite(stops_alone.torque_rms_nm):
        sentences.append(
            "With elements that yield only all at once (Prandtl-Ishlinskii) the rms error would be "
            f"{number(1e3 * stops_alone.torque_rms_nm, 3)} mN·m."
        )
    return sentences


def _predictions(data: Result, results: WithoutModel) -> Facts:
    """The errors of prediction of motion kept apart from the fits."""
    rows = []
    if data.validation is not None and isfinite(data.validation.torque_rms_nm):
        network = Prediction(data.validation.torque_rms_nm, data.validation.torque_relative, 1.0)
        rows.append(("model", "seven parameters", *_figures(network)))
    if results.operator_prediction is not None:
        rows.append(("operator", "history of the motion", *_figures(results.operator_prediction)))
    if results.table_prediction is not None:
        rows.append(("table", "steady motion only, no inertia", *_figures(results.table_prediction)))
    head = ("predicted by", "which knows", "rms error [mN·m]", "of the torque", "of the motion covered")
    return Facts(head, tuple(rows))


def _figures(prediction: Prediction) -> tuple[str, str, str]:
    return (
        number(1e3 * prediction.torque_rms_nm, 3),
        percent(prediction.torque_relative),
        percent(prediction.share) if prediction.share < 1 else "all",
    )


def residuals_section(data: Result) -> Section | None:
    tests = data.residuals
    if tests is None:
        return None
    unit = "N·m"
    if data.fit is not None and data.fit.ratios_only:
        unit = f"{pretty_unit(data.command_unit) or 'N·m'} of command"
    drawn = picture(
        residual_tests_figure(tests, unit),
        "residual-tests",
        "Find effects that the model lacks: points outside the shaded bands, or peaks by position.",
        "Correlation of the residual with itself and with each input, after the low-pass filter's own correlation was "
        "removed; and the residual's amplitude by periods a turn. Noise alone stays within the shaded bands 95 times "
        "in 100.",
    )
    sentences = tuple(residual_sentences(tests, unit, () if data.fit is None else data.fit.cogging))
    return Section("residuals", "What the residual contains", sentences, (drawn,))


def residual_sentences(tests: ResidualTests, unit: str = "N·m", known: Sequence[Cogging] = ()) -> list[str]:
    """The results of the tests, largest first, and their possible causes; ``known`` is what the network has of them."""
    fitted = {each.periods_per_turn: each for each in known}
    sentences = [_harmonic_sentence(each, unit, fitted.get(each.periods_per_turn)) for each in tests.harmonics]
    proven = [each for each in tests.dependences if each.p_value < SIGNIFICANCE / max(1, len(tests.dependences))]
    highest_hz = 0.0 if tests.memory is None else 0.5 / float(tests.memory.lags_s[0])
    greatest = sorted(proven, key=lambda each: -each.share)
    sentences += [_dependence_sentence(each, highest_hz, unit) for each in greatest if each.share >= EXPLAINED_FROM]
    small = [_ARTICLE.get(each.name, each.name) for each in proven if each.share < EXPLAINED_FROM]
    if small:
        sentences.append(
            f"It also follows {' and '.join(small)}, by less than {percent(EXPLAINED_FROM)} of its variance."
        )
    if not sentences:
        looked_at = [_ARTICLE.get(each.name, each.name) for each in tests.dependences]
        sentences.append(f"The residual follows none of {', '.join([*looked_at, 'position'])}.")
    if tests.memory is not None:
        sentences.append(_memory_sentence(tests.memory))
    return [sentences[0].replace("It ", "The residual ", 1), *sentences[1:]]


def _harmonic_sentence(harmonic: Harmonic, unit: str, fitted: Cogging | None) -> str:
    times = "once a turn" if harmonic.periods_per_turn == 1 else f"with {harmonic.periods_per_turn:g} periods a turn"
    what = "cogging" if harmonic.periods_per_turn > 2 else "an eccentric or bent part"
    if fitted is not None:
        return (
            f"What the parameters alone leave follows position {times}: the network has this {what}, "
            f"{within(1e3 * fitted.amplitude_nm, 1e3 * fitted.half_interval_nm)} m{unit}."
        )
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
        return f"Over {reach_ms} ms it is uncorrelated with itself (p = {number(memory.p_value, 2)}): it may be noise."
    chance = "p < 0.001" if memory.p_value < 1e-3 else f"p = {number(memory.p_value, 1)}"
    greatest = number(memory.greatest, 2)
    return (
        f"It is not white noise ({chance} over {reach_ms} ms; correlations up to {greatest}): the 95 % intervals of "
        "the parameters allow for that."
    )


# The assumption of each model whose torque depends on the path.
ASSUMES = {
    "dahl": "yields from the first motion on",
    "elasto-plastic": "is purely elastic up to breakaway, and then yields along one fixed curve",
    "lugre": f"yields from the first motion on, with stiction at least {100 * EXCESS.low:.0f} % above Coulomb friction",
    "maxwell-slip": "is a sum of elements that each yield all at once, without damping before sliding",
}


ERROR_DIGITS = 3  # of the errors in the comparison
WITHOUT_MEMORY = "depends on the velocity alone, not on the path"


# The comparison of friction models, and why one with more numbers may fit worse.
class Compared(Protocol):
    """One model of the comparison."""

    @property
    def name(self) -> str: ...

    @property
    def unknowns(self) -> int: ...

    @property
    def train_relative(self) -> float: ...


def friction_section(data: Result) -> Section | None:
    """How much of the torque each friction model leaves, on data that it was fitted to and on data that it was not."""
    if not data.ladder:
        return None
    best = next(rung for rung in data.ladder if rung.selected)
    sentences = (
        "Which friction law describes this actuator? Each model was fitted to most of the recording and judged on "
        "the rest, in turns, at low frequencies.",
        f"Selected is {best.name}: the model with the fewest numbers whose error on the parts not fitted is within "
        "one standard error of the smallest.",
        "Errors are rms, as a share of the torque's rms.",
    )
    head = ("model", "numbers", "error, fitted data [%]", "error, other data [%]", "standard error [%]", "remark")
    rows = tuple(
        (
            rung.name,
            str(rung.unknowns),
            number(100 * rung.train_relative, ERROR_DIGITS),
            number(100 * rung.held_out_relative, ERROR_DIGITS),
            number(100 * rung.held_out_std / rung.target_rms, ERROR_DIGITS),
            "selected" if rung.selected else "" if rung.fit.converged else "did not converge",
        )
        for rung in data.ladder
    )
    why, laws = worse_though_richer(best, data.ladder)
    return Section(
        "friction", "Comparison of friction models", (*sentences, *why), tables=(Facts(head, rows),), points=laws
    )


def worse_though_richer(best: Compared, models: Sequence[Compared]) -> tuple[list[str], tuple[str, ...]]:
    """Why models with more parameters than ``best`` fit worse, even the data that they were fitted to: every model
    whose error is shown as greater.

    Sentences, and a line for each of the friction laws that are others.
    """
    shown = _shown(best)
    richer = [each for each in models if each.unknowns > best.unknowns and _shown(each) > shown]
    others = [each.name for each in richer if best.name not in CONTAINS.get(each.name, ())]
    extensions = [each.name for each in richer if each.name not in others]
    sentences = []
    if others:
        one = len(others) == 1
        law, of = ("is another friction law", "an extension") if one else ("are other friction laws", "extensions")
        sentences.append(
            f"More numbers need not fit better, even on the data fitted: {_listed(others)} {law}, not {of} of "
            f"{best.name}, and cannot become {best.name} for any values."
        )
    if extensions:
        extend, come = ("extends", "comes") if len(extensions) == 1 else ("extend", "come")
        sentences.append(
            f"{_listed(extensions)} {extend} {best.name}, but {come} near to it only at the edge of what is searched, "
            "and every search ends within a tolerance. So the error on the fitted data can be a little greater."
        )
    laws = (f"{name} {ASSUMES.get(name.removesuffix('-asymmetric'), WITHOUT_MEMORY)}." for name in others)
    return sentences, tuple(laws)


def _shown(each: Compared) -> float:
    """Its error on the data fitted, to the digits of the table."""
    return float(f"{each.train_relative:.{ERROR_DIGITS}g}")


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def model_error_section(data: Result) -> Section | None:
    """The error of the network's predictions, and the range in which it was tested."""
    error = data.model_error
    if error is None:
        return None
    prediction = error.prediction
    seen = "; ".join(
        f"{name} {number(low, 3)} to {number(high, 3)} {pretty_unit(UNITS.get(name, data.command_unit))}"
        for name, (low, high) in prediction.ranges.items()
    )
    velocity = (
        f" and of the free velocity below {number(prediction.velocity_rad_s, 2)} rad/s"
        if np.isfinite(prediction.velocity_rad_s)
        else ""
    )
    sentences = [
        f"On parts of the recording that were kept apart from the fit, the model's own error is "
        f"{number(1e3 * error.rms_nm, 2)} mN·m rms; the noise of the readings ({number(1e3 * error.noise_nm, 2)} mN·m) "
        "is not counted.",
        f"In {percent(prediction.level)} of stretches of such motion the rms error of the torque is below "
        f"{number(1e3 * prediction.torque_nm, 2)} mN·m{velocity}.",
        f"This was tested for: {seen}. Outside this range nothing was tested.",
    ]
    if np.isfinite(error.zero.moved_nm):
        sentences.append(
            f"The fit finds the torque sensor's zero {number(1e3 * error.zero.moved_nm, 2)} mN·m from that of the tare."
        )
    if not error.departures and not error.unexplained:
        sentences.append("No effect was found that the model lacks.")
    return Section("model-error", "How accurate predictions are", tuple(sentences))
