"""The choice of a rig, and of a session on it: a list, and beside it the description of each file.

Files that cannot be used are in the list, too, marked, with the reason.
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
BY_HAND = 1  # its place: after the standard session


class ChoiceScreen(Screen[int | None]):
    """Returns the number of the choice, None where the user leaves."""

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
        text = f"Cannot be chosen:\n{choice.mistake}" if choice.mistake else choice.description
        self.query_one("#said", Static).update(text)

    def action_back(self) -> None:
        self.dismiss(None)


class SessionChoice(ChoiceScreen):
    """The choice of a session, with a key for moving the bench by hand."""

    BINDINGS = keys.BESIDE_SESSIONS

    def action_by_hand(self) -> None:
        self.dismiss(BY_HAND)


def _shown(choice: Choice) -> Text:
    return Text(f"{IMPOSSIBLE} {choice.name}", "dim") if choice.mistake else Text(f"  {choice.name}")
