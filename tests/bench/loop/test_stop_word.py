"""The operator's stop across processes."""

import multiprocessing
import os
import signal
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.loop.stop_word import LONGEST_REASON_BYTES, NO_REASON, StopWord

SPAWN = multiprocessing.get_context("spawn")


def test_nothing_is_heard_until_it_is_said_and_the_first_reason_stays():
    word = StopWord()
    assert word.heard() is None
    word.say("space")
    word.say("Ctrl-C")
    assert word.heard() == "space"


@pytest.mark.parametrize("reason", ["", "\0", "\0space"])
def test_a_stop_without_words_is_a_stop(reason):
    word = StopWord()
    word.say(reason)
    assert word.heard() == NO_REASON


@settings(deadline=None, max_examples=50)
@given(st.text(max_size=400))
def test_what_is_heard_is_what_was_said_or_its_beginning(reason):
    word = StopWord()
    word.say(reason)
    spoken = reason.encode(errors="replace").decode().partition("\0")[0]
    heard = word.heard()
    assert heard is not None
    assert heard == (spoken or NO_REASON) if len(spoken.encode()) <= LONGEST_REASON_BYTES else spoken.startswith(heard)
    assert len(heard.encode()) <= LONGEST_REASON_BYTES


def test_it_is_said_in_one_process_and_heard_in_another():
    word = StopWord()
    child = SPAWN.Process(target=word.say, args=("from the screen",))
    child.start()
    child.join(30.0)
    assert word.heard() == "from the screen"


def test_of_several_processes_one_is_heard_whole():
    word = StopWord()
    reasons = [letter * 200 for letter in "abcd"]
    children = [SPAWN.Process(target=word.say, args=(reason,)) for reason in reasons]
    for child in children:
        child.start()
    for child in children:
        child.join(30.0)
    assert word.heard() in reasons


@pytest.mark.skipif(os.name != "posix", reason="signals to oneself")
def test_a_signal_handler_may_say_it_in_the_middle_of_another_word():
    word = StopWord()
    before = signal.signal(signal.SIGUSR1, lambda *_: word.say("from a handler"))
    try:
        for _ in range(200):
            os.kill(os.getpid(), signal.SIGUSR1)
            word.say("from the program")
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert word.heard() in {"from a handler", "from the program"}


def test_listening_is_cheap():
    word = StopWord()
    begun = time.perf_counter()
    for _ in range(10_000):
        word.heard()
    assert time.perf_counter() - begun < 0.1  # 10 µs each would be too much; it takes about 0.2
