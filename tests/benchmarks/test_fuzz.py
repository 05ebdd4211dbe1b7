"""Every codec under a short rain of random and damaged frames and bytes, and that a bad codec would be seen."""

from random import Random

import can
import pytest

from benchmarks.fuzzing.codecs import CODECS
from benchmarks.fuzzing.frames import FrameCodec
from benchmarks.fuzzing.outcome import Judged, Outcome
from benchmarks.fuzzing.sensors_on_serial import ModbusLine
from benchmarks.fuzzing.streams import StreamCodec
from norton_drivers.codecs import modbus

COUNT = 20_000


@pytest.mark.parametrize("name", CODECS)
def test_no_exception_and_no_reading_that_was_not_sent(name):
    random, damaged = CODECS[name]().outcomes(COUNT, Random(f"1 {name}"))
    assert (random.good, damaged.good) == (True, True), (random, damaged)
    assert damaged.judged.readings > 100  # else nothing was put to the test


def outcome(wrong: int, by_chance: float = 0.0, exceptions: tuple[str, ...] = ()) -> Outcome:
    return Outcome("x", "random", 1000, "frames", Judged(100, wrong, by_chance), exceptions, "", 0.0)


def test_what_chance_allows():
    assert outcome(0).good
    assert not outcome(1).good
    assert outcome(1, by_chance=0.1).good
    assert not outcome(7, by_chance=0.1).good
    assert not outcome(0, exceptions=("ValueError()",)).good


class Deaf:
    def __init__(self, heard):
        self.heard = heard

    def hear(self, frame):
        if self.heard is None:
            raise IndexError("too short")
        return self.heard

    def close(self):
        pass


@pytest.mark.parametrize(("heard", "wrong", "raised"), [([], 25, 0), ([(1.0,)], 25, 0), ([(2.0,)], 0, 0), (None, 0, 5)])
def test_a_bad_decoder_of_frames_is_seen(heard, wrong, raised):
    def good(_random):
        return can.Message(arbitration_id=1, data=b"\0", is_extended_id=False)

    codec = FrameCodec("bad", "", (1,), good, Deaf(heard), lambda _frame: [(2.0,)])
    for result in codec.outcomes(50, Random(1)):
        assert (result.judged.wrong, len(result.exceptions)) == (wrong, raised)
        assert result.good == (heard == [(2.0,)])


def test_a_checksum_that_nobody_looks_at_is_seen(monkeypatch):
    monkeypatch.setattr(modbus, "is_sound", lambda _frame: True)
    _, damaged = StreamCodec("bad", "", ModbusLine).outcomes(COUNT, Random(1))
    assert damaged.judged.wrong > 10
    assert not damaged.good
