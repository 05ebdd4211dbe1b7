"""The steps of the session, done and ahead."""

from norton_bench.screen.picture.steps import Steps, StepState
from norton_bench.screen.tones import BAD, GOOD, GRID, LABEL, STRONG, TEXT, Row, apart, heading

SIGNS = {
    "ahead": ("·", LABEL),
    "running": ("▶", STRONG),
    "done": ("✓", GOOD),
    "left out": ("–", LABEL),
    "stopped": ("✗", BAD),
}
BAR = 10


def step_rows(steps: Steps, width: int, height: int) -> list[Row]:
    """One row a step; where there is no room for all, those about the running one."""
    left = f"{clock(steps.left_s)} left" if steps.all and steps.left_s >= 1 else ""
    rows = [heading("Steps", "", left, width)]
    if not steps.all:
        return [*rows, [("no steps yet", LABEL)]]
    room = max(height - 1, 1)
    first = max(0, min(steps.number - 1 - room // 2, len(steps.all) - room))
    return [*rows, *(_row(step, width) for step in steps.all[first : first + room])]


def _row(step: StepState, width: int) -> Row:
    sign, tone = SIGNS[step.state]
    name = step.planned.name + (f" {step.planned.label}" if step.planned.label else "")
    left: Row = [(f"{sign} ", tone), (name, TEXT if step.state != "ahead" else LABEL)]
    if step.state == "running":
        full = round(step.share * BAR)
        said = f" {step.took_s:3.0f} of ~{step.planned.duration_s:.0f} s"
        return apart(left, [("━" * full, STRONG), ("─" * (BAR - full), GRID), (said, TEXT)], width)
    if step.state == "ahead":
        sure = "~" if step.planned.certain else "if needed ~"
        return apart(left, [(f"{sure}{step.planned.duration_s:.0f} s", LABEL)], width)
    said = "left out" if step.state == "left out" else f"{step.took_s:.0f} s"
    return apart(left, [(said, LABEL)], width)


def clock(seconds: float) -> str:
    """Minutes and seconds: "1:07"."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
