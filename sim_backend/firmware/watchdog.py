"""A drive's watchdog: disarms it where the host has fallen silent."""

from collections.abc import Callable
from math import isfinite

from drivers.codecs.odrive import f32_of, f32_value, u32_of, u32_value
from drivers.odrive import ODriveOptions
from sim_backend.world import World

SHORTEST_PERIOD_NS = 1_000_000  # the firmware itself looks no oftener


class Watchdog:
    """Off until it is switched on through its parameters; then ``expire`` is called where an armed drive starves.

    Its parameters stand at the endpoints that the rig names. Source: ODrive API reference,
    ``axis.config.enable_watchdog`` and ``axis.config.watchdog_timeout`` [s].
    """

    def __init__(self, world: World, options: ODriveOptions, expire: Callable[[], None]) -> None:
        self._world = world
        self._expire = expire
        self._enabled = False
        self._timeout_ns = 0
        self._fed_ns = 0
        self._look_ns = 0
        self._enable_endpoint = options.enable_watchdog_endpoint
        self._timeout_endpoint = options.watchdog_timeout_endpoint

    def feed(self) -> None:
        self._fed_ns = self._world.now_ns

    def read(self, endpoint: int) -> bytes | None:
        """The parameter's four bytes; None where this endpoint is none of the watchdog's."""
        if endpoint == self._enable_endpoint:
            return u32_value(self._enabled)
        if endpoint == self._timeout_endpoint:
            return f32_value(self._timeout_ns * 1e-9)
        return None

    def write(self, endpoint: int, value: bytes) -> None:
        """Set a parameter; other endpoints are left alone."""
        if endpoint == self._enable_endpoint:
            self._enabled = bool(u32_of(value) & 0xFF)
        elif endpoint == self._timeout_endpoint and isfinite(timeout_s := f32_of(value)):
            self._timeout_ns = max(0, round(timeout_s * 1e9))
        if self._enabled:
            self._look_after(self._fed_ns)

    def _look_after(self, instant_ns: int) -> None:
        """See a timeout after ``instant_ns`` whether the drive starves: once, instead of at each of many feedings."""
        self._look_ns = max(instant_ns + self._timeout_ns, self._world.now_ns + SHORTEST_PERIOD_NS)
        self._world.at(self._look_ns, self._look)

    def _look(self, stamp_ns: int) -> None:
        # A look that was planned before the parameters changed has been replaced by another.
        if not self._enabled or stamp_ns != self._look_ns:
            return
        starved = stamp_ns >= self._fed_ns + self._timeout_ns
        if starved:
            self._expire()
        self._look_after(stamp_ns if starved else self._fed_ns)
