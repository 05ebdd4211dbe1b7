"""Measurements to record: made up from a seed, with every column different."""

from collections.abc import Callable

import numpy as np
import pytest

from norton_bench.records import (
    CURRENT,
    MOTION,
    NO_DEVICE_TIME,
    TEMPERATURE,
    TICK,
    TORQUE,
    Event,
    Measured,
    SegmentInfo,
)
from norton_bench.segments import Use
from norton_drivers.readings import RawFrame

TICK_NS = 1_000_000
START_NS = 3_000_000_000_000


def filled(dtype: np.dtype, first: int, count: int, rng: np.random.Generator) -> np.ndarray:
    table = np.zeros(count, dtype)
    for name in dtype.names or ():
        kind = dtype[name].kind
        if name in ("tick_ns", "arrival_ns"):
            table[name] = START_NS + (first + np.arange(count)) * TICK_NS
        elif name == "sequence":
            table[name] = first + np.arange(count)
        elif kind == "f":
            table[name] = rng.normal(size=count)
        elif kind == "b":
            table[name] = rng.random(count) < 0.5
        else:
            table[name] = rng.integers(0, 1000, count)
    return table


def make_part(first: int, count: int = 100, seed: int = 0) -> Measured:
    """``count`` ticks from the ``first`` on, with NaN, a sensor without a clock, odd frames and a growing segment."""
    rng = np.random.default_rng([seed, first])
    ticks = filled(TICK, first, count, rng)
    ticks["position_rad"][::7] = np.nan
    torque = filled(TORQUE, first, count, rng)
    torque["device_ns"][::2] = NO_DEVICE_TIME
    frames = tuple(
        RawFrame(
            START_NS + (first + tick) * TICK_NS + slot,
            channel,
            slot == 1,
            rng.bytes(length),
            arbitration_id,
            extended=slot == 1,
            remote=length == 0,
        )
        for tick in range(count)
        for slot, (channel, arbitration_id, length) in enumerate(
            [("can0", 0x29, 8), ("can0", 0x1ABCDEFF, 0), ("/dev/ttyUSB0", -1, int(rng.integers(1, 300)))]
        )
    )
    start_ns, end_ns = START_NS, START_NS + (first + count) * TICK_NS
    return Measured(
        ticks=ticks,
        motion=filled(MOTION, first, count, rng),
        load_motion=filled(MOTION, first, count, rng),
        torque=torque,
        current=filled(CURRENT, first, count // 2, rng),
        load_current=filled(CURRENT, first, count // 3, rng),
        modulator_motion=filled(MOTION, first, count, rng),
        modulator_current=filled(CURRENT, first, count // 4, rng),
        temperature=filled(TEMPERATURE, first, count // 5, rng),
        segments=(SegmentInfo(0, "free", "staircase rising", Use.IDENTIFY, "admittance", start_ns, end_ns, True),),
        events=(Event(start_ns + first * TICK_NS, "note", f"part at {first} · µ"),),
        frames=frames,
    )


@pytest.fixture
def part() -> Callable[..., Measured]:
    return make_part
