"""All keys, with what they do."""

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Label, Static

from bench.screen.screens.keys import key


class KeyList(ModalScreen[None]):
    """The help screen: ``sections`` are titles with keys, as the keymap has them, and what they do."""

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
                    for shown, said in described:
                        yield Static(f"{shown:<14}{said}", markup=False, classes="key")
            yield Label("escape closes · names for a keymap: docs/screen.md", classes="hint")

    def action_close(self) -> None:
        self.dismiss()
