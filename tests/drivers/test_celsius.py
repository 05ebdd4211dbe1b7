"""A temperature probe against a scripted line: which numbers are believed, and when they were complete."""

import pytest

from norton_drivers.celsius import BAUD, CelsiusProbe, open_temperature_sensor
from norton_drivers.errors import DeviceTimeoutError, WiringError

BYTE_NS = 10e9 / BAUD


@pytest.fixture
def open_probe(world, device):
    def opened(**options: object) -> CelsiusProbe:
        return open_temperature_sensor(device("temperature_sensor", "celsius", **options), world.link())

    return opened


def test_numbers_become_readings_with_the_time_of_their_line(world, open_probe) -> None:
    probe = open_probe()
    world.line.arriving = b".3\n23.41\n-0.5\n1e1\n"
    probe._link.poll()
    readings = probe.take_temperature()
    assert [(reading.sequence, reading.temperature_c) for reading in readings] == [(0, -0.5), (1, 10.0)]
    assert [world.clock.ns - reading.arrival_ns for reading in readings] == pytest.approx([4 * BYTE_NS, 0], abs=1)
    assert probe.take_temperature() == []
    assert probe.malformed == 0


def test_the_field_of_a_line_that_has_several(world, open_probe) -> None:
    probe = open_probe(separator=",", field=2, unit=" C")
    world.line.arriving = b"\n45.0,21.0 C\n45.1,21.5 C\n45.2,21.6\n45.2,21.7 C\n45.2,21.8 C\n"
    probe._link.poll()
    assert [reading.temperature_c for reading in probe.take_temperature()] == [21.5, 21.8]
    assert probe.malformed == 1


def test_who_it_is_is_known_by_a_number(world, open_probe) -> None:
    probe = open_probe()
    world.line.arriving = b"\n23.4\n23.5\n"
    assert probe.identify().driver == "celsius"
    world.line.arriving = b"hot\n"
    with pytest.raises(
        DeviceTimeoutError,
        match=r"\[temperature_sensor\] probe on fake: no number in 3 s \(1 lines that are none, the last 'hot'\); "
        "check power, port, baud 9600, and unit, separator and field in the rig file",
    ):
        probe.identify()


def test_a_wrong_option_is_refused(open_probe) -> None:
    with pytest.raises(WiringError, match=r"\[temperature_sensor\] field = 0"):
        open_probe(field=0)
