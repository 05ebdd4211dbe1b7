"""Which rig, and which session on it: lists with what stands in the file beside them."""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.screen import Screen
from textual.widgets import Footer, Label, OptionList, Static
from textual.widgets.option_list import Option

from norton_bench.screen.found import Choice
from norton_bench.screen.screens import keys


class ChoiceScreen(Screen[int | None]):
    """Ends with the number of the choice, None where there is none."""

    BINDINGS = keys.PICK

    def __init__(self, title: str, choices: Sequence[Choice], none: str) -> None:
        super().__init__()
        self._title, self._choices, self._none = title, choices, none

    def compose(self) -> ComposeResult:
        yield Label(self._title, id="choice-title")
        with Horizontal(id="choices"):
            yield OptionList(*(Option(choice.name, disabled=bool(choice.mistake)) for choice in self._choices))
            with VerticalScroll(id="said-scroll", can_focus=False):
                yield Static(self._none if not self._choices else "", id="said", markup=False)
        yield Footer()

    def on_option_list_option_highlighted(self, event: OptionList.OptionHighlighted) -> None:
        self._say(event.option_index)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(event.option_index)

    def on_mount(self) -> None:
        mistakes = [f"{choice.name}: {choice.mistake}" for choice in self._choices if choice.mistake]
        if mistakes and len(mistakes) == len(self._choices):
            self.query_one("#said", Static).update("\n\n".join(mistakes))

    def _say(self, number: int) -> None:
        choice = self._choices[number]
        self.query_one("#said", Static).update(choice.mistake or choice.said)

    def action_back(self) -> None:
        self.dismiss(None)
