"""Ages count from arrival; a repeat is not a new measurement."""

from math import isnan
from typing import Any

from norton_bench.records import STREAMS
from norton_bench.sample import Alignment
from norton_drivers.readings import CurrentReading, MotionReading, TorqueReading


def test_nothing_has_arrived_yet() -> None:
    sample = Alignment().update(1_000, 1_000, {})
    assert isnan(sample.torque_nm)
    assert (sample.torque_age_ns, sample.motion_age_ns, sample.load_motion_age_ns) == (-1, -1, -1)


def test_age_grows_from_arrival_while_nothing_new_comes() -> None:
    alignment = Alignment()
    first = alignment.update(1_000, 1_000, {"motion": [MotionReading(1, 400, 1.0, 2.0)]})
    second = alignment.update(2_000, 2_000, {})
    assert (first.motion_age_ns, first.motion_new) == (600, True)
    assert (second.motion_age_ns, second.motion_new) == (1_600, False)
    assert second.position_rad == 1.0


def test_the_newest_of_several_counts_and_torque_is_tared() -> None:
    alignment = Alignment(torque_bias_nm=0.5)
    sample = alignment.update(1_000, 1_000, {"torque": [TorqueReading(1, 100, 1.0), TorqueReading(2, 900, 2.0)]})
    assert (sample.torque_nm, sample.torque_age_ns, sample.torque_count) == (1.5, 100, 2)


def test_an_invalid_torque_is_no_number() -> None:
    assert isnan(Alignment().update(1_000, 1_000, {"torque": [TorqueReading(1, 900, 2.0, valid=False)]}).torque_nm)


def test_what_arrives_while_the_tick_is_reading_is_not_from_the_future() -> None:
    assert Alignment().update(1_000, 1_000, {"motion": [MotionReading(1, 1_200, 1.0, 2.0)]}).motion_age_ns == 0


def test_currents_of_both_drives() -> None:
    alignment = Alignment()
    arrived = {"current": [CurrentReading(1, 400, 1.5)], "load_current": [CurrentReading(1, 600, -2.0)]}
    first = alignment.update(1_000, 1_000, arrived)
    second = alignment.update(2_000, 2_000, {})
    assert (first.current_a, first.current_new) == (1.5, True)
    assert (first.load_current_a, first.load_current_new) == (-2.0, True)
    assert (second.current_a, second.current_new, second.load_current_new) == (1.5, False, False)


def reading(message: str, place: int) -> Any:
    """One that no other stream has."""
    if message == "Motion":
        return MotionReading(1, 100 * place, 10.0 * place, 10.0 * place + 1)
    made = TorqueReading if message == "Torque" else CurrentReading
    return made(1, 100 * place, 10.0 * place)


def test_every_signal_of_a_sample_is_a_stream_of_the_table_and_stands_in_its_field() -> None:
    streams = {stream.name: stream.kind.message for stream in STREAMS}
    assert set(Alignment()._newest) <= set(streams)
    arrived = {name: [reading(message, place)] * place for place, (name, message) in enumerate(streams.items(), 1)}
    assert Alignment().update(1_000, 700, arrived)._asdict() == {
        "tick_ns": 1_000,
        "torque_nm": 30.0,
        "torque_age_ns": 700,
        "torque_new": True,
        "position_rad": 10.0,
        "velocity_rad_s": 11.0,
        "motion_age_ns": 900,
        "motion_new": True,
        "load_position_rad": 20.0,
        "load_velocity_rad_s": 21.0,
        "load_motion_age_ns": 800,
        "load_motion_new": True,
        "current_a": 40.0,
        "current_new": True,
        "load_current_a": 50.0,
        "load_current_new": True,
        "torque_count": 3,
        "motion_count": 1,
        "load_motion_count": 2,
        "modulator_position_rad": 60.0,
        "modulator_motion_age_ns": 400,
        "lateness_ns": 300,
    }
