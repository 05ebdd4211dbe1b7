"""What a loop in wall time asks of Python and of the machine, and gives back."""

import gc
import os
import sys
import threading

import pytest

from drivers.punctual import LOOP_PRIORITY, SWITCH_INTERVAL_S, punctual


def permitted() -> bool:
    """Whether this process may run in real time."""
    try:
        policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, policy, parameters)
    except OSError:
        return False
    return True


def test_threads_yield_quickly_inside_and_as_before_outside() -> None:
    before = sys.getswitchinterval()
    with punctual():
        assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
    assert sys.getswitchinterval() == before


def test_the_collector_leaves_alone_what_is_there_already() -> None:
    before, there_already = gc.get_freeze_count(), [object()]

    def looked_through() -> bool:
        return any(each is there_already for each in gc.get_objects())

    assert looked_through()
    with punctual():
        assert not looked_through()
    assert (gc.get_freeze_count() == 0) == (before == 0)


@pytest.mark.skipif(not permitted(), reason="this process may not run in real time")
def test_the_loop_comes_before_every_other_thread_of_the_process() -> None:
    end, identifiers = threading.Event(), []
    other = threading.Thread(target=lambda: (identifiers.append(threading.get_native_id()), end.wait()))
    other.start()
    policy = os.sched_getscheduler(0)
    try:
        with punctual():
            assert os.sched_getscheduler(0) == os.SCHED_FIFO
            assert os.sched_getparam(0).sched_priority == LOOP_PRIORITY
            assert 0 < os.sched_getparam(identifiers[0]).sched_priority < LOOP_PRIORITY
        assert os.sched_getscheduler(0) == os.sched_getscheduler(identifiers[0]) == policy
    finally:
        end.set()
        other.join()


def test_where_it_is_not_permitted_nothing_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with punctual():
        assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
