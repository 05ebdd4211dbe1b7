"""The table of signals says the same in all that follows from it."""

import numpy as np
import pytest

from norton_bench.records import NO_DEVICE_TIME, STREAMS, TABLES, TICK, Measured, Stream, has_device_clock
from norton_drivers.readings import CurrentReading, MotionReading, TorqueReading


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_a_line_fits_its_kind(stream: Stream) -> None:
    columns = stream.kind.columns.names or ()
    assert {"arrival_ns", "sequence", *(each.column for each in stream.kind.quantities)} <= set(columns)
    assert not stream.age or stream.age in (TICK.names or ())
    assert stream.kind.take.startswith("take_")
    assert getattr(Measured(), stream.name).dtype == stream.kind.columns


def test_names_and_topics_are_taken_once() -> None:
    for field in ("name", "topic"):
        values = [getattr(table, field) for table in TABLES]
        assert len(set(values)) == len(values)


def test_a_sensor_without_a_clock_is_recorded_as_such() -> None:
    (torques,) = [stream.kind for stream in STREAMS if stream.name == "torque"]
    row = np.array([torques.row(TorqueReading(7, 400, 1.5)), torques.row(TorqueReading(8, 500, 2.5, 77, valid=False))])
    table = np.array([tuple(each) for each in row], torques.columns)
    assert list(table["device_ns"]) == [NO_DEVICE_TIME, 77]
    assert list(table["sequence"]) == [7, 8]
    assert list(table["valid"]) == [True, False]


def test_a_drive_that_is_asked_tells_the_instants_of_its_questions() -> None:
    kinds = {stream.name: stream.kind for stream in STREAMS}
    rows = [MotionReading(0, 400, 1.5, 2.5), MotionReading(1, 500, 1.5, 2.5, 77)]
    motion = np.array([tuple(kinds["motion"].row(each)) for each in rows], kinds["motion"].columns)
    assert list(motion["device_ns"]) == [NO_DEVICE_TIME, 77]
    assert not has_device_clock(motion)
    assert has_device_clock(motion[1:])
    current = np.array([tuple(kinds["current"].row(CurrentReading(3, 400, 1.5, 77)))], kinds["current"].columns)
    assert current[0].tolist() == (400, 3, 1.5, 77)
    assert has_device_clock(np.zeros(3, kinds["motion"].columns)), "a clock may stand at zero"
