"""The plan of a dry run, as JSON and for a terminal."""

from typing import Any

from rich.console import Group, RenderableType

from norton_bench.cli.output import plain_table
from norton_bench.rig.rig import Rig
from norton_bench.session.dry_run import DryRun, DryStep
from norton_bench.session.items import Session


def plan_data(plan: DryRun, session: Session, rig: Rig) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "session": session.place,
        "rig": rig.place,
        "parameters": dict(session.parameters),
        "steps": [_step(step) for step in plan.steps],
        "at_least_s": plan.at_least_s,
        "at_most_s": plan.at_most_s,
        "prompts": [
            {"name": prompt.name, "text": prompt.text, "choices": list(prompt.choices)} for prompt in plan.prompts
        ],
    }


def _step(step: DryStep) -> dict[str, Any]:
    peaks = step.peaks
    return {
        "do": step.planned.name,
        "label": step.planned.label,
        "certain": step.planned.certain,
        "begins_s": step.begins_s,
        "duration_s": step.planned.duration_s,
        "segments": step.segments,
        "peaks": {
            "command": peaks.command,
            "load_torque_nm": peaks.load_torque_nm,
            "velocity_rad_s": peaks.velocity_rad_s,
            "travel_rad": peaks.travel_rad,
        },
    }


def plan_view(plan: DryRun, session: Session, rig: Rig) -> RenderableType:
    """The same as a table, with the time in all."""
    table = plain_table()
    for heading in ("", "step", "begins", "takes"):
        table.add_column(heading, justify="left" if heading == "step" else "right", no_wrap=True)
    table.add_column("at most")
    for number, step in enumerate(plan.steps, 1):
        times = [clock(step.begins_s), clock(step.planned.duration_s)]
        table.add_row(str(number), step.planned.name, *times, _at_most(step, rig))
    return Group(table, _in_all(plan, session, rig))


def _at_most(step: DryStep, rig: Rig) -> str:
    peaks = step.peaks
    asked = (
        (peaks.command, f"{rig.command.unit} command"),
        (peaks.load_torque_nm, "N*m load"),
        (peaks.velocity_rad_s, "rad/s"),
        (peaks.travel_rad, "rad travel"),
    )
    words = [", ".join(f"{peak:.3g} {unit}" for peak, unit in asked if peak), step.planned.label]
    return "; ".join(filter(None, [*words, "" if step.planned.certain else "if its condition holds"]))


def _in_all(plan: DryRun, session: Session, rig: Rig) -> str:
    span = clock(plan.at_most_s)
    if plan.at_least_s < plan.at_most_s:
        span = f"between {clock(plan.at_least_s)} and {span}"
    asks = f", {len(plan.prompts)} prompts" if plan.prompts else ""
    return f"{session.place} suits {rig.place}: {_steps(plan)}, {span} of bench time{asks}. Nothing was opened."


def _steps(plan: DryRun) -> str:
    return "1 step" if len(plan.steps) == 1 else f"{len(plan.steps)} steps"


def clock(duration_s: float) -> str:
    """Minutes and seconds."""
    minutes, seconds = divmod(round(duration_s), 60)
    return f"{minutes}:{seconds:02d}"
