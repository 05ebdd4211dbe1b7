"""Time as the loop and the drivers know it: integer nanoseconds from one clock, which is passed in."""

import time
from typing import Protocol

# Sleeping alone wakes 50-100 µs late; the last stretch before a deadline is spent spinning instead.
SPIN_NS = 150_000


class Clock(Protocol):
    """A source of time. In simulation, waiting on it is what makes the plant move."""

    def now_ns(self) -> int:
        """The present instant [ns] since an arbitrary epoch."""
        ...

    def wait_until_ns(self, deadline_ns: int) -> None:
        """Return at ``deadline_ns``, or at once where it has passed."""
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def wait_until_ns(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > SPIN_NS:
            time.sleep((remaining_ns - SPIN_NS) * 1e-9)
        while time.monotonic_ns() < deadline_ns:
            pass
