"""What a loop in wall time asks of Python and of the machine, and gives back."""

import gc
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from norton_drivers import real_time as module
from norton_drivers.real_time import (
    LOOP_PRIORITY,
    SERVER_PRIORITY,
    frozen_garbage,
    in_real_time,
    kept_awake,
    permitted_priority,
    prepare_process,
    staying_off,
    take_core,
)
from tests.processes import children, cpu_ticks, process_lives, soon


def test_the_collector_leaves_alone_what_is_there_already() -> None:
    before, there_already = gc.get_freeze_count(), [object()]

    def looked_through() -> bool:
        return any(each is there_already for each in gc.get_objects())

    assert looked_through()
    with in_real_time(LOOP_PRIORITY):
        assert not looked_through()
    assert (gc.get_freeze_count() == 0) == (before == 0)


@pytest.mark.skipif(not permitted_priority(1), reason="this process may not run in real time")
def test_inside_is_real_time_and_outside_is_not() -> None:
    policy = os.sched_getscheduler(0)
    with in_real_time(SERVER_PRIORITY):
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
        assert os.sched_getparam(0).sched_priority == SERVER_PRIORITY
    assert os.sched_getscheduler(0) == policy


def test_where_it_is_not_permitted_nothing_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert permitted_priority(LOOP_PRIORITY) == 0
    policy = os.sched_getscheduler(0)
    with in_real_time(LOOP_PRIORITY):
        assert os.sched_getscheduler(0) == policy


def test_a_system_that_permits_less_gives_what_it_permits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_permitted", lambda priority: priority <= 20)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 20))
    assert permitted_priority(LOOP_PRIORITY) == 20
    assert permitted_priority(10) == 10


# In a process of its own: what is taken is taken for good.
SETTLE = """
import os
from norton_drivers.real_time import prepare_process
settled = prepare_process(3)
locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck"))
print(int(locked.split()[1]) > 0, settled.words, settled.notes, sep="|")
"""


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="root on Linux is allowed everything")
def test_where_all_is_allowed_it_is_taken() -> None:
    said = subprocess.run([sys.executable, "-c", SETTLE], capture_output=True, text=True, check=True).stdout
    locked, words, notes = said.strip().split("|")
    assert locked == "True"
    assert words.startswith("in a process of its own, real-time priority 80, memory locked, core 3")
    assert notes == "()"


def test_what_is_not_allowed_is_said_in_a_sentence_with_the_mend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "permitted_priority", lambda _: 0)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 << 20, 8 << 20))
    settled = prepare_process(None)
    assert settled.words == "in a process of its own"
    assert settled.core is None
    real_time, memory = settled.notes
    assert "may not run in real time" in real_time
    assert "rtprio 80" in real_time
    assert "memlock unlimited" in memory


pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="only Linux binds threads to cores"),
    pytest.mark.skipif(not hasattr(os, "sched_getaffinity") or len(os.sched_getaffinity(0)) < 2, reason="needs two"),
]

# In a process of its own: it says which core it took, and has it until its standard input is closed.
TAKE = """
import os, sys
from norton_drivers.real_time import take_core
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
    with kept_awake(max(before)), staying_off(max(before)):
        assert os.sched_getaffinity(0) == before


def test_a_core_that_may_not_be_had_is_left_free(two: set[int], monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError("Invalid argument")

    with monkeypatch.context() as patch:
        patch.setattr(os, "sched_setaffinity", refused)
        patch.setattr(os, "sched_getaffinity", lambda _: two)
        assert take_core() is None
    with taking(two) as (_, said):
        assert said.startswith(f"{max(two)} ")


def test_a_thread_that_has_no_other_core_stays_where_it_is() -> None:
    def bound() -> None:
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})
        with staying_off(core):
            seen.append(os.sched_getaffinity(0) == {core})

    seen: list[bool] = []
    thread = threading.Thread(target=bound)
    thread.start()
    thread.join()
    assert seen == [True]


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


# Bound to one core, it keeps that awake, and waits for a line before it goes on, or for its end.
KEEP = """
import os, sys
from norton_drivers.real_time import kept_awake
core = max(os.sched_getaffinity(0))
os.sched_setaffinity(0, {core})
with kept_awake(core):
    print(flush=True)
    sys.stdin.readline()
print(flush=True)
sys.stdin.readline()
"""
# Giving way to everybody may take its time on a machine that is busy.
WITHIN_S = 20.0


@contextmanager
def keeping() -> Iterator[tuple[subprocess.Popen[str], int]]:
    with subprocess.Popen([sys.executable, "-c", KEEP], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as it:
        assert it.stdout is not None
        it.stdout.readline()
        (spinner,) = children(it.pid)
        yield it, spinner
        it.kill()


@pytest.mark.long
def test_somebody_stays_awake_who_gives_way_to_everybody() -> None:
    with keeping() as (loop, spinner):
        soon(lambda: os.sched_getscheduler(spinner) == os.SCHED_IDLE, WITHIN_S)
        assert len(os.sched_getaffinity(spinner)) == 1
        before = cpu_ticks(spinner)
        soon(lambda: cpu_ticks(spinner) > before + 5, WITHIN_S)
        assert loop.stdin is not None
        assert loop.stdout is not None
        print(file=loop.stdin, flush=True)
        loop.stdout.readline()
        assert children(loop.pid) == []


@pytest.mark.long
def test_of_a_loop_that_is_killed_nobody_is_left_awake() -> None:
    with keeping() as (loop, spinner):
        soon(lambda: cpu_ticks(spinner) > 5, WITHIN_S)
        loop.kill()
        soon(lambda: not process_lives(spinner), WITHIN_S)


def test_who_has_no_core_of_his_own_keeps_none_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the machine has but one, which is everybody's."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    monkeypatch.setattr(subprocess, "Popen", None)
    with kept_awake(None):
        pass


def test_where_no_process_can_be_started_the_loop_does_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr(subprocess, "Popen", refused)
    with kept_awake(0):
        pass
    with pytest.raises(PermissionError, match="of the loop"), kept_awake(0):
        raise PermissionError("what goes wrong inside is of the loop")


@pytest.fixture
def unfrozen():
    """The suite freezes what it has imported; a program begins with nothing frozen."""
    was_frozen = gc.get_freeze_count() > 0
    gc.unfreeze()
    yield
    if was_frozen:
        gc.freeze()


@pytest.mark.usefixtures("unfrozen")
def test_afterwards_the_collector_looks_through_everything_again() -> None:
    with frozen_garbage():
        assert gc.get_freeze_count() > 0
    assert gc.get_freeze_count() == 0


@pytest.mark.usefixtures("unfrozen")
def test_within_another_it_is_left_to_the_outer_one() -> None:
    with frozen_garbage():
        with frozen_garbage():
            pass
        assert gc.get_freeze_count() > 0
