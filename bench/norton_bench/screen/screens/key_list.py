"""All keys, with what they do."""

from collections.abc import Sequence
from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Label, Static

from norton_bench.screen.screens.keys import key


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
                    yield Static(_table(described), classes="keys")
            yield Label("escape closes · names for a keymap: docs/screen.md", classes="hint")

    def action_close(self) -> None:
        self.dismiss()


def _table(described: Sequence[tuple[str, str]]) -> Table:
    """Keys and what they do; a long line goes on below itself."""
    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(no_wrap=True, min_width=12)
    table.add_column(ratio=1)
    for shown, said in described:
        table.add_row(Text(shown, "bold"), Text(said))
    return table
