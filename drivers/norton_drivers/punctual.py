"""What keeps a loop in wall time on time, as far as Python and the machine allow."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

if sys.platform == "linux":
    import resource

# Linux' real-time priorities, of 99. A loop comes before all that a system runs by default, and after its watchdogs;
# what it talks to, where that is served on the same machine, comes after the loop.
LOOP_PRIORITY, SERVER_PRIORITY = 80, 20


@contextmanager
def punctual(priority: int) -> Iterator[None]:
    """Inside, memory is settled, and the thread inside runs in real time where the machine permits it: as root, or
    with ``ulimit -r``."""
    with settled_memory(), _real_time(permitted_priority(priority)):
        yield


@contextmanager
def settled_memory() -> Iterator[None]:
    """Inside, the garbage collector lets be what is there already: all that was imported takes it 0.1 s each time."""
    frozen_before = gc.get_freeze_count() > 0
    gc.collect()  # or what is left over already would stay for as long
    gc.freeze()
    try:
        yield
    finally:
        if not frozen_before:
            gc.unfreeze()


def permitted_priority(wanted: int) -> int:
    """The greatest real-time priority up to ``wanted`` that this process may take; 0 where it may take none."""
    return next((priority for priority in (wanted, _limit(wanted)) if priority and _permitted(priority)), 0)


def _limit(wanted: int) -> int:
    """What the system has set for this user."""
    if sys.platform != "linux":
        return 0
    soft = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    return min(wanted, soft)


def _permitted(priority: int) -> bool:
    """Tried, and taken back at once."""
    try:
        policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        os.sched_setscheduler(0, policy, parameters)
    except (OSError, AttributeError):  # AttributeError: no such thing on this system
        return False
    return True


@contextmanager
def _real_time(priority: int) -> Iterator[None]:
    """With priority 0 nothing changes."""
    if not priority:
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, policy, parameters)
