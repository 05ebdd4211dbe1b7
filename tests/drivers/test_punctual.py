"""What a loop in wall time asks of Python and of the machine, and gives back."""

import gc
import os
import resource

import pytest

from norton_drivers import punctual as module
from norton_drivers.punctual import LOOP_PRIORITY, SERVER_PRIORITY, permitted_priority, punctual, settled_memory


def test_the_collector_leaves_alone_what_is_there_already() -> None:
    before, there_already = gc.get_freeze_count(), [object()]

    def looked_through() -> bool:
        return any(each is there_already for each in gc.get_objects())

    assert looked_through()
    with punctual(LOOP_PRIORITY):
        assert not looked_through()
    assert (gc.get_freeze_count() == 0) == (before == 0)


@pytest.mark.skipif(not permitted_priority(1), reason="this process may not run in real time")
def test_inside_is_real_time_and_outside_is_not() -> None:
    policy = os.sched_getscheduler(0)
    with punctual(SERVER_PRIORITY):
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
        assert os.sched_getparam(0).sched_priority == SERVER_PRIORITY
    assert os.sched_getscheduler(0) == policy


def test_where_it_is_not_permitted_nothing_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert permitted_priority(LOOP_PRIORITY) == 0
    policy = os.sched_getscheduler(0)
    with punctual(LOOP_PRIORITY):
        assert os.sched_getscheduler(0) == policy


def test_a_system_that_permits_less_gives_what_it_permits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_permitted", lambda priority: priority <= 20)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 20))
    assert permitted_priority(LOOP_PRIORITY) == 20
    assert permitted_priority(10) == 10


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
    with settled_memory():
        assert gc.get_freeze_count() > 0
    assert gc.get_freeze_count() == 0


@pytest.mark.usefixtures("unfrozen")
def test_within_another_it_is_left_to_the_outer_one() -> None:
    with settled_memory():
        with settled_memory():
            pass
        assert gc.get_freeze_count() > 0
