"""The sections of tables (an actuator without a model), of repeated movements, and of friction models compared."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from norton_bench.identification.exertion_table import ExertionTable
from norton_bench.identification.friction_fit import ROUGHNESS
from norton_bench.identification.friction_laws import CONTAINS, EXCESS
from norton_bench.identification.in_situ import SourceMotion
from norton_bench.identification.modulation import modulated
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.table_conditions import two_ports
from norton_bench.identification.trials import TAUGHT_HZ, TrialFigures, diverge, last_driven, settled
from norton_bench.models.parameters import UNITS
from norton_bench.report.facts_tables import (
    line_facts,
    modulation_sentences,
    modulator_facts,
    modulator_sentence,
    ports_facts,
    source_facts,
    stiffness_facts,
)
from norton_bench.report.figures_network import source_motion_figure, trials_figure
from norton_bench.report.figures_tables import exertion_figure, shaken_figure, source_table_figure
from norton_bench.report.svg import picture
from norton_bench.report.words import Facts, Picture, Section, number, percent, pretty_unit
from norton_bench.result import Result

# The assumption of each model whose torque depends on the path.
ASSUMES = {
    "dahl": "yields from the first motion on",
    "elasto-plastic": "is purely elastic up to breakaway, and then yields along one fixed curve",
    "lugre": f"yields from the first motion on, with stiction at least {100 * EXCESS.low:.0f} % above Coulomb friction",
    "maxwell-slip": "is a sum of elements that each yield all at once, without damping before sliding",
}
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
            number(100 * rung.train_relative, 3),
            number(100 * rung.held_out_relative, 3),
            number(100 * rung.held_out_std / rung.target_rms, 3),
            "selected" if rung.selected else "" if rung.fit.converged else "did not converge",
        )
        for rung in data.ladder
    )
    why, laws = worse_though_richer(best, data.ladder)
    return Section(
        "friction", "Comparison of friction models", (*sentences, *why), tables=(Facts(head, rows),), points=laws
    )


def worse_though_richer(best: Compared, models: Sequence[Compared]) -> tuple[list[str], tuple[str, ...]]:
    """Why models with more parameters than ``best`` fit worse, even the data that they were fitted to.

    Sentences, and a line for each of the friction laws that are others.
    """
    tolerance = best.train_relative * (1 + ROUGHNESS)
    richer = [each for each in models if each.unknowns > best.unknowns and each.train_relative > tolerance]
    others = [each.name for each in richer if best.name not in CONTAINS.get(each.name, ())]
    sentences = []
    if others:
        one = len(others) == 1
        law, of = ("is another friction law", "an extension") if one else ("are other friction laws", "extensions")
        sentences.append(
            f"More numbers need not fit better, even on the data fitted: {_listed(others)} {law}, not {of} of "
            f"{best.name}, and cannot become {best.name} for any values."
        )
    laws = (f"{name} {ASSUMES.get(name.removesuffix('-asymmetric'), WITHOUT_MEMORY)}." for name in others)
    return sentences, tuple(laws)


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


def tabulated_source_section(data: Result) -> Section | None:
    """The sections of what was tabulated: source, exertion, and the two ports beside each other."""
    if data.source is None:
        return None
    drawn = picture(
        source_table_figure(data.source, data.units),
        "tabulated-source",
        "Read off where the shaft comes to rest under a command.",
        "Position at rest with no torque at the port, under each command, reached from both sides. Bars are 95 % "
        "intervals of the mean. In the table the number after ± is half of the 95 % interval; half of the gap between "
        "the two sides is counted in it.",
    )
    sentences = (*_unsettled(data.source), _settling(data.source))
    return Section(
        "tabulated-source",
        "The motion source, tabulated",
        sentences,
        (drawn,),
        (source_facts(data.source, data.units),),
    )


def _unsettled(table: SourceTable) -> list[str]:
    moving = [level for level in table.levels if not level.settled]
    if not moving:
        return ["Under every command the shaft was at rest before it was read."]
    fastest = max(abs(level.velocity_rad_s) for level in moving)
    return [
        f"At {len(moving)} of {len(table.levels)} commands the shaft still moved while it was read, at up to "
        f"{number(fastest, 2)} rad/s: these are no rest positions. Wait longer (at_most), or measure the source as a "
        "velocity with the step 'free'."
    ]


def _settling(table: SourceTable) -> str:
    longest = max(level.settling_s for level in table.levels)
    return f"The slowest took {number(longest, 2)} s to come within 2\u00a0% of its final position."


def exertion_section(data: Result) -> Section | None:
    table = data.exertion
    if table is None:
        return None
    figures = [
        picture(
            exertion_figure(table, data.units),
            "exertion",
            "Read off the torque that the actuator exerts when it is held away from where it would rest.",
            "Torque at the port against position. Triangles point the way in which the position was reached; "
            "bars are 95 % intervals of the mean. Lines without marks are slow sweeps.",
        )
    ]
    if table.shaken:
        figures.append(
            picture(
                shaken_figure(table, data.units),
                "shaken",
                "Read off stiffness, inertia and damping by frequency.",
                "Response of the port to small vibrations about its rest position: stiffness and inertia left, damping "
                "right.",
            )
        )
    return Section(
        "exertion", "The impedance, tabulated", _swept(table), tuple(figures), (line_facts(table, data.units),)
    )


def _swept(table: ExertionTable) -> tuple[str, ...]:
    """Sentences from its sweeps."""
    speeds = [each.speed_rad_s for each in table.swept]
    if not speeds:
        return ()
    return (
        f"Friction is half of the difference between the two directions of a sweep at {number(max(speeds), 2)} rad/s; "
        "the range without torque is read from the sweeps, too.",
    )


def two_ports_section(data: Result) -> Section | None:
    rows = two_ports(data.source, data.exertion)
    if not rows:
        return None
    sentence = (
        "The actuator has one rest position with nothing at its own shaft, and another with a load on it and nothing "
        "at the load's far side. At the second one the torque sensor reads what the load asks for; the table of the "
        "impedance says what the actuator exerts there. The two should agree."
    )
    return Section("two-ports", "Actuator and load: two ports", (sentence,), tables=(ports_facts(rows, data.units),))


def modulation_section(data: Result) -> Section | None:
    effect = modulated(data.source, data.exertion)
    if effect is None and data.modulator is None:
        return None
    sentences: tuple[str, ...] = ()
    tables: tuple[Facts, ...] = ()
    if effect is not None:
        sentences = modulation_sentences(effect, data.units)
        tables = (stiffness_facts(effect, data.units),) if effect.stiffness else ()
    if data.modulator is not None:
        sentences = (*sentences, modulator_sentence(data.modulator, data.units))
        tables = (*tables, modulator_facts(data.modulator, data.units))
    return Section("modulation", "What the modulation changes", sentences, tables=tables)


# The report's sections on repeated movements.
def trials_section(data: Result) -> Section | None:
    """Zero torque, trial by trial."""
    if not data.trials:
        return None
    drawn = picture(
        trials_figure(data.trials),
        "trials",
        "See whether the bench learned to leave the shaft without torque.",
        f"Torque at the port below {TAUGHT_HZ:g} Hz, trial by trial; in the first the load was not driven.",
    )
    sentences = (_ending(data.trials, "noise hides what is left"),)
    table = _table(data.trials, "noise in it [mN·m]")
    return Section("trials", "Zero torque, trial by trial", sentences, (drawn,), (table,))


def in_situ_section(data: Result) -> Section | None:
    """The actuator in situ: its torque, trial by trial, and its motion source."""
    result = data.in_situ
    if result is None or not result.trials:
        return None
    pictures = [
        picture(
            trials_figure(result.trials),
            "in-situ",
            "See whether the torque of the actuator on its load became small, without a torque sensor.",
            f"Torque on the load below {TAUGHT_HZ:g} Hz, calculated from motion and load, in N·m as the load drive "
            "counts them. In the trials with a large torque the load was not driven.",
        )
    ]
    if result.source is not None:
        pictures.append(_source(result.source, pretty_unit(data.command_unit)))
    ending = _ending(result.trials, "what is left is no more than the scatter of movements")
    sentences = (*(f"{sentence[0].upper()}{sentence[1:]}." for sentence in result.assembly), ending)
    return Section(
        "in-situ",
        "The motion source of an assembled actuator (in situ)",
        sentences,
        tuple(pictures),
        (_table(result.trials, "scatter of movements [mN·m]"),),
    )


def _source(source: SourceMotion, unit: str) -> Picture:
    return picture(
        source_motion_figure(source, unit),
        "in-situ-source",
        "Read off the motion that this command asks for when the load takes no torque.",
        f"Velocity while the actuator exerted nothing. Trials differ by {number(source.scatter_rad_s, 2)} rad/s rms.",
    )


def _ending(trials: Sequence[TrialFigures], floor: str) -> str:
    if settled(trials):
        end = f"converged: {floor}"
    else:
        end = "did not converge" if diverge(trials) else "ended with more than that left"
    return (
        f"The movement was repeated {len(trials)} times and {end}. "
        f"The last trial lies at least {number(last_driven(trials).below_db(trials[0]), 3)} dB below the first."
    )


def _table(trials: Sequence[TrialFigures], floor: str) -> Facts:
    head = ("trial", "torque [mN·m]", floor, "below the first [dB]")
    rows = tuple(
        (
            str(trial.number),
            number(1e3 * trial.with_noise_nm, 3),
            number(1e3 * trial.noise_nm, 3),
            f"{number(trial.below_db(trials[0]), 3)}{' or more' if trial.at_floor else ''}" if trial.driven else "–",
        )
        for trial in trials
    )
    return Facts(head, rows)
