"""The report's sections on repeated movements."""

from collections.abc import Sequence

from norton_bench.identification.in_situ import SourceMotion
from norton_bench.identification.trials import TAUGHT_HZ, TrialFigures, diverge, last_driven, settled
from norton_bench.report.data import ReportData
from norton_bench.report.figures_trials import source_motion_figure, trials_figure
from norton_bench.report.section import Facts, Picture, Section
from norton_bench.report.svg import picture
from norton_bench.report.words import number, pretty_unit


def trials_section(data: ReportData) -> Section | None:
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


def in_situ_section(data: ReportData) -> Section | None:
    """The actuator in situ: what it exerted, trial by trial, and its motion source."""
    found = data.in_situ
    if found is None or not found.trials:
        return None
    pictures = [
        picture(
            trials_figure(found.trials),
            "in-situ",
            "See whether the actuator was brought to exert nothing on its load, without a torque sensor.",
            f"Torque on the load below {TAUGHT_HZ:g} Hz, calculated from motion and load, in N·m as the load drive "
            "counts them. Where it is large the load drive was left off.",
        )
    ]
    if found.source is not None:
        pictures.append(_source(found.source, pretty_unit(data.command_unit)))
    ending = _ending(found.trials, "what is left is what movements differ by anyway")
    sentences = (*(f"{said[0].upper()}{said[1:]}." for said in found.assembly), ending)
    return Section(
        "in-situ",
        "The motion source of an assembled actuator (in situ)",
        sentences,
        tuple(pictures),
        (_table(found.trials, "movements differ by [mN·m]"),),
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
