"""A widget of rows of characters with styles; it is drawn only when the terminal is written to."""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Size
from textual.strip import Strip
from textual.widget import Widget

from norton_bench.screen.plots import Drawer, PlotFigure
from norton_bench.screen.styles import STYLES, Row, fitted


class Rows(Widget):
    """Shows the rows of :meth:`draw`. Takes no focus and no keys."""

    can_focus = False
    COMPONENT_CLASSES: ClassVar[set[str]] = {f"style--{style}" for style in STYLES}

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002  (textual's own name)
        super().__init__(id=id)
        self._drawn: list[Strip] | None = None
        self._drawn_for = Size()
        self._styles: dict[str, Style] = {}

    @abstractmethod
    def draw(self, width: int, height: int) -> list[Row]:
        """At most ``height`` rows of at most ``width`` characters."""

    def changed(self) -> None:
        """Draw again with the next frame; nothing is done while hidden."""
        self._drawn = None
        if self.is_on_screen:
            self.refresh()

    def notify_style_update(self) -> None:
        self._drawn = None
        self._styles.clear()
        super().notify_style_update()

    def render_line(self, y: int) -> Strip:
        """A new size may be drawn before anybody is told of it, so the rows are compared with the size they are for."""
        width = self.size.width
        if self._drawn is None or self._drawn_for != self.size:
            self._drawn_for = self.size
            self._drawn = [self._strip(row, width) for row in self.draw(width, self.size.height)]
        return self._drawn[y] if y < len(self._drawn) else self._strip([], width)

    def _strip(self, row: Row, width: int) -> Strip:
        """The row as a strip; every character is one column wide, so that widths need not be measured."""
        segments = [Segment(text, self._style(style)) for text, style in fitted(row, width)]
        return Strip(segments, width)

    def _style(self, style: str) -> Style:
        """A style, looked up once: textual computes it from all ancestors each time."""
        if style not in self._styles:
            self._styles[style] = self.get_component_rich_style(f"style--{style}")
        return self._styles[style]


class Panel(Rows):
    """A table or a line about a session: shows ``rows_of(width, height)`` as of the last :meth:`changed`."""

    def __init__(self, rows_of: Callable[[int, int], list[Row]], *, id: str) -> None:  # noqa: A002
        super().__init__(id=id)
        self._rows_of = rows_of

    def draw(self, width: int, height: int) -> list[Row]:
        return self._rows_of(width, height)


class Plot(Rows):
    """Shows the last figure given to it."""

    def __init__(self, *, id: str) -> None:  # noqa: A002  (textual's own name)
        super().__init__(id=id)
        self._figure: PlotFigure | None = None
        self._drawer = Drawer()

    def show(self, figure: PlotFigure) -> None:
        """Draw ``figure`` from the next frame on."""
        self._figure = figure
        self.changed()

    def forget(self) -> None:
        """Forget the ranges: the next figure is another one."""
        self._drawer.forget()

    def draw(self, width: int, height: int) -> list[Row]:
        return [] if self._figure is None else self._drawer.draw(self._figure, width, height)
