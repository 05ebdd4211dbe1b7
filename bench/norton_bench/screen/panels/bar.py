"""The two lines at the top: what runs, and how far it has come."""

from norton_bench.screen.panels.steps import clock
from norton_bench.screen.picture.picture import Picture
from norton_bench.screen.tones import LABEL, STRONG, TEXT, UNIT, Row, apart
from norton_bench.session.progress import SessionState

Badge = tuple[str, str]  # what it says, and its tone
REPLAYING, HALTED = ("▶ REPLAY", "badge-good"), ("‖ REPLAY", "badge-calm")
BADGES: dict[SessionState | None, Badge] = {
    None: ("○ READY", "badge-calm"),
    SessionState.PREPARING: ("◌ PREPARING", "badge-calm"),
    SessionState.RUNNING: ("● RUNNING", "badge-good"),
    SessionState.PAUSING: ("● PAUSING", "badge-warning"),
    SessionState.PAUSED: ("‖ PAUSED", "badge-warning"),
    SessionState.ASKING: ("? ASKING", "badge-warning"),
    SessionState.CONCLUDING: ("◌ FITTING", "badge-calm"),
    SessionState.DONE: ("✓ DONE", "badge-good"),
    SessionState.FAILED: ("■ STOPPED", "badge-bad"),
}
WITH_SEGMENT = 100
PACED = (SessionState.RUNNING, SessionState.PAUSING)


def title_row(picture: Picture, what: str, said: str, width: int, badge: Badge) -> Row:
    """Rig and session; at the right ``said``, the pace, and the ``badge``."""
    words, tone = badge
    left: Row = [(f" {picture.rig.name}", STRONG), (f"  {what}", LABEL)]
    paced = badge not in (REPLAYING, HALTED) and picture.state_now in PACED and picture.pace > 0
    pace = f"{picture.pace:.1f}× " if paced and abs(picture.pace - 1) > 0.05 else ""
    right: Row = [(f"{said}  " if said else "", TEXT), (f"{pace} ", UNIT), (f" {words} ", tone)]
    return apart(left, right, width)


def view_row(picture: Picture, views: list[str], chosen: int, width: int) -> Row:
    """The views by number, and what runs now with its time."""
    left: Row = [(" ", TEXT)]
    if picture.concluding:
        doing, time = picture.fitting, f"  {picture.fit_took_s} s"
    else:
        doing, time = _running(picture, width)
    for number, name in enumerate(views):
        left += [(f" {number + 1} {name} ", "badge-calm" if number == chosen else LABEL), (" ", TEXT)]
    return apart(left, [(doing, TEXT), (f"{time} ", UNIT)], width)


def _running(picture: Picture, width: int) -> tuple[str, str]:
    """The step that runs, and the session's time."""
    segment, step = picture.segment, picture.steps.running
    doing = "" if step is None else f"{picture.steps.number}/{len(picture.steps.all)} {step.planned.name}"
    if width >= WITH_SEGMENT and step is not None and segment is not None and segment.procedure == step.planned.name:
        doing += f" · {segment.name}"
    left_s = picture.steps.left_s
    time = f"  {clock(picture.now_s)}" + (f" −{clock(left_s)}" if picture.steps.all and left_s >= 1 else "")
    return doing, time
