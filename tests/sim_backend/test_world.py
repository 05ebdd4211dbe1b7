"""Events happen in order, wires delay without overtaking, and bytes take their time."""

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_sim.connectors import ByteStream, Delay
from norton_sim.world import World

MS = 1_000_000


class Recorder:
    """Stands for the plant: remembers how far it was moved."""

    def __init__(self) -> None:
        self.now_ns = 0

    def advance(self, to_ns: int) -> None:
        assert to_ns >= self.now_ns
        self.now_ns = to_ns


@pytest.fixture
def world() -> World:
    return World(Recorder())  # type: ignore[arg-type]


@given(st.lists(st.integers(0, 50), max_size=30))
def test_events_happen_in_order_of_time_and_then_of_asking(stamps: list[int]) -> None:
    world, seen = World(Recorder()), []  # type: ignore[arg-type]
    for index, stamp in enumerate(stamps):
        world.at(stamp, lambda now, index=index: seen.append((now, index)))
    world.advance(50)
    assert seen == sorted((stamp, index) for index, stamp in enumerate(stamps))


def test_the_plant_stands_at_the_event_and_then_at_the_end(world: World) -> None:
    seen = []
    world.at(7, lambda _: seen.append((world.now_ns, world.plant.now_ns)))
    world.advance(10)
    assert seen == [(7, 7)]
    assert (world.now_ns, world.plant.now_ns) == (10, 10)


def test_a_cycle_keeps_its_period_and_sees_events_planned_meanwhile(world: World) -> None:
    seen = []
    world.every(
        10, lambda now: (seen.append(("cycle", now)), world.at(now, lambda n: seen.append(("once", n)))), first_ns=3
    )
    world.advance(25)
    assert seen == [("cycle", 3), ("once", 3), ("cycle", 13), ("once", 13), ("cycle", 23), ("once", 23)]
    assert world.next_event_ns == 33


def test_the_past_is_left_alone(world: World) -> None:
    seen = []
    world.advance(100)
    world.at(5, seen.append)
    world.advance(50)
    assert world.now_ns == 100
    world.advance(100)
    assert seen == [100]


@given(st.integers(0, 10_000), st.integers(0, 20_000), st.lists(st.integers(0, 5_000), min_size=1, max_size=50))
def test_nothing_overtakes_and_nothing_arrives_before_it_was_sent(delay: int, jitter: int, gaps: list[int]) -> None:
    wire = Delay(delay, jitter, Random(0))
    sent = np.cumsum(gaps)
    arrived = np.array([wire.arrival_ns(int(stamp)) for stamp in sent])
    assert (np.diff(arrived) >= 0).all()
    assert (arrived >= sent).all()
    # What a frame waits for its predecessors is no longer than their own travel.
    assert (arrived <= np.maximum.accumulate(sent + delay + jitter)).all()


def test_delay_and_jitter_are_what_they_say() -> None:
    wire, count = Delay(250_000, 50_000, Random(1)), 4000
    travel = np.array([wire.arrival_ns(k * MS) - k * MS for k in range(count)])
    # Uniform within ± jitter: standard deviation jitter / sqrt 3; the mean within four of its own deviations.
    spread = 50_000 / np.sqrt(3)
    assert travel.mean() == pytest.approx(250_000, abs=4 * spread / np.sqrt(count))
    assert travel.std() == pytest.approx(spread, rel=0.05)
    assert abs(travel - 250_000).max() <= 50_000


@given(
    bursts=st.lists(st.binary(min_size=1, max_size=40), max_size=10),
    looks=st.lists(st.integers(0, 300_000), max_size=60),
    sizes=st.integers(1, 50),
)
def test_bytes_come_out_once_in_order_however_they_are_read(bursts: list[bytes], looks: list[int], sizes: int) -> None:
    stream = ByteStream(460_800, Delay(100_000, 50_000, Random(2)))
    for k, burst in enumerate(bursts):
        stream.send(k * 500_000, burst)
    got, now = bytearray(), 0
    for step in [*looks, 10**9, *[0] * 500]:
        now += step
        while piece := stream.take(min(sizes, stream.waiting(now)), now):
            assert stream.last_arrival_ns <= now
            got += piece
    assert bytes(got) == b"".join(bursts)


def test_a_byte_takes_ten_bits_of_time() -> None:
    stream = ByteStream(115_200, Delay(0, 0, Random(3)))
    stream.send(0, bytes(576))
    stream.send(0, bytes(576))  # follows the first: 1152 bytes are a tenth of a second
    assert stream.waiting(50 * MS - 10) == 575
    assert len(stream.take(1000, 50 * MS)) == 576
    assert stream.last_arrival_ns == 50 * MS
    assert stream.take(1000, 100 * MS - 10) == bytes(575)
    assert stream.take(1000, 100 * MS) == bytes(1)
    assert stream.last_arrival_ns == 100 * MS
    assert stream.take(1000, 200 * MS) == b""
