"""Keeps its core awake while yielding to every other process there, until the process named to it ends.

Run as a file, without the packages beside it: ``python -I -S idle_spinner.py PID``.
"""

import ctypes
import os
import signal
import sys

# Linux' <linux/prctl.h>.
SET_DEATH_SIGNAL = 1


def main(parent: int) -> None:
    """Spin until this process is killed, at the latest when its parent ends."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    libc, lock = ctypes.CDLL(None), ctypes.c_int()
    libc.prctl(SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it died before
        return
    # Waiting for a lock that is never free: in C, with the processor's own instruction for waiting.
    libc.pthread_spin_init(ctypes.byref(lock), 0)
    for _ in range(2):
        libc.pthread_spin_lock(ctypes.byref(lock))


if __name__ == "__main__":
    main(int(sys.argv[1]))
