"""News wait for a slow watcher: in order, none lost but parts, and those counted."""

from threading import Thread

import numpy as np
import pytest

from norton_bench.identification.results import LiveEstimate
from norton_bench.records import Measured
from norton_bench.session.news import Mailbox, NoteNews, PartNews


def part(number: int) -> PartNews:
    return PartNews(Measured(), LiveEstimate(number))


def test_all_is_kept_in_order_while_there_is_room() -> None:
    box = Mailbox(most_parts=3)
    news = [part(1), NoteNews("a"), part(2), part(3), NoteNews("b")]
    for each in news:
        box.put(each)
    assert list(box.take()) == news
    assert box.take() == ()


@pytest.mark.parametrize("count", [3, 4, 50])
def test_the_oldest_parts_are_dropped_and_counted(count: int) -> None:
    box = Mailbox(most_parts=2)
    for number in range(count):
        box.put(NoteNews(str(number)))
        box.put(part(number))
    news = box.take()
    parts = [each for each in news if isinstance(each, PartNews)]
    assert [each.live.stamp_ns for each in parts] == [count - 2, count - 1]
    assert [each.lost for each in parts] == [count - 2, 0]
    assert [each.text for each in news if isinstance(each, NoteNews)] == [str(number) for number in range(count)]


def test_a_reader_waits_for_the_next_one_and_for_the_end() -> None:
    box, got = Mailbox(), []

    def read() -> None:
        while (news := box.wait()) is not None:
            got.append(news)

    reader = Thread(target=read)
    reader.start()
    numbers = np.arange(600)
    for number in numbers:
        box.put(part(int(number)))
    box.close()
    reader.join(5.0)
    assert not reader.is_alive()
    assert sum(1 + each.lost for each in got if isinstance(each, PartNews)) == len(numbers)
