"""What a loop in a process of its own sees of its session, and that no order is lost between looking and waiting."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pytest

from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.loop.orders import Idle, LeaveError, Run
from norton_bench.loop.session_watch import LOOK_NS, SILENT_NS, Pulse, SessionWatch
from norton_bench.procedures.makers import coasting
from norton_bench.segments import Use
from norton_bench.testing.world import ScriptedClock


@dataclass
class LatePipe:
    """What the session says arrives just after one has given up waiting for it, once."""

    loop: "Connection[Any, Any]"
    session: "Connection[Any, Any]"
    late: list[Any] = field(default_factory=list)

    def poll(self, timeout_s: float = 0.0) -> bool:
        if not self.late:
            return self.loop.poll(timeout_s)
        self.session.send(self.late.pop())
        return False

    def fileno(self) -> int:
        return self.loop.fileno()

    def recv(self) -> Any:
        return self.loop.recv()


@dataclass(frozen=True)
class Watched:
    watch: SessionWatch
    pipe: LatePipe
    clock: ScriptedClock


@pytest.fixture
def watched() -> Iterator[Watched]:
    loop, session = Pipe()
    pipe, clock, pulse = LatePipe(loop, session), ScriptedClock(), Pulse()
    pulse.view()[0] = clock.ns
    with loop, session:
        yield Watched(SessionWatch(pulse, pipe, clock), pipe, clock)  # type: ignore[arg-type]


def test_an_order_that_comes_just_after_the_wait_for_it_is_carried_out(watched: Watched) -> None:
    watched.pipe.late.append(Run(coasting("test", "push", Use.PREPARE, np.zeros(10))))
    order = watched.watch.next_order(LOOK_NS)
    assert isinstance(order, Run)
    assert order.segment.name == "push"


def test_during_a_segment_what_the_session_says_ends_it(watched: Watched) -> None:
    watched.watch.look()
    why = ExperimentError("not enough")
    watched.pipe.session.send(Idle(why))
    watched.watch.look()  # the pipe was looked at just now
    watched.clock.ns += LOOK_NS
    with pytest.raises(LeaveError) as left:
        watched.watch.look()
    assert str(left.value.idle.error) == "not enough"


def test_a_session_that_does_not_say_how_to_go_on_is_not_waited_for(watched: Watched) -> None:
    watched.clock.ns += LOOK_NS
    assert watched.watch.next_order(-1) is None


LOOKS: dict[str, Callable[[SessionWatch], object]] = {
    "during a segment": lambda watch: watch.look(),
    "between two": lambda watch: watch.next_order(LOOK_NS),
}


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_a_session_without_a_heartbeat_is_gone(watched: Watched, look: Callable[[SessionWatch], object]) -> None:
    watched.clock.ns += SILENT_NS + 1
    with pytest.raises(SafetyStopError, match="has not been heard for 1000 ms") as gone:
        look(watched.watch)
    assert gone.value.by == "session"


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_a_session_that_has_hung_up_is_gone(watched: Watched, look: Callable[[SessionWatch], object]) -> None:
    watched.pipe.session.close()
    with pytest.raises(SafetyStopError, match="process has died"):
        look(watched.watch)
