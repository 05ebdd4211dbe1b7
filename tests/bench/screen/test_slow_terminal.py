"""Whether the terminal keeps up is told by Textual's own writer: frames are left out where it does not."""

from io import StringIO
from types import SimpleNamespace

import pytest
from textual.drivers._writer_thread import WriterThread

from norton_bench.screen.keyboard import MOST_UNWRITTEN, keeps_up


@pytest.mark.parametrize(("unwritten", "keeps"), [(0, True), (MOST_UNWRITTEN, True), (MOST_UNWRITTEN + 1, False)])
def test_more_than_a_few_unwritten_frames_are_too_many(unwritten, keeps):
    writer = WriterThread(StringIO())  # never started: a terminal that takes nothing
    for frame in range(unwritten):
        writer.write(f"frame {frame}")
    assert keeps_up(SimpleNamespace(_writer_thread=writer)) is keeps


def test_a_driver_that_writes_at_once_keeps_up():
    assert keeps_up(SimpleNamespace(_writer_thread=None))
    assert keeps_up(object())
