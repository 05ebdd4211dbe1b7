"""A figure as a widget."""

from norton_bench.screen.panels.rows import Rows
from norton_bench.screen.plots.drawing import Drawer
from norton_bench.screen.plots.figure import Figure
from norton_bench.screen.tones import Row


class Plot(Rows):
    """Shows the figure that it was given last."""

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
