"""The report's section on a repeated movement."""

from bench.identification.trials import TAUGHT_HZ, diverge, settled
from bench.report.data import ReportData
from bench.report.figures_trials import trials_figure
from bench.report.section import Facts, Section
from bench.report.svg import svg
from bench.report.words import number


def trials_section(data: ReportData) -> Section | None:
    """Zero torque, trial by trial."""
    if not data.trials:
        return None
    first, last = data.trials[0], data.trials[-1]
    caption = f"Torque at the port below {TAUGHT_HZ:g} Hz, trial by trial; in the first the load was not driven."
    if settled(data.trials):
        end = "converged: noise hides what is left"
    else:
        end = "did not converge" if diverge(data.trials) else "ended with more than noise left"
    sentences = (
        f"The movement was repeated {len(data.trials)} times and {end}. "
        f"The last trial lies at least {number(last.below_db(first), 3)} dB below the first.",
    )
    head = ("trial", "torque [mN·m]", "noise in it [mN·m]", "below the first [dB]")
    rows = tuple(
        (
            str(trial.number),
            number(1e3 * trial.with_noise_nm, 3),
            number(1e3 * trial.noise_nm, 3),
            "–" if trial is first else f"{number(trial.below_db(first), 3)}{' or more' if trial.at_floor else ''}",
        )
        for trial in data.trials
    )
    picture = svg(trials_figure(data.trials), "trials", caption)
    return Section("trials", "Zero torque, trial by trial", sentences, ((picture, caption),), (Facts(head, rows),))
