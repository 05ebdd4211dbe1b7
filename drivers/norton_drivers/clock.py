"""Time as the loop and the drivers know it: integer nanoseconds from one clock, which is passed in."""

import time
from collections.abc import Callable
from typing import Protocol

# Sleeping alone wakes 50-100 µs late; the last stretch before a deadline is spent awake instead,
SPIN_NS = 150_000
# twice as long where there is something to do then, but nothing of it is begun when so little is left. With less of it
# the latest hundredth of the ticks began 20 to 300 µs late.
BUSY_NS, LATEST_NS = 300_000, 50_000
# Of the time until the deadline, at most: a system may stop for a while who never sleeps in real time.
BUSY_SHARE = 0.7


class Clock(Protocol):
    """A source of time. In simulation, waiting on it is what makes the plant move."""

    def now_ns(self) -> int:
        """The present instant [ns] since an arbitrary epoch."""
        ...

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        """Return at ``deadline_ns``, or at once where it has passed.

        A clock that has to stay awake shortly before the deadline may call ``awake`` then, again and again.
        """
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        spin_ns = SPIN_NS if awake is None else min(BUSY_NS, BUSY_SHARE * remaining_ns)
        if remaining_ns > spin_ns:
            time.sleep((remaining_ns - spin_ns) * 1e-9)
        if awake is not None:
            while deadline_ns - time.monotonic_ns() > LATEST_NS:
                awake()
        while time.monotonic_ns() < deadline_ns:
            pass
