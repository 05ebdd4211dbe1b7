"""Shared memory between loop and session: what is put there comes out as the in-process outbox would hand it on."""

from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from norton_bench.loop.devices import Arrivals
from norton_bench.loop.outbox import EVENTS, FRAME_BYTES, Outbox, SharedInbox, SharedMemory, SharedOutbox
from norton_bench.records import TABLES, TICK, Tick
from norton_bench.rig.load import load_rig
from norton_drivers.readings import CurrentReading, MotionReading, RawFrame, TorqueReading

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
PORT = "socket://localhost:7641"

stamps = st.integers(0, 2**62)
values = st.floats(allow_nan=False, width=64)
asked = st.none() | stamps
motions = st.builds(MotionReading, st.integers(0, 2**40), stamps, values, values, asked)
torques = st.builds(TorqueReading, st.integers(0, 2**40), stamps, values, asked, st.booleans())
currents = st.builds(CurrentReading, st.integers(0, 2**40), stamps, values, asked)
few = {"min_size": 1, "max_size": 3}
readings = {"motion": motions, "load_motion": motions, "torque": torques, "current": currents, "load_current": currents}
arrived = st.fixed_dictionaries({}, optional={name: st.lists(each, **few) for name, each in readings.items()})
can_frames = st.builds(
    RawFrame,
    stamps,
    st.just("can0"),
    st.booleans(),
    st.binary(max_size=FRAME_BYTES),
    st.integers(0, 2**29 - 1),
    st.booleans(),
    st.booleans(),
)
no = st.just(False)
chunks = st.builds(
    RawFrame, stamps, st.just(PORT), st.booleans(), st.binary(min_size=1, max_size=FRAME_BYTES), st.just(-1), no, no
)


def row(number: int) -> Tick:
    return cast(Tick, {name: float(number) + 0.5 if TICK[name].kind == "f" else number for name in TICK.names or ()})


@pytest.fixture(scope="module")
def memory() -> SharedMemory:
    return SharedMemory(RIG)


@pytest.mark.long
@settings(deadline=None, max_examples=60, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(ticks=st.lists(st.tuples(arrived, st.lists(can_frames | chunks, max_size=4), st.booleans()), max_size=6))
def test_it_holds_what_the_other_outbox_holds(
    memory: SharedMemory, ticks: list[tuple[Arrivals, list[RawFrame], bool]]
) -> None:
    shared, plain = SharedOutbox(memory), Outbox()
    inbox = SharedInbox(memory)
    for outbox in (shared, plain):
        outbox.put_event(7, "stop", "the guard said ∞ N m")
        for number, (arrivals, frames, waits) in enumerate(ticks):
            for frame in frames:
                outbox.put_frame(frame)
            if waits:
                outbox.put_waiting()
            outbox.put(row(number), arrivals)
    shared.hand_on()
    expected, found = plain.hand_on(), inbox.take()
    for name in (table.name for table in TABLES):
        assert getattr(found, name).dtype == getattr(expected, name).dtype
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name
        assert getattr(found, name).flags.writeable
    assert (found.frames, found.events) == (expected.frames, expected.events)
    assert inbox.lost == 0
    assert not inbox.take().frames


def test_long_chunks_are_split_and_long_words_cut(memory: SharedMemory) -> None:
    outbox, inbox = SharedOutbox(memory), SharedInbox(memory)
    data = bytes(range(256))
    outbox.put_frame(RawFrame(5, PORT, sent=False, data=data))
    outbox.put_event(6, "drive", "é" * 900)
    outbox.hand_on()
    found = inbox.take()
    assert b"".join(frame.data for frame in found.frames) == data
    assert {(frame.stamp_ns, frame.channel, frame.arbitration_id) for frame in found.frames} == {(5, PORT, -1)}
    assert found.events[0].text == "é" * 500


def test_a_session_that_looks_away_too_long_loses_the_oldest_and_knows_how_many() -> None:
    memory = SharedMemory(RIG)
    outbox, inbox = SharedOutbox(memory), SharedInbox(memory)
    for number in range(EVENTS + 10):
        outbox.put_event(number, "bus", str(number))
    found = inbox.take()
    assert [event.stamp_ns for event in found.events] == list(range(11, EVENTS + 10))
    assert inbox.lost == 11
    slots = memory.tables["ticks"].slots
    for number in range(slots + 5):
        outbox.put(row(number), {})
    assert np.array_equal(inbox.take().ticks["tick_ns"], np.arange(6, slots + 5))
    assert inbox.lost == 17
