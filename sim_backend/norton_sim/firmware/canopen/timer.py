"""A device's timer: an action each so many milliseconds of its own clock, until it is stopped or set anew."""

from collections.abc import Callable

from norton_sim.world import World


class Timer:
    """``clock_ppm`` is how much slower than the world's its clock goes, in parts per million."""

    def __init__(self, world: World, clock_ppm: float) -> None:
        self._world = world
        self._ns_per_ms = 1e6 * (1 + clock_ppm * 1e-6)
        self.running = False
        self._period_ns = 0
        self._action: Callable[[], None] = _nothing
        self._round = 0  # of which start; what an earlier one has planned is void

    def start(self, period_ms: float, action: Callable[[], None]) -> None:
        """First after one period; a period of zero stops it."""
        self.stop()
        self._period_ns = round(period_ms * self._ns_per_ms)
        self._action = action
        self.running = self._period_ns > 0
        if self.running:
            self._plan(self._round)

    def stop(self) -> None:
        self.running = False
        self._round += 1

    def _plan(self, started: int) -> None:
        self._world.at(self._world.now_ns + self._period_ns, lambda _stamp_ns: self._ring(started))

    def _ring(self, started: int) -> None:
        if started == self._round:
            self._plan(started)
            self._action()


def _nothing() -> None:
    """Never rings."""
