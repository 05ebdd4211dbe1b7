"""The machine's cores: one for a loop alone, which others stay off and which never sleeps while the loop runs.

A core that slept, be it for 50 µs, takes two to three times as long for what comes next: its caches are cold, and in a
virtual machine somebody else may have run there meanwhile. Spinning from tick to tick would starve all others on the
core, and Linux stops real-time processes that never sleep; so a process that gives way to everybody keeps it awake.
"""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from norton_drivers import sleepless


@dataclass(frozen=True)
class OwnCore:
    """A core that no other loop of this machine takes while ``claim`` is open: also a killed process closes it."""

    number: int
    claim: socket.socket


def take_core() -> OwnCore | None:
    """Bind this thread, and those it starts, to the last core that it may use and that no other loop has.

    The first is left to everybody else: None where there is no other, or the system knows no such thing.
    """
    if sys.platform != "linux":
        return None
    for number in sorted(os.sched_getaffinity(0))[:0:-1]:
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0norton-bench core {number}")
            os.sched_setaffinity(0, {number})
        except OSError:
            claim.close()
            continue
        return OwnCore(number, claim)
    return None


@contextmanager
def staying_off(core: int | None) -> Iterator[None]:
    """Inside, no thread of this process runs on ``core``, nor does any process that it starts."""
    if core is None or sys.platform != "linux":
        yield
        return
    _allow(core, allowed=False)
    try:
        yield
    finally:
        _allow(core, allowed=True)


def _allow(core: int, *, allowed: bool) -> None:
    """For every thread there is; those to come do as the one that starts them."""
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # a thread may end meanwhile
            cores = os.sched_getaffinity(int(task.name)) - {core}
            os.sched_setaffinity(int(task.name), cores | {core} if allowed or not cores else cores)


@contextmanager
def kept_awake() -> Iterator[None]:
    """Inside, the core that this thread is bound to never sleeps; nothing where it is bound to none, or cannot be."""
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) > 1:
        yield
        return
    with ExitStack() as stack:
        with suppress(OSError):  # where no process can be started, the core sleeps as others do
            stack.enter_context(_sleepless())
        yield


@contextmanager
def _sleepless() -> Iterator[None]:
    """A process, not a thread: of a loop that is killed, what gives way to everybody would be the last to go."""
    with subprocess.Popen(
        [sys.executable, "-I", "-S", sleepless.__file__, str(os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        process_group=0,  # Ctrl-C is not meant for it
    ) as process:
        try:
            yield
        finally:
            with suppress(OSError):  # up again is not everybody's right; it then takes longer to go
                os.sched_setscheduler(process.pid, os.SCHED_OTHER, os.sched_param(0))
            process.kill()
