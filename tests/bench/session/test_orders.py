"""The operator's orders by itself: in which order things are told."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from norton_bench.events import SessionEvent, SessionState, StateChanged
from norton_bench.loop.stop_word import StopWord
from norton_bench.session.operator import OperatorOrders, Order


@dataclass
class Scripted:
    """Gives its orders one batch at a time."""

    batches: list[list[Order]]
    stop: StopWord = field(default_factory=StopWord)
    answers: bool = True

    def orders(self) -> Sequence[Order]:
        return self.batches.pop(0) if self.batches else ()


def test_a_pause_that_is_ordered_as_another_ends_comes_last() -> None:
    """What is put away passes through the loop's parts, at each of which orders are heard."""
    events: list[SessionEvent] = []
    operator = Scripted([[Order("pause")], [], [Order("resume")], [Order("pause")]])
    orders = OperatorOrders(operator, events.append, lambda _kind, _text: orders.listen())
    orders.listen()
    orders.wait()
    assert orders.paused
    states = (SessionState.PAUSING, SessionState.PAUSED, SessionState.RUNNING, SessionState.PAUSING)
    assert events == [StateChanged(state) for state in states]
