"""The table of signals says the same in all that follows from it."""

import numpy as np
import pytest

from norton_bench.records import NO_DEVICE_TIME, STREAMS, TABLES, TICK, Measured, Stream
from norton_drivers.readings import TorqueReading


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
