"""What a process that is nothing but a loop takes from the machine for as long as it lives, where it may."""

import ctypes
import os
import sys
from dataclasses import dataclass

from norton_drivers.punctual import LOOP_PRIORITY, permitted_priority

if sys.platform == "linux":
    import resource

# Linux' <sys/mman.h> and <linux/prctl.h>.
LOCK_CURRENT, LOCK_FUTURE = 1, 2
SET_TIMER_SLACK = 29


@dataclass(frozen=True)
class Settled:
    """What the process has got, in a few words, and what it has not, a sentence with the mend each; ``core`` is the
    number of its own, None where it shares all."""

    words: str
    notes: tuple[str, ...] = ()
    core: int | None = None


def settle_in(core: int | None) -> Settled:
    """Lock this process' memory and wake it up without slack. It may have a core of its own already.

    Its real-time priority, which :func:`norton_drivers.punctual.punctual` takes while it counts, is only looked at.
    """
    had, missed = ["in a process of its own"], list[str]()
    if priority := permitted_priority(LOOP_PRIORITY):
        had.append(f"real-time priority {priority}")
    else:
        missed.append(
            f"the loop may not run in real time on this system; add `@realtime - rtprio {LOOP_PRIORITY}` for your "
            "group to /etc/security/limits.conf and log in again"
        )
    if _lock_memory():
        had.append("memory locked")
    else:
        missed.append(
            "the loop's memory may be paged out on this system; add `@realtime - memlock unlimited` for your group to "
            "/etc/security/limits.conf and log in again"
        )
    _wake_without_slack()
    if core is not None:
        had.append(f"core {core}")
    return Settled(", ".join(had), tuple(missed), core)


def _lock_memory() -> bool:
    """Whether nothing of this process can be paged out. A limit that the future may meet would end it then."""
    if sys.platform != "linux":
        return False
    if os.geteuid() != 0 and resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY:
        return False
    return bool(ctypes.CDLL(None).mlockall(LOCK_CURRENT | LOCK_FUTURE) == 0)


def _wake_without_slack() -> None:
    """Linux lets processes that are not in real time sleep up to 50 µs longer, to wake several at once."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_TIMER_SLACK, 1, 0, 0, 0)
