"""What keeps a loop in wall time on time, as far as Python and the machine allow.

Real-time priority, locked memory, and a core of its own that never sleeps. A core that slept, even for 50 µs, takes two
to three times as long for what comes next: its caches are cold, and on a virtual machine another guest may have run
there meanwhile. A loop that spins from tick to tick would starve everything else on its core, and Linux stops real-time
processes that never sleep. So a second process of the lowest priority keeps the core awake
(:mod:`norton_drivers.idle_spinner`).
"""

import ctypes
import gc
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from norton_drivers import idle_spinner

if sys.platform == "linux":
    import resource

# Linux' real-time priorities, of 99. A loop comes before all that a system runs by default, and after its watchdogs;
# what it talks to, where that is served on the same machine, comes after the loop.
LOOP_PRIORITY, SERVER_PRIORITY = 80, 20


# What keeps a loop in wall time on time, as far as Python and the machine allow.
@contextmanager
def in_real_time(priority: int) -> Iterator[None]:
    """Inside, garbage is frozen, and this thread runs in real time where the machine permits it: as root, or
    with ``ulimit -r``.
    """
    with frozen_garbage(), _real_time(permitted_priority(priority)):
        yield


@contextmanager
def frozen_garbage() -> Iterator[None]:
    """Inside, the garbage collector ignores what exists already: looking through it takes 0.1 s each time."""
    frozen_before = gc.get_freeze_count() > 0
    gc.collect(1)  # what was left over lately would stay for as long; what is older was looked through before
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


if sys.platform == "linux":
    import resource

# Linux' <sys/mman.h> and <linux/prctl.h>.
LOCK_CURRENT, LOCK_FUTURE = 1, 2
SET_TIMER_SLACK = 29


# What a process that is nothing but a loop takes from the machine for as long as it lives, where it may.
@dataclass(frozen=True)
class ProcessSetup:
    """What the system granted, in a few words, and a sentence with the remedy for each thing it refused.

    ``core`` is the number of the process' own core; None where it shares all.
    """

    words: str
    notes: tuple[str, ...] = ()
    core: int | None = None


def prepare_process(core: int | None) -> ProcessSetup:
    """Lock this process' memory and wake it up without slack. It may have a core of its own already.

    Whether it may run in real time is only looked at: :func:`in_real_time` takes the priority while it counts.
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
    return ProcessSetup(", ".join(had), tuple(missed), core)


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


@dataclass(frozen=True)
class OwnCore:
    """A core that no other loop of this machine takes while ``claim`` is open: also a killed process closes it."""

    number: int
    claim: socket.socket


def take_core() -> OwnCore | None:
    """Bind this thread, and those it starts, to the last core that it may use and that no other loop has taken.

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
    """Applies to every thread there is; new threads inherit it from the thread that starts them."""
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # a thread may end meanwhile
            cores = os.sched_getaffinity(int(task.name)) - {core}
            os.sched_setaffinity(int(task.name), cores | {core} if allowed or not cores else cores)


@contextmanager
def kept_awake(core: int | None) -> Iterator[None]:
    """Inside, this thread's own core never sleeps; nothing where it has none, or where that cannot be."""
    if sys.platform != "linux" or core is None:
        yield
        return
    with ExitStack() as stack:
        with suppress(OSError):  # where no process can be started, the core sleeps as others do
            stack.enter_context(_spinner())
        yield


@contextmanager
def _spinner() -> Iterator[None]:
    """A process, not a thread: when a loop is killed, a thread of the lowest priority would end last."""
    with subprocess.Popen(
        [sys.executable, "-I", "-S", idle_spinner.__file__, str(os.getpid())],
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
