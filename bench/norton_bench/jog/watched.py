"""A watcher of a bench that goes to given values: what every signal was while they stood."""

from collections.abc import Callable

from norton_bench.identification.results import LiveEstimate
from norton_bench.jog.signals import Signals
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.session.progress import Silent


class Held(Silent):
    """``words`` name the segments to watch, ramps up to the values included; notes go to ``say``."""

    def __init__(self, rig: Rig, words: str, say: Callable[[str], None]) -> None:
        self.words = words
        self.signals = Signals(rig)
        self._say = say

    def part(self, measured: Measured, live: LiveEstimate) -> None:
        if measured.segments and measured.segments[-1].name == self.words:
            self.signals.take(measured)

    def note(self, text: str) -> None:
        self._say(text)
