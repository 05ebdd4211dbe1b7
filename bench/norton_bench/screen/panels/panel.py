"""A table or a line about a session as a widget."""

from collections.abc import Callable

from norton_bench.screen.panels.rows import Rows
from norton_bench.screen.tones import Row


class Panel(Rows):
    """Shows what ``rows_of(width, height)`` gives, as it was when last told that something changed."""

    def __init__(self, rows_of: Callable[[int, int], list[Row]], *, id: str) -> None:  # noqa: A002
        super().__init__(id=id)
        self._rows_of = rows_of

    def draw(self, width: int, height: int) -> list[Row]:
        return self._rows_of(width, height)
