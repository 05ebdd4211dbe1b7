"""The progress of the session: title, steps, event log, and the readings of tables."""

from textwrap import wrap

from norton_bench.events import SessionState
from norton_bench.report.words import number, pretty_unit
from norton_bench.screen.figures import FALLING, RISING
from norton_bench.screen.picture.parts import Reading, StepList, StepState, Tabulated
from norton_bench.screen.picture.picture import EventLog, LogLine, Picture
from norton_bench.screen.styles import (
    BAD,
    GOOD,
    GRID,
    LABEL,
    LEAST_COLUMNS,
    STRONG,
    TEXT,
    UNIT,
    WARNING,
    Row,
    apart,
    fitted,
    heading,
    length,
)

SIGNS = {
    "ahead": ("·", LABEL),
    "running": ("▶", STRONG),
    "done": ("✓", GOOD),
    "left out": ("–", LABEL),
    "stopped": ("✗", BAD),
}
BAR = 10


def step_rows(steps: StepList, width: int, height: int) -> list[Row]:
    """The steps of the session, done and ahead.

    A row for each step; where there is no room for all, those around the running one.
    """
    left = f"{clock(steps.left_s)} left" if steps.all and steps.left_s >= 1 else ""
    rows = [heading("Steps", "", left, width)]
    if not steps.all:
        return [*rows, [("no steps yet", LABEL)]]
    room = max(height - 1, 1)
    first = max(0, min(steps.number - 1 - room // 2, len(steps.all) - room))
    return [*rows, *(_row(step, width) for step in steps.all[first : first + room])]


def _row(step: StepState, width: int) -> Row:
    sign, style = SIGNS[step.state]
    name = step.planned.name + (f" {step.planned.label}" if step.planned.label else "")
    left: Row = [(f"{sign} ", style), (name, TEXT if step.state != "ahead" else LABEL)]
    if step.state == "running":
        full = round(step.share * BAR)
        time = f" {step.took_s:3.0f} of ~{step.planned.duration_s:.0f} s"
        return apart(left, [("━" * full, STRONG), ("─" * (BAR - full), GRID), (time, TEXT)], width)
    if step.state == "ahead":
        sure = "~" if step.planned.certain else "if needed ~"
        return apart(left, [(f"{sure}{step.planned.duration_s:.0f} s", LABEL)], width)
    time = "left out" if step.state == "left out" else f"{step.took_s:.0f} s"
    return apart(left, [(time, LABEL)], width)


def clock(seconds: float) -> str:
    """Minutes and seconds: "1:07"."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


Badge = tuple[str, str]  # what it says, and its style
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


def title_row(picture: Picture, what: str, message: str, width: int, badge: Badge) -> Row:
    """The two lines at the top: what runs, and how far it has come.

    Rig and session; at the right ``message``, the pace, and the ``badge``.
    """
    words, style = badge
    left: Row = [(f" {picture.rig.name}", STRONG), (f"  {what}", LABEL)]
    paced = badge not in (REPLAYING, HALTED) and picture.state in PACED and picture.pace > 0
    pace = f"{picture.pace:.1f}× " if paced and abs(picture.pace - 1) > 0.05 else ""
    right: Row = [(f"{message}  " if message else "", TEXT), (f"{pace} ", UNIT), (f" {words} ", style)]
    return apart(left, right, width)


def view_row(picture: Picture, views: list[str], chosen: int, width: int) -> Row:
    """The numbered views, and the running step with its time."""
    if picture.concluding:
        doing, time = picture.fitting, f"  {picture.fit_took_s} s"
    else:
        doing, time = _running(picture, width)
    left = _view_names(views, chosen, short=width < LEAST_COLUMNS)
    return apart(left, [(doing, TEXT), (f"{time} ", UNIT)], width)


def _view_names(views: list[str], chosen: int, *, short: bool) -> Row:
    """Each with its number; where ``short``, the name of the chosen one alone."""
    row: Row = [] if short else [(" ", TEXT)]
    for place, name in enumerate(views):
        said = f" {place + 1} " if short and place != chosen else f" {place + 1} {name} "
        row += [(said, "badge-calm" if place == chosen else LABEL), ("" if short else " ", TEXT)]
    return row


def _running(picture: Picture, width: int) -> tuple[str, str]:
    """The step that runs, and the session's time."""
    segment, step = picture.segment, picture.steps.running
    doing = "" if step is None else f"{picture.steps.number}/{len(picture.steps.all)} {step.planned.name}"
    if width >= WITH_SEGMENT and step is not None and segment is not None and segment.procedure == step.planned.name:
        doing += f" · {segment.name}"
    left_s = picture.steps.left_s
    time = f"  {clock(picture.now_s)}" + (f" −{clock(left_s)}" if picture.steps.all and left_s >= 1 else "")
    return doing, time


EVENT_KIND, TIME = 9, 8
LINE_BEGINS = TIME + EVENT_KIND + 1  # the text of a line of the log
KIND_STYLES = {"stop": BAD, "fault": WARNING, "bus": WARNING, "device": WARNING, "drive": WARNING, "operator": TEXT}


def log_rows(log: EventLog, width: int, height: int, *, back: int = 0) -> list[Row]:
    """The event log.

    The last lines, or those ``back`` lines earlier.
    """
    lines = list(log.lines)[: len(log.lines) - back] if back else list(log.lines)
    position = f"{back} newer below" if back else ""
    rows = [heading("Events", "", position, width)]
    room = max(height - 1, 0)
    return [*rows, *[row for line in lines[-room:] for row in _log_line(line, width)][-room:]]


def _log_line(line: LogLine, width: int) -> list[Row]:
    """Cut at the end of the row; on a phone folded."""
    time = "" if line.time_s is None else f"{line.time_s:.1f} s".replace("-", "−")
    kind = "" if line.kind == "note" else line.kind
    begin: Row = [(time.rjust(TIME), LABEL), (f" {kind:<{EVENT_KIND}}", UNIT)]
    style = KIND_STYLES.get(line.kind, LABEL)
    if width >= LEAST_COLUMNS:
        return [fitted([*begin, (line.text, style)], width)]
    first, *others = wrap(line.text, width, initial_indent=" " * length(begin), subsequent_indent="  ") or [""]
    return [[*begin, (first[length(begin) :], style)], *([(other, style)] for other in others)]


KIND, COLUMN, LEAST_COLUMN = 10, 12, 8
WORDS = ("command", "position", "torque")
SMALL = 1e-3  # smaller values would need a power of ten


def table_rows(tabulated: Tabulated, command_unit: str, width: int, height: int) -> list[Row]:
    """The readings of an actuator without a model, a row for each, the newest last."""
    readings = list(tabulated.readings.values())
    count = f"{len(readings)} readings" if readings else ""
    rows = [heading("Tables", "", count, width)]
    if not readings:
        return [
            *rows,
            [("no model is fitted: source and torques", LABEL)],
            [("are tabulated, and appear here", LABEL)],
        ]
    columns = _columns(width)
    rows += [_labels(words, columns) for words in (WORDS, (f"[{pretty_unit(command_unit)}]", "[rad]", "[N·m]"))]
    room = max(height - len(rows), 1)
    return [*rows, *(_reading_row(reading, columns) for reading in readings[-room:])]


def _columns(width: int) -> list[int]:
    """The width of each column: what there is room for, within bounds."""
    least = [max(len(word) + 1, LEAST_COLUMN) for word in WORDS]
    spare = max(width - KIND - sum(least), 0) // len(WORDS)
    return [min(column + spare, COLUMN) for column in least]


def _labels(words: tuple[str, ...], columns: list[int]) -> Row:
    return [(" " * KIND, LABEL), *((f"{word:>{column}}", LABEL) for word, column in zip(words, columns, strict=True))]


def _reading_row(reading: Reading, columns: list[int]) -> Row:
    sign = RISING if reading.rising else FALLING
    values = zip((reading.command, reading.position_rad, reading.torque_nm), columns, strict=True)
    return [
        (f"{sign} {reading.what:<{KIND - 2}}", STRONG),
        *((f"{_short(value):>{column}}", TEXT) for value, column in values),
    ]


def _short(value: float) -> str:
    """Four decimals at most."""
    rounded = round(value, 4)
    return f"{rounded:.4f}".replace("-", "−") if 0.0 < abs(rounded) < SMALL else number(rounded, 3)
