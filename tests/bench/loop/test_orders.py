"""Orders come whole over the pipe, and a session that is gone is noticed."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any

import numpy as np
import pytest

from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.loop.orders import (
    LOOK_NS,
    MORE,
    PIECE_BYTES,
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

LONG = bytes(range(256)) * 40_000  # ten megabytes: no pipe holds them


@dataclass(frozen=True)
class Ends:
    reader: PieceReader
    far: "Connection[Any, Any]"


@pytest.fixture
def ends() -> Iterator[Ends]:
    near, far = Pipe()
    with near, far:
        yield Ends(PieceReader(near), far)


def test_messages_come_as_they_were_sent(ends: Ends) -> None:
    assert not ends.reader.ready()
    for message in ("first", bytes(3 * PIECE_BYTES), None):
        send_in_pieces(ends.far, message)
    assert ends.reader.ready()
    assert [ends.reader.read() for _ in range(3)] == ["first", bytes(3 * PIECE_BYTES), None]
    assert not ends.reader.ready()


def test_a_message_of_which_the_rest_is_late_is_not_waited_for(ends: Ends) -> None:
    writer = Thread(target=send_in_pieces, args=(ends.far, LONG))
    writer.start()
    looks = 1
    while not ends.reader.ready():
        looks += 1
        time.sleep(0.0005)
    writer.join()
    assert ends.reader.read() == LONG
    assert looks > 50  # each takes no more than a few pieces


def test_half_a_message_leaves_the_reader_free(ends: Ends) -> None:
    ends.far.send_bytes(MORE + b"half")
    assert not ends.reader.ready()
    ends.far.close()
    assert ends.reader.ready()
    with pytest.raises(EOFError):
        ends.reader.read()


def test_the_pipe_s_end_is_something_to_read(ends: Ends) -> None:
    ends.far.close()
    assert ends.reader.ready()
    with pytest.raises(EOFError):
        ends.reader.read()


# ---- The session, while the drives are enabled ----------------------------------------------------------------------


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
