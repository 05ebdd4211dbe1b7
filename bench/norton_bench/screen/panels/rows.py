"""Rows of characters with styles as a widget: drawn when the terminal is next written to, and at no other time."""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from textual.widget import Widget

from norton_bench.screen.plots import Drawer, Figure
from norton_bench.screen.styles import STYLES, Row, fitted


class Rows(Widget):
    """What :meth:`draw` gives, line by line. Takes no focus and no keys."""

    can_focus = False
    COMPONENT_CLASSES: ClassVar[set[str]] = {f"style--{style}" for style in STYLES}

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002  (textual's own name)
        super().__init__(id=id)
        self._drawn: list[Strip] | None = None
        self._styles: dict[str, Style] = {}

    @abstractmethod
    def draw(self, width: int, height: int) -> list[Row]:
        """At most ``height`` rows of at most ``width`` characters."""

    def changed(self) -> None:
        """Draw anew with the next frame. What is hidden costs nothing."""
        self._drawn = None
        if self.is_on_screen:
            self.refresh()

    def notify_style_update(self) -> None:
        self._drawn = None
        self._styles.clear()
        super().notify_style_update()

    def on_resize(self) -> None:
        self._drawn = None

    def render_line(self, y: int) -> Strip:
        width = self.size.width
        if self._drawn is None:
            self._drawn = [self._strip(row, width) for row in self.draw(width, self.size.height)]
        return self._drawn[y] if y < len(self._drawn) else self._strip([], width)

    def _strip(self, row: Row, width: int) -> Strip:
        """Every character of ours is one column wide, so nothing needs measuring."""
        segments = [Segment(text, self._style(style)) for text, style in fitted(row, width)]
        return Strip(segments, width)

    def _style(self, style: str) -> Style:
        """Looked up once: textual works each of them out anew from all ancestors."""
        if style not in self._styles:
            self._styles[style] = self.get_component_rich_style(f"style--{style}")
        return self._styles[style]


class Panel(Rows):
    """A table or a line about a session as a widget.

    Shows what ``rows_of(width, height)`` gives, as it was when last told that something changed.
    """

    def __init__(self, rows_of: Callable[[int, int], list[Row]], *, id: str) -> None:  # noqa: A002
        super().__init__(id=id)
        self._rows_of = rows_of

    def draw(self, width: int, height: int) -> list[Row]:
        return self._rows_of(width, height)


class Plot(Rows):
    """A figure as a widget.

    Shows the figure that it was given last.
    """

    def __init__(self, *, id: str) -> None:  # noqa: A002  (textual's own name)
        super().__init__(id=id)
        self._figure: Figure | None = None
        self._drawer = Drawer()

    def show(self, figure: Figure) -> None:
        """Draw ``figure`` from the next frame on."""
        self._figure = figure
        self.changed()

    def forget(self) -> None:
        """What comes next has nothing to do with what was shown."""
        self._drawer.forget()

    def draw(self, width: int, height: int) -> list[Row]:
        return [] if self._figure is None else self._drawer.draw(self._figure, width, height)
