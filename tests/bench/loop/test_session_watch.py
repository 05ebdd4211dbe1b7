"""What a loop in a process of its own sees of its session, and that no order is lost between looking and waiting."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pytest

from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.loop.orders import (
    LOOK_NS,
    SILENT_NS,
    Idle,
    LeaveError,
    PieceReader,
    Pulse,
    Run,
    SessionWatch,
    send_in_pieces,
)
from norton_bench.procedures.waves import coasting
from norton_bench.segments import Use
from norton_bench.testing.world import ScriptedClock


@dataclass(frozen=True)
class Watched:
    watch: SessionWatch
    session: "Connection[Any, Any]"
    clock: ScriptedClock


@pytest.fixture
def watched() -> Iterator[Watched]:
    loop, session = Pipe()
    clock, pulse = ScriptedClock(), Pulse()
    pulse.view()[0] = clock.ns
    with loop, session:
        yield Watched(SessionWatch(pulse, PieceReader(loop), clock), session, clock)


def test_between_two_segments_the_next_order_is_seen_and_read(watched: Watched) -> None:
    assert not watched.watch.ordered()
    send_in_pieces(watched.session, Run(coasting("test", "push", Use.PREPARE, np.zeros(10))))
    watched.clock.ns += LOOK_NS
    watched.watch.look()  # no segment runs, of which it could want no more
    assert watched.watch.ordered()
    order = watched.watch.read()
    assert isinstance(order, Run)
    assert order.segment.name == "push"


def test_during_a_segment_what_the_session_says_ends_it(watched: Watched) -> None:
    with watched.watch.segment():
        watched.watch.look()
        why = ExperimentError("not enough")
        send_in_pieces(watched.session, Idle(why))
        watched.watch.look()  # the pipe was looked at just now
        watched.clock.ns += LOOK_NS
        with pytest.raises(LeaveError) as left:
            watched.watch.look()
    assert str(left.value.idle.error) == "not enough"


def look_within_a_segment(watch: SessionWatch) -> None:
    with watch.segment():
        watch.look()


def look_between_two(watch: SessionWatch) -> None:
    if watch.ordered():
        watch.read()


LOOKS: dict[str, Callable[[SessionWatch], object]] = {
    "during a segment": look_within_a_segment,
    "between two": look_between_two,
}


def test_during_a_segment_a_session_without_a_heartbeat_is_gone(watched: Watched) -> None:
    watched.clock.ns += SILENT_NS + 1
    with pytest.raises(SafetyStopError, match="has not been heard for 1000 ms") as gone:
        look_within_a_segment(watched.watch)
    assert gone.value.by == "session"


def test_between_two_segments_a_session_may_compute(watched: Watched) -> None:
    watched.clock.ns += SILENT_NS + 1
    watched.watch.look()
    assert not watched.watch.ordered()


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_a_session_that_has_hung_up_is_gone(watched: Watched, look: Callable[[SessionWatch], object]) -> None:
    watched.session.close()
    with pytest.raises(SafetyStopError, match="process has died"):
        look(watched.watch)
