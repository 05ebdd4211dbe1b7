"""Every tick once more, shortly before the next is due, by a cast that never goes on stage.

A processor that slept for most of a millisecond, or did something else, goes through a tick two to three times slower
than one that has just been there: its caches and its branch predictors have forgotten. So the loop, while it waits,
has the last tick gone through again, on copies of guard and controller. They see what the real ones saw, one tick
later, and so decide the same; what they decide goes nowhere.
"""

from collections import deque
from copy import deepcopy

from bench.control.admittance import AdmittanceController
from bench.guard.commands import NOTHING, Commands
from bench.guard.guard import Guard
from bench.loop.load_strategy import LoadStrategy
from bench.loop.played import Played
from bench.sample import Sample

# A loop that never finds the time has none: after so many ticks it is left alone.
MOST_BEHIND = 64


class Understudy:
    """Made while the drives are idle: copying takes a millisecond or two."""

    def __init__(self, guard: Guard, controller: AdmittanceController | None) -> None:
        self._guard, self._controller = deepcopy(guard), None if controller is None else controller.copied()
        self._original: LoadStrategy | None = None
        self._strategy: LoadStrategy | None = None
        self._sent = NOTHING
        self._unplayed: deque[Played] = deque()
        self._retired = False

    @property
    def behind(self) -> bool:
        """Whether there is a tick that has not been gone through again."""
        return bool(self._unplayed)

    def begin(self, sample: Sample) -> None:
        """The drives were just enabled at zero."""
        self._guard.begin(sample)

    def watch(self, played: Played) -> None:
        """The real tick. None is left out but all: the copies would not be where the real ones were."""
        if self._retired:
            return
        self._unplayed.append(played)
        if len(self._unplayed) > MOST_BEHIND:
            self._retired = True
            self._unplayed.clear()

    def play(self) -> Played:
        """The oldest tick not yet gone through again, as it was decided this time."""
        original = self._unplayed.popleft()
        strategy, seen = self._taken_up(original.strategy), original.seen
        for _ in range(original.missed):
            strategy.note_sent(self._sent.load_torque_nm)
        if original.begins:
            strategy.begin(seen)
        wish = Commands(original.wish.command, strategy.wish(seen, original.number), 0, original.wish.modulation)
        self._guard.limit(wish, original.sample, original.drives)
        self._sent = original.commands
        strategy.note_sent(self._sent.load_torque_nm)
        return original._replace(wish=wish, strategy=strategy)

    def _taken_up(self, original: LoadStrategy) -> LoadStrategy:
        if self._strategy is None or original is not self._original:
            self._original, self._strategy = original, original.copied(self._controller)
        return self._strategy
