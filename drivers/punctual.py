"""What keeps a loop in wall time on time, as far as Python and the machine allow."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import get_native_id

# Python lets a thread keep the interpreter for 5 ms by default: five ticks.
SWITCH_INTERVAL_S = 1e-4
# Linux' real-time priorities: the loop, and the threads that it may have to wait for because they have the interpreter.
LOOP_PRIORITY, HELPER_PRIORITY = 20, 10
THREADS = Path("/proc/self/task")


@contextmanager
def punctual() -> Iterator[None]:
    """Inside, other threads yield quickly, the garbage collector lets be what is there already, and the process runs in
    real time where the machine permits it: as root, or with ``ulimit -r``. Start other processes before."""
    switch_interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    frozen_before = gc.get_freeze_count() > 0
    gc.collect()
    gc.freeze()  # going through all that was imported takes a tenth of a second
    try:
        with _real_time():
            yield
    finally:
        if not frozen_before:
            gc.unfreeze()
        sys.setswitchinterval(switch_interval_s)


def real_time_allowed() -> bool:
    """Whether this process may run in real time; tried, and taken back at once."""
    try:
        policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(HELPER_PRIORITY))
        os.sched_setscheduler(0, policy, parameters)
    except (OSError, AttributeError):  # AttributeError: no such thing on this system
        return False
    return True


@contextmanager
def _real_time() -> Iterator[None]:
    """On Linux; elsewhere, and where it is not permitted, nothing changes."""
    threads = [int(thread.name) for thread in THREADS.iterdir()] if THREADS.exists() else []
    before = {thread: (os.sched_getscheduler(thread), os.sched_getparam(thread)) for thread in threads}
    for thread in threads:
        priority = LOOP_PRIORITY if thread == get_native_id() else HELPER_PRIORITY
        with suppress(OSError):
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
    try:
        yield
    finally:
        for thread, (policy, parameters) in before.items():
            with suppress(OSError):
                os.sched_setscheduler(thread, policy, parameters)
