"""Who reads a message in pieces never waits for who writes it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any

import pytest

from norton_bench.loop.orders import MORE, PIECE_BYTES, PieceReader, send_in_pieces

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
