"""The sections of steps that few sessions have: tables of source and impedance, and repeated movements."""

from collections.abc import Sequence

from norton_bench.identification.at_ticks import TAUGHT_HZ
from norton_bench.identification.exertion_table import ExertionTable
from norton_bench.identification.impedance_along import ImpedanceAlong
from norton_bench.identification.in_situ import EXPLAINED, SourceMotion
from norton_bench.identification.modulation import modulated
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.table_conditions import two_ports
from norton_bench.identification.trials import TrialFigures, diverge, last_driven, settled
from norton_bench.report.facts_tables import (
    impedance_sentences,
    line_facts,
    modulation_sentences,
    modulator_facts,
    modulator_sentence,
    ports_facts,
    rendered_facts,
    rendered_sentence,
    source_facts,
    stiffness_facts,
)
from norton_bench.report.figures_tables import (
    exertion_figure,
    impedance_along_figure,
    shaken_figure,
    source_motion_figure,
    source_table_figure,
    trials_figure,
)
from norton_bench.report.svg import picture
from norton_bench.report.words import Facts, Picture, Section, number, pretty_unit
from norton_bench.result import Result


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
    sentences = (_ending(data.trials, "noise hides what is left", converged=settled(data.trials)),)
    table = _table(data.trials, "noise in it [mN·m]")
    return Section("trials", "Zero torque, trial by trial", sentences, (drawn,), (table,))


def rendered_section(data: Result) -> Section | None:
    """The laws that the load rendered."""
    if not data.rendered:
        return None
    sentences = (
        "The load acted a virtual body, M dv/dt + B v + K (x − x₀) = τ, while the actuator pushed. The law is measured "
        f"by the torque and the load's motion at the port, below {TAUGHT_HZ:g} Hz, with 95 % intervals.",
        "In brackets: what was asked for. Unexplained is what that leaves of the torque at the port, rms.",
        *(rendered_sentence(each) for each in data.rendered if each.shortcoming),
    )
    measured = [each for each in data.rendered if not each.shortcoming]
    tables = (rendered_facts(measured),) if measured else ()
    return Section("rendered", "Virtual bodies", sentences, tables=tables)


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
    if result.along is not None and result.along.linear:
        pictures.append(_along(result.along))
    ending = _ending(result.trials, EXPLAINED, converged=result.converged)
    assembly = (f"{sentence[0].upper()}{sentence[1:]}." for sentence in result.assembly)
    sentences = (*assembly, ending, *impedance_sentences(result))
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


def _along(along: ImpedanceAlong) -> Picture:
    return picture(
        impedance_along_figure(along),
        "in-situ-impedance",
        "See how stiff the actuator is at each instant of the movement.",
        "The spring and the damper with which the actuator answers when it is moved off its source, with 95 % "
        "intervals: by trials that were pushed off the path, each in another way.",
    )


def _ending(trials: Sequence[TrialFigures], floor: str, *, converged: bool) -> str:
    if converged:
        end = f"converged: {floor}"
    else:
        end = "did not converge" if diverge(trials) else "ended with more than that left"
    return (
        f"The movement was repeated {len(trials)} times and {end}. "
        f"The last trial lies at least {number(last_driven(trials).below_db(trials[0]), 3)} dB below the first."
    )


def _table(trials: Sequence[TrialFigures], floor: str) -> Facts:
    head = ("trial", "torque [mN·m]", floor, "may be hidden [mN·m]", "below the first [dB]")
    rows = tuple(
        (
            str(trial.number),
            number(1e3 * trial.with_noise_nm, 3),
            number(1e3 * trial.noise_nm, 3) if trial.noise_nm else "–",
            number(1e3 * trial.hidden_nm, 3),
            f"{number(trial.below_db(trials[0]), 3)}{' or more' if trial.at_floor else ''}" if trial.driven else "–",
        )
        for trial in trials
    )
    return Facts(head, rows)
