"""Small windows with questions. Space is the stop key also here, so that words are joined by dashes."""

from collections.abc import Callable
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.widgets import Button, Input, Label

from norton_bench.events import Prompt
from norton_bench.report.words import pretty_unit
from norton_bench.screen.screens.keys import key
from norton_bench.segments import LAW_UNITS, Admittance

FIT_GIVEN_UP = "The final fit is abandoned. The recording is complete: norton-bench fit RECORDING repeats the fit."
SPACE_STOPS = "space stops: join words with -"


class Mark(ModalScreen[str]):
    """A remark for the recording; empty: none."""

    BINDINGS: ClassVar = [key("escape", "cancel", "Cancel", "Put no mark", name="cancel_mark")]

    def compose(self) -> ComposeResult:
        with Vertical(classes="question"):
            yield Label("Mark this moment", classes="asked")
            yield Input(placeholder=SPACE_STOPS, id="answer")
            yield Label("enter puts it into the recording · escape cancels", classes="hint")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        self.dismiss(event.value or "mark")

    def action_cancel(self) -> None:
        self.dismiss("")


class Body(ModalScreen[Admittance | None]):
    """A virtual body for the load: mass, damping and stiffness. None where it was cancelled.

    ``typing`` is called with every key: somebody is present.
    """

    BINDINGS: ClassVar = [key("escape", "cancel", "Cancel", "Leave the load as it is", name="cancel_body")]

    def __init__(self, law: Admittance, typing: Callable[[], None]) -> None:
        super().__init__()
        self._law, self._typing = law, typing

    def compose(self) -> ComposeResult:
        with Vertical(classes="question"):
            yield Label("A virtual body at the port", classes="asked")
            for (name, unit), value in zip(LAW_UNITS.items(), self._law.values, strict=True):
                yield Label(f"{name}  {pretty_unit(unit)}", classes="consequence")
                yield Input(f"{value:g}", type="number", compact=True)
            yield Label("stiff only beyond this angle, as a wall  rad", classes="consequence")
            wall_rad = self._law.wall_rad
            yield Input("" if wall_rad is None else f"{wall_rad:g}", placeholder="no wall", type="number", compact=True)
            yield Label("enter takes it · tab: the next value · escape cancels", classes="hint")

    def on_input_changed(self, event: Input.Changed) -> None:
        self._typing()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        *texts, wall = [each.value for each in self.query(Input)]
        try:
            law = Admittance.of([float(text or "0") for text in texts], float(wall) if wall else None)
        except ValueError:
            self.notify("these must be numbers", severity="error")
            return
        if law.shortcoming:
            self.notify(law.shortcoming, severity="error")
            return
        self.dismiss(law)

    def action_cancel(self) -> None:
        self.dismiss(None)


class Ask(ModalScreen[str | None]):
    """The answer to a prompt: one of its choices, or any text. None where the user answers later."""

    BINDINGS: ClassVar = [key("escape", "later", "Later", "Answer later; the session waits", name="answer_later")]

    def __init__(self, prompt: Prompt) -> None:
        super().__init__()
        self.prompt = prompt

    def compose(self) -> ComposeResult:
        with Vertical(classes="question"):
            yield Label(self.prompt.text, classes="asked", markup=False)
            if self.prompt.choices:
                with Horizontal(classes="choices"):
                    for number, choice in enumerate(self.prompt.choices):
                        yield Button(choice, id=f"choice-{number}")
            else:
                yield Input(placeholder=SPACE_STOPS, id="answer")
            yield Label("enter answers · escape: answer later · space stops", classes="hint")

    def on_button_pressed(self, event: Button.Pressed) -> None:
        self.dismiss(self.prompt.choices[int((event.button.id or "choice-0").removeprefix("choice-"))])

    def on_input_submitted(self, event: Input.Submitted) -> None:
        self.dismiss(event.value)

    def action_later(self) -> None:
        self.dismiss(None)


class Confirm(ModalScreen[bool]):
    """A confirmation of an action that cannot be undone."""

    BINDINGS: ClassVar = [
        key("y", "yes", "Yes", "Do it", name="confirm_yes"),
        key("n,escape", "no", "No", "Leave it", name="confirm_no"),
    ]

    def __init__(self, question: str, consequence: str, do: str) -> None:
        super().__init__()
        self._question, self._consequence, self._do = question, consequence, do

    def compose(self) -> ComposeResult:
        with Vertical(classes="question"):
            yield Label(self._question, classes="asked")
            yield Label(self._consequence, classes="consequence")
            with Horizontal(classes="choices"):
                yield Button(f"{self._do} (y)", id="yes", variant="error")
                yield Button("No (n)", id="no")

    def on_button_pressed(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.id == "yes")

    def action_yes(self) -> None:
        self.dismiss(True)

    def action_no(self) -> None:
        self.dismiss(False)
