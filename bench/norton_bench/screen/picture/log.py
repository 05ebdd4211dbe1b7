"""What happened, line by line, the last of it last."""

from collections import deque
from dataclasses import dataclass

KEPT = 400
STEP = "step"


@dataclass(frozen=True)
class Line:
    """``time_s`` is bench time, None before the first tick. ``kind`` as of an event, or "note"."""

    time_s: float | None
    kind: str
    text: str


class Log:
    """The last lines; ``total`` counts all there ever were."""

    def __init__(self) -> None:
        self.lines: deque[Line] = deque(maxlen=KEPT)
        self.total = 0

    def add(self, line: Line) -> None:
        """An event is often told a second time in words: once is enough. A step may come a second time."""
        if line.kind != STEP and any(line.text == before.text for before in list(self.lines)[-8:]):
            return
        self.lines.append(line)
        self.total += 1
