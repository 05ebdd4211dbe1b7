"""A drive's watchdog: acts where the host has fallen silent."""

from collections.abc import Callable

from norton_sim.world import World

SHORTEST_PERIOD_NS = 1_000_000  # the firmware itself looks no oftener


class Watchdog:
    """Off until it is switched on; then ``expire`` is called where nobody feeds it, again and again."""

    def __init__(self, world: World, expire: Callable[[], None]) -> None:
        self.enabled = False
        self.timeout_ns = 0
        self._world = world
        self._expire = expire
        self._fed_ns = 0
        self._look_ns = 0

    def feed(self) -> None:
        self._fed_ns = self._world.now_ns

    def configure(self, *, enabled: bool, timeout_ns: int) -> None:
        """From now on bite, where ``enabled``, after ``timeout_ns`` without being fed."""
        self.enabled, self.timeout_ns = enabled, timeout_ns
        if enabled:
            self._look_after(self._fed_ns)

    def _look_after(self, instant_ns: int) -> None:
        """See a timeout after ``instant_ns`` whether the drive starves: once, instead of at each of many feedings."""
        self._look_ns = max(instant_ns + self.timeout_ns, self._world.now_ns + SHORTEST_PERIOD_NS)
        self._world.at(self._look_ns, self._look)

    def _look(self, stamp_ns: int) -> None:
        # A look that was planned before it was configured anew has been replaced by another.
        if not self.enabled or stamp_ns != self._look_ns:
            return
        starved = stamp_ns >= self._fed_ns + self.timeout_ns
        if starved:
            self._expire()
        self._look_after(stamp_ns if starved else self._fed_ns)
