"""What a loop is compared with, on the same CPU at the same time: cyclictest, or a stand-in for it."""

import ctypes
import json
import os
import signal
import subprocess
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager

import numpy as np

PEER_PRIORITY = 90
GREATEST_US = 200_000
SHARE = "share"  # of the rounds that there should have been
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}

Late = Mapping[str, float]  # [µs] by percentile, and the share of rounds


def late(late_us: "np.ndarray[tuple[int], np.dtype[np.float64]]", period_us: float) -> Late:
    missed = np.sum(np.maximum(late_us, 0.0) // period_us)
    found = {name: float(np.percentile(late_us, percent)) for name, percent in PERCENTILES.items()}
    return {**found, SHARE: float(len(late_us) / (len(late_us) + missed))}


class Peer(ABC):
    """Something to compare with."""

    name = ""

    @abstractmethod
    def beside(self, rate_hz: int, seconds: float, cpu: int) -> AbstractContextManager[Callable[[], Late]]:
        """Inside, it runs on ``cpu`` for so long; what it yields waits for its end and says how late it was."""


class Nobody(Peer):
    """The loop has its CPU for itself."""

    @contextmanager
    def beside(self, rate_hz: int, seconds: float, cpu: int) -> Iterator[Callable[[], Late]]:
        yield dict


class Cyclictest(Peer):
    """Debian's rt-tests: clock_nanosleep to absolute deadlines, in C.

    With ``--laptop`` it leaves the CPUs their idle states, as the loop does. Without, no CPU ever rests while it runs
    (/dev/cpu_dma_latency), and the host of a virtual machine takes that amiss: it then freezes both loops for 10 ms
    five times a second.
    """

    name = "cyclictest"

    @contextmanager
    def beside(self, rate_hz: int, seconds: float, cpu: int) -> Iterator[Callable[[], Late]]:
        interval_us = round(1e6 / rate_hz)
        command = f"cyclictest -q -m --laptop -t 1 -a {cpu} -p {PEER_PRIORITY} -i {interval_us} -h {GREATEST_US}"
        command += f" -l {round(seconds * rate_hz)}"
        with subprocess.Popen(command.split(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            try:
                yield lambda: _histogram(process.communicate()[0], interval_us)
            finally:
                process.terminate()


def _histogram(printed: str, interval_us: float) -> Late:
    """Lines of "microseconds count"; the greatest stands in a comment, where it is beyond the histogram."""
    rows = [line.split() for line in printed.splitlines() if line[:1].isdigit()]
    counts = np.array([[int(cell) for cell in row[:2]] for row in rows])
    found = dict(late(np.repeat(counts[:, 0], counts[:, 1]), interval_us))
    found["max"] = float(next(line for line in printed.splitlines() if line.startswith("# Max L")).split()[-1])
    return found


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class Nanosleep(Peer):
    """The same in Python, for machines without it."""

    name = "clock_nanosleep from Python"

    @contextmanager
    def beside(self, rate_hz: int, seconds: float, cpu: int) -> Iterator[Callable[[], Late]]:
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.write(write, json.dumps(_sleep_on(rate_hz, seconds, cpu)).encode())
            os._exit(0)
        os.close(write)

        def finish() -> Late:
            with os.fdopen(read) as printed:
                found: Late = json.loads(printed.read())
            return found

        try:
            yield finish
        finally:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _sleep_on(rate_hz: int, seconds: float, cpu: int) -> Late:
    os.sched_setaffinity(0, {cpu})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PEER_PRIORITY))
    libc, interval_ns = ctypes.CDLL(None), round(1e9 / rate_hz)
    late_ns = np.empty(round(seconds * rate_hz))
    deadline_ns = time.monotonic_ns()
    for index in range(len(late_ns)):
        deadline_ns += interval_ns
        until = _Timespec(*divmod(deadline_ns, 1_000_000_000))
        libc.clock_nanosleep(1, 1, ctypes.byref(until), None)  # CLOCK_MONOTONIC, TIMER_ABSTIME
        late_ns[index] = time.monotonic_ns() - deadline_ns
        deadline_ns += int(late_ns[index] // interval_ns) * interval_ns
    return late(late_ns * 1e-3, interval_ns * 1e-3)
