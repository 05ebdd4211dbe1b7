"""Which rig, and which session on it: lists with what stands in the file beside them.

What cannot be chosen is in the list too, marked, and says why.
"""

from collections.abc import Sequence

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.screen import Screen
from textual.widgets import Footer, Label, OptionList, Static
from textual.widgets.option_list import Option

from norton_bench.screen.available import Choice
from norton_bench.screen.screens import keys

IMPOSSIBLE = "✗"
BY_HAND = 1  # its place: behind the standard session


class ChoiceScreen(Screen[int | None]):
    """Ends with the number of the choice, None where there is none."""

    BINDINGS = keys.PICK

    def __init__(self, title: str, choices: Sequence[Choice], none: str) -> None:
        super().__init__()
        self._title, self._choices, self._none = title, choices, none

    def compose(self) -> ComposeResult:
        yield Label(self._title, id="choice-title")
        with Horizontal(id="choices"):
            yield OptionList(*(Option(_shown(choice)) for choice in self._choices))
            with VerticalScroll(id="said-scroll", can_focus=False):
                yield Static(self._none if not self._choices else "", id="said", markup=False)
        yield Footer()

    def on_option_list_option_highlighted(self, event: OptionList.OptionHighlighted) -> None:
        self._say(event.option_index)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        mistake = self._choices[event.option_index].mistake
        if mistake:
            self.notify(mistake, title="Cannot be chosen", severity="warning", timeout=10, markup=False)
        else:
            self.dismiss(event.option_index)

    def _say(self, number: int) -> None:
        choice = self._choices[number]
        said = f"Cannot be chosen:\n{choice.mistake}" if choice.mistake else choice.said
        self.query_one("#said", Static).update(said)

    def action_back(self) -> None:
        self.dismiss(None)


class SessionChoice(ChoiceScreen):
    """The same with a key for the one that is no session."""

    BINDINGS = keys.BESIDE_SESSIONS

    def action_by_hand(self) -> None:
        self.dismiss(BY_HAND)


def _shown(choice: Choice) -> Text:
    return Text(f"{IMPOSSIBLE} {choice.name}", "dim") if choice.mistake else Text(f"  {choice.name}")
