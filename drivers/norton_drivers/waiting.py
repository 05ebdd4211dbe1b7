"""Waiting for a device's answer."""

from collections.abc import Callable

from norton_drivers.link import Link


def wait_until(
    arrived: Callable[[], bool], link: Link, timeout_s: float, meanwhile: Callable[[], object] | None = None
) -> bool:
    """Poll until ``arrived()``; False where ``timeout_s`` passed first. ``meanwhile`` is called before each poll.

    Raises ConnectionFailedError, and whatever the two functions raise.
    """
    deadline_ns = link.clock.now_ns() + round(timeout_s * 1e9)
    while not arrived():
        if link.clock.now_ns() >= deadline_ns:
            return False
        if meanwhile is not None:
            meanwhile()
        link.wait()
    return True
