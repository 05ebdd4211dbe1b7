"""All keys: the id, by which a keymap refers to it, the action, and the texts."""

from collections.abc import Sequence
from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Label, Static

SPACE = "space"
STOP_ID = "stop"


SEEK, SPEED = Binding.Group("Seek", compact=True), Binding.Group("Speed", compact=True)


def key(
    keys: str,
    action: str,
    said: str,
    tooltip: str,
    *,
    shown: bool = True,
    name: str = "",
    group: Binding.Group | None = None,
) -> Binding:
    """A binding whose id is its action, unless ``name`` gives another."""
    return Binding(keys, action, said, show=shown, tooltip=tooltip, id=name or action, group=group)


STOP_SAID = "Stop at once, on every screen: the drives go idle within a tick, the recording is closed"
# A binding of the app, so that every screen and every window has it.
STOP = Binding(SPACE, "app.stop", "Stop", priority=True, id=STOP_ID, tooltip=STOP_SAID)

# As textual declares it.
AnyBinding = Binding | tuple[str, str] | tuple[str, str, str]

APP: list[AnyBinding] = [
    STOP,
    key("question_mark,f1", "keys", "Keys", "Show all keys"),
    key("q", "leave", "Quit", "Leave; asks first while an experiment runs"),
    Binding(
        "ctrl+q,ctrl+c", "leave", "Quit", show=False, system=True, id="leave_by_interrupt", tooltip="Leave, likewise"
    ),
]
EXPERIMENT: list[AnyBinding] = [
    STOP,  # once more, so that it is the first in the footer
    key("s", "start", "Start", "Start the session; nothing moves before this"),
    key("p", "pause", "Pause", "Pause at the next checkpoint, between two procedures, with the drives idle"),
    key("p", "resume", "Resume", "Resume after a pause"),
    key("enter", "answer", "Answer", "Answer what the session asks"),
    key("t", "tare", "Tare", "Measure bench and sensor at rest at the next checkpoint"),
    key("m", "mark", "Mark", "Put a remark into the recording, with this time"),
    key("n", "skip", "Skip", "Leave out the next step"),
    key("a", "abort", "Abort", "Stop, and go back; asks first", shown=False),
    key("r", "results", "Results", "Parameters, verdict and figures of merit; a replay is fitted first"),
    key("1", "view(0)", "Overview", "Everything at a glance", shown=False, name="view_overview"),
    key("2", "view(1)", "Loops", "Torque against velocity and position, large", shown=False, name="view_loops"),
    key("3", "view(2)", "Source", "The motion source and the parameters, large", shown=False, name="view_source"),
    key("4", "view(3)", "Bench", "Devices, buses, the loop, and the event log", shown=False, name="view_bench"),
    key("plus,equals_sign", "window(1)", "Longer", "Show a longer stretch of time", shown=False, name="window_longer"),
    key("minus", "window(-1)", "Shorter", "Show a shorter stretch of time", shown=False, name="window_shorter"),
    key("pageup", "scroll_log(10)", "Older", "Earlier events", shown=False, name="log_older"),
    key("pagedown", "scroll_log(-10)", "Newer", "Later events", shown=False, name="log_newer"),
    key("left", "seek(-5)", "Back 5 s", "Replay: five seconds back", name="seek_back", group=SEEK),
    key("right", "seek(5)", "Forward 5 s", "Replay: five seconds forward", name="seek_on", group=SEEK),
    key("shift+left", "seek(-30)", "Back 30 s", "Replay: half a minute back", shown=False, name="seek_far_back"),
    key("shift+right", "seek(30)", "Forward 30 s", "Replay: half a minute forward", shown=False, name="seek_far_on"),
    key("home", "seek(-1000000)", "To the beginning", "Replay: from the beginning", shown=False, name="seek_begin"),
    key("end", "seek(1000000)", "To the end", "Replay: the end", shown=False, name="seek_end"),
    key("up", "speed(1)", "Faster", "Replay: faster", name="speed_up", group=SPEED),
    key("down", "speed(-1)", "Slower", "Replay: slower", name="speed_down", group=SPEED),
]
NUDGE, NUDGE_LOAD = Binding.Group("Actuator", compact=True), Binding.Group("Load", compact=True)
STEP = Binding.Group("Step", compact=True)
BY_HAND: list[AnyBinding] = [
    STOP,
    key("s", "start", "Start", "Enable the drives at zero; nothing moves before this", name="by_hand_start"),
    key("up", "nudge(1)", "Up", "The actuator's command a step up", name="nudge_up", group=NUDGE),
    key("down", "nudge(-1)", "Down", "The actuator's command a step down", name="nudge_down", group=NUDGE),
    key("right", "nudge_load(1)", "Up", "The load's torque or velocity a step up", name="load_up", group=NUDGE_LOAD),
    key(
        "left",
        "nudge_load(-1)",
        "Down",
        "The torque or velocity of the load a step down",
        name="load_down",
        group=NUDGE_LOAD,
    ),
    key("0", "order('zero')", "Zero", "Everything back to zero, along ramps", name="back_to_zero"),
    key("plus,equals_sign", "share(1)", "Larger", "Larger steps", name="larger_steps", group=STEP),
    key("minus", "share(-1)", "Smaller", "Smaller steps", name="smaller_steps", group=STEP),
    key("c", "load('coast')", "Coast", "The load coasts", shown=False, name="load_coasts"),
    key(
        "t", "load('torque')", "Torque", "The load pushes: right and left are torques", shown=False, name="load_pushes"
    ),
    key(
        "v",
        "load('velocity')",
        "Velocity",
        "The load turns: right and left are velocities; needs its calibration",
        shown=False,
        name="load_turns",
    ),
    key(
        "z",
        "load('zero_torque')",
        "Zero torque",
        "The load keeps the port at zero torque; needs its calibration",
        shown=False,
        name="load_releases",
    ),
    key(
        "b",
        "body",
        "Body",
        "The load acts a mass, a damper and a spring; asks for them; needs its calibration",
        shown=False,
        name="load_acts_a_body",
    ),
    key("k", "calibrate", "Calibrate", "Calibrate the load, for v, z and b; asks first", shown=False),
    key("enter", "order('here')", "Here", "You are present: nothing returns to zero yet", shown=False, name="here"),
    key("r", "extremes", "Extremes", "Restart the least and greatest values", shown=False, name="forget_extremes"),
    key("d", "devices", "More", "Devices, buses and the loop, where there is no room beside the signals"),
    key("m", "mark", "Mark", "Put a remark into the recording, with this time", shown=False, name="by_hand_mark"),
    key(
        "escape", "end", "End", "Back to zero, then the drives go idle and the recording is closed", name="by_hand_end"
    ),
    key("a", "abort", "Back", "Stop, and go back to the choice", shown=False, name="by_hand_abort"),
]
RESULTS: list[AnyBinding] = [
    key("o", "open_report", "Report", "Open the report in the browser"),
    key("escape,r", "back", "Back", "Back to the experiment", name="back_to_experiment"),
]
PICK: list[AnyBinding] = [key("escape", "back", "Back", "Back", shown=False, name="back_from_choice")]
BESIDE_SESSIONS: list[AnyBinding] = [
    *PICK,
    key("j", "by_hand", "By hand", "Move the bench by hand: nudge, watch, stop"),
]
KNOWN = frozenset(
    each.id
    for each in (*APP, *EXPERIMENT, *BY_HAND, *RESULTS, *PICK, *BESIDE_SESSIONS)
    if isinstance(each, Binding) and each.id is not None and not each.system
)


class KeyList(ModalScreen[None]):
    """The help screen: ``sections`` are titles with keys, as in the keymap, and their actions."""

    BINDINGS: ClassVar = [key("escape,question_mark,f1", "close", "Close", "Close this list", name="close_keys")]

    def __init__(self, sections: Sequence[tuple[str, Sequence[tuple[str, str]]]]) -> None:
        super().__init__()
        self._sections = sections

    def compose(self) -> ComposeResult:
        with Vertical(id="key-list"):
            yield Label("Keys", classes="asked")
            with VerticalScroll(can_focus=True):
                for title, described in self._sections:
                    yield Label(title, classes="section")
                    yield Static(_table(described), classes="keys")
            yield Label("escape closes · names for a keymap: docs/screen.md", classes="hint")

    def action_close(self) -> None:
        self.dismiss()


def _table(described: Sequence[tuple[str, str]]) -> Table:
    """Keys and their actions; a long line is continued below."""
    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(no_wrap=True, min_width=12)
    table.add_column(ratio=1)
    for shown, said in described:
        table.add_row(Text(shown, "bold"), Text(said))
    return table
