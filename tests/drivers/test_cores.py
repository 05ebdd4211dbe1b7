"""A core for a loop alone: taken once, left by the others, and awake for as long as it counts."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.cores import kept_awake, staying_off, take_core

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="only Linux binds threads to cores"),
    pytest.mark.skipif(not hasattr(os, "sched_getaffinity") or len(os.sched_getaffinity(0)) < 2, reason="needs two"),
]

# In a process of its own: it says which core it took, and has it until its standard input is closed.
TAKE = """
import os, sys
from drivers.cores import take_core
core = take_core()
print(None if core is None else core.number, sorted(os.sched_getaffinity(0)), flush=True)
sys.stdin.read()
"""


@contextmanager
def taking(cores: set[int]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process that may use ``cores`` and takes one, and what it says of that."""
    with subprocess.Popen(
        [sys.executable, "-c", TAKE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: os.sched_setaffinity(0, cores),  # noqa: PLW1509  (no threads here)
    ) as process:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
        process.kill()


@pytest.fixture
def two() -> Iterator[set[int]]:
    """Two cores of which nobody else has one: this machine's loops are told of by their claims."""
    cores = sorted(os.sched_getaffinity(0))
    for number in cores[:0:-1]:
        with taking({cores[0], number}) as (_, said):
            free = said == f"{number} [{number}]"
        if free:
            yield {cores[0], number}
            return
    pytest.skip("another loop runs on this machine")


def test_of_two_the_last_is_taken_once_and_the_first_never(two: set[int]) -> None:
    first, last = sorted(two)
    with taking(two) as (loop, said):
        assert said == f"{last} [{last}]"
        with taking(two) as (_, other):
            assert other == f"None [{first}, {last}]"
        loop.kill()
        loop.wait()
        with taking(two) as (_, next_one):
            assert next_one == f"{last} [{last}]"


def test_a_single_core_is_everybodys() -> None:
    with taking({min(os.sched_getaffinity(0))}) as (_, said):
        assert said.startswith("None ")


def test_where_there_are_no_cores_to_be_had_none_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    before = os.sched_getaffinity(0)
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(subprocess, "Popen", None)
    assert take_core() is None
    with kept_awake(), staying_off(max(before)):
        assert os.sched_getaffinity(0) == before


def test_every_thread_stays_off_and_so_do_children() -> None:
    before = os.sched_getaffinity(0)
    core, go_on = max(before), threading.Event()
    thread = threading.Thread(target=go_on.wait)
    thread.start()
    with staying_off(core):
        assert os.sched_getaffinity(0) == before - {core}
        assert os.sched_getaffinity(thread.native_id or 0) == before - {core}
        child = subprocess.run(
            [sys.executable, "-c", "import os; print(sorted(os.sched_getaffinity(0)))"],
            capture_output=True,
            text=True,
            check=True,
        )
        assert child.stdout.strip() == str(sorted(before - {core}))
    assert os.sched_getaffinity(0) == os.sched_getaffinity(thread.native_id or 0) == before
    with staying_off(None):
        assert os.sched_getaffinity(0) == before
    go_on.set()
    thread.join()


# Bound to one core, it keeps that awake, says who does so, and waits for a line before it goes on, or for its end.
KEEP = """
import os, sys
from pathlib import Path
from drivers.cores import kept_awake
def spinners():
    tasks = Path(f"/proc/{os.getpid()}/task").iterdir()
    return " ".join((task / "children").read_text().strip() for task in tasks)
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
with kept_awake():
    print(spinners(), flush=True)
    sys.stdin.readline()
print(spinners() or "none", flush=True)
sys.stdin.readline()
"""


@contextmanager
def keeping() -> Iterator[tuple[subprocess.Popen[str], int]]:
    with subprocess.Popen([sys.executable, "-c", KEEP], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as it:
        assert it.stdout is not None
        yield it, int(it.stdout.readline())
        it.kill()


def until(happens: Callable[[], bool]) -> bool:
    """Giving way to everybody may take its time on a machine that is busy."""
    deadline_s = time.monotonic() + 20.0
    while not (happened := happens()) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    return happened


def cpu_ticks(pid: int) -> int:
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(words[11]) + int(words[12])


def test_somebody_stays_awake_who_gives_way_to_everybody() -> None:
    with keeping() as (loop, spinner):
        assert until(lambda: os.sched_getscheduler(spinner) == os.SCHED_IDLE)
        assert len(os.sched_getaffinity(spinner)) == 1
        before = cpu_ticks(spinner)
        assert until(lambda: cpu_ticks(spinner) > before + 5)
        assert loop.stdin is not None
        assert loop.stdout is not None
        print(file=loop.stdin, flush=True)
        assert loop.stdout.readline().strip() == "none"


def test_of_a_loop_that_is_killed_nobody_is_left_awake() -> None:
    with keeping() as (loop, spinner):
        assert until(lambda: cpu_ticks(spinner) > 5)
        loop.kill()
        assert until(lambda: not Path(f"/proc/{spinner}").exists() or "Z" in Path(f"/proc/{spinner}/stat").read_text())


def test_who_is_not_bound_needs_no_core_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", None)
    with kept_awake():
        assert len(os.sched_getaffinity(0)) > 1


def test_where_no_process_can_be_started_the_loop_does_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    monkeypatch.setattr(subprocess, "Popen", refused)
    with kept_awake():
        pass
    with pytest.raises(PermissionError, match="of the loop"), kept_awake():
        raise PermissionError("what goes wrong inside is of the loop")
