"""Events wait for a slow watcher: in order, none lost but parts, and those counted."""

from threading import Thread

import numpy as np
import pytest

from norton_bench.events import Note, PartMeasured
from norton_bench.identification.results import LiveEstimate
from norton_bench.records import Measured
from norton_bench.session.hosted import Mailbox


def part(number: int) -> PartMeasured:
    return PartMeasured(Measured(), LiveEstimate(number))


def test_all_is_kept_in_order_while_there_is_room() -> None:
    box = Mailbox(most_parts=3)
    events = [part(1), Note("a"), part(2), part(3), Note("b")]
    for each in events:
        box.put(each)
    assert list(box.take()) == events
    assert box.take() == ()


@pytest.mark.parametrize("count", [3, 4, 50])
def test_the_oldest_parts_are_dropped_and_counted(count: int) -> None:
    box = Mailbox(most_parts=2)
    for number in range(count):
        box.put(Note(str(number)))
        box.put(part(number))
    events = box.take()
    parts = [each for each in events if isinstance(each, PartMeasured)]
    assert [each.live.stamp_ns for each in parts] == [count - 2, count - 1]
    assert [each.dropped for each in parts] == [count - 2, 0]
    assert [each.text for each in events if isinstance(each, Note)] == [str(number) for number in range(count)]


def test_a_reader_waits_for_the_next_one_and_for_the_end() -> None:
    box, got = Mailbox(), []

    def read() -> None:
        while (event := box.wait()) is not None:
            got.append(event)

    reader = Thread(target=read)
    reader.start()
    numbers = np.arange(600)
    for number in numbers:
        box.put(part(int(number)))
    box.close()
    reader.join(5.0)
    assert not reader.is_alive()
    assert sum(1 + each.dropped for each in got if isinstance(each, PartMeasured)) == len(numbers)
