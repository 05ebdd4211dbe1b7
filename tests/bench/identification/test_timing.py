"""Sampling instants out of arrivals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.errors import ExperimentError
from norton_bench.identification.readings import sampled_at_s, taken_late_s
from norton_bench.identification.redundancy import jumps
from norton_bench.identification.signals import instants, signals
from norton_bench.records import MOTION, NO_DEVICE_TIME, TORQUE
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, looked_at


def arrivals(taken_s, rng, delay_s=4e-4, jitter_s=1e-4):
    late = taken_s + delay_s + jitter_s * rng.uniform(-1, 1, taken_s.size)
    return np.maximum.accumulate(np.round(late * 1e9).astype(np.int64))


@given(st.integers(0, 10_000), st.floats(0.8e-3, 1.3e-3))
@settings(max_examples=20)
def test_jitter_is_undone(seed, period_s):
    rng = np.random.default_rng(seed)
    taken_s = 3.0 + np.arange(4000) * period_s
    found_s = sampled_at_s(arrivals(taken_s, rng), None, 0)
    # Uniform jitter of 100 µs has a deviation of 58 µs; a line through 4000 points takes away all but a few per cent.
    assert np.max(np.abs(found_s - taken_s - 4e-4)) < 8e-6


@given(st.integers(0, 10_000), st.floats(-200e-6, 200e-6))
@settings(max_examples=20)
def test_a_device_clock_is_put_on_the_hosts(seed, drift):
    rng = np.random.default_rng(seed)
    taken_s = np.sort(rng.uniform(0, 30, 20_000))
    own_ns = np.round(taken_s * (1 + drift) * 1e9).astype(np.int64) + 77
    found_s = sampled_at_s(arrivals(taken_s, rng), own_ns, 0)
    assert np.max(np.abs(found_s - taken_s - 4e-4)) < 8e-6


@given(st.integers(0, 10_000), st.lists(st.integers(100, 3900), min_size=1, max_size=5, unique=True))
@settings(max_examples=20)
def test_lost_readings_leave_gaps(seed, lost):
    rng = np.random.default_rng(seed)
    taken_s = np.delete(np.arange(4000) * 1e-3, lost)
    found_s = sampled_at_s(arrivals(taken_s, rng), None, 0)
    assert np.max(np.abs(found_s - taken_s - 4e-4)) < 2e-5


def test_a_stalled_host_does_not_bend_the_clock():
    rng = np.random.default_rng(1)
    taken_s = np.arange(5000) * 1e-3
    arrival_ns = arrivals(taken_s, rng)
    for start in (1000, 2500, 4000):
        # Everything of 8 ms arrives at once.
        arrival_ns[start : start + 8] = arrival_ns[start + 8]
    found_s = sampled_at_s(np.maximum.accumulate(arrival_ns), None, 0)
    assert np.max(np.abs(found_s - taken_s - 4e-4)) < 2e-5


@given(
    st.integers(0, 10_000),
    st.lists(st.integers(8, 48), min_size=1, max_size=4),
    st.lists(st.integers(0, 9), max_size=4),
    st.sets(st.integers(100, 3900), max_size=3),
)
@settings(max_examples=40)
def test_whatever_is_handed_over_late_is_not_taken_for_lost(seed, stalls, in_time_between, lost):
    rng = np.random.default_rng(seed)
    taken_s = np.arange(4000) * 1e-3
    arrival_ns = arrivals(taken_s, rng)
    start = 2000
    for count, in_time in zip(stalls, [*in_time_between, 0, 0, 0, 0], strict=False):
        arrival_ns[start : start + count] = arrival_ns[start + count]
        start += count + in_time
    kept = np.setdiff1d(np.arange(4000), sorted(lost))
    found_s = sampled_at_s(arrival_ns[kept], None, 0)
    assert np.max(np.abs(found_s - taken_s[kept] - 4e-4)) < 5e-5


def test_a_pause_of_the_stream_starts_the_count_anew():
    rng = np.random.default_rng(2)
    taken_s = np.concatenate([np.arange(2000) * 1e-3, 10.0003 + np.arange(2000) * 1e-3])
    found_s = sampled_at_s(arrivals(taken_s, rng), None, 0)
    assert np.max(np.abs(found_s - taken_s - 4e-4)) < 2e-5


def test_a_lonely_reading_after_a_pause_keeps_its_arrival():
    arrival_ns = np.concatenate([np.arange(2000), [12_000]]) * 1_000_000
    found_s = sampled_at_s(arrival_ns, None, 0)
    assert found_s[-1] == 12.0


@given(st.integers(0, 10_000), st.floats(-50e-6, 50e-6), st.sampled_from([1_000_000, 2_000_000]))
@settings(max_examples=20)
def test_stamps_tell_instants_however_long_readings_waited_for_the_loop(seed, drift, tick_ns):
    """Also where a loop of 500 Hz finds two readings at each look, of which one has waited a millisecond longer."""
    rng = np.random.default_rng(seed)
    taken_ns = np.round(np.arange(120_000) * (1 + drift) * 1e6).astype(np.int64)
    own_ns = np.arange(120_000) * 1_000_000
    found_s = sampled_at_s(looked_at(taken_ns + 400_000, rng, tick_ns=tick_ns), own_ns, 0)
    # Waits leap by any part of a tick: a line through them is up to 0.3 to 1.1 ms off.
    assert np.max(np.abs(found_s - taken_ns * 1e-9 - 4e-4)) < 1e-4


def test_stamps_that_are_far_too_early_bend_no_clock():
    """Of readings piled up behind each other whose bytes came faster than the rig file's baud rate says."""
    rng = np.random.default_rng(5)
    taken_ns = np.arange(60_000) * 1_000_000
    arrival_ns = looked_at(taken_ns + 400_000, rng)
    arrival_ns[40_000:40_018] = arrival_ns[39_999]
    found_s = sampled_at_s(arrival_ns, taken_ns, 0)
    assert np.max(np.abs(found_s - taken_ns * 1e-9 - 4e-4)) < 1e-4


def test_readings_that_wait_for_a_slow_loop_are_no_jump_of_a_clock():
    for seed in range(5):
        taken_ns = np.arange(20_000) * 5_000_000
        table = np.zeros(taken_ns.size, TORQUE)
        table["arrival_ns"] = looked_at(taken_ns + 400_000, np.random.default_rng(seed), tick_ns=5_000_000)
        table["device_ns"] = taken_ns + 77
        assert not jumps(table, "arrival_ns", int(table["arrival_ns"][-1])).size


def answered(rng, share, count=20_000, jitter_s=1e-4, count_rad=4e-4):
    """Even instants, how much longer each answer travelled, what was read, and by how much it was taken late."""
    even_s = np.arange(count) * 1e-3
    there_s, back_s = jitter_s * rng.uniform(-1, 1, (2, count))
    late_s, taken_s = (there_s + back_s, even_s + there_s) if share else (back_s, even_s)
    turned = 3.0 * np.sin(2 * np.pi * 1.3 * taken_s) + 8.0 * taken_s
    return even_s, late_s, np.round(turned / count_rad) * count_rad, taken_s - even_s


def test_answers_to_commands_tell_half_of_when_they_were_taken():
    for seed in range(5):
        even_s, late_s, value, true_s = answered(np.random.default_rng(seed), 1)
        found_s = taken_late_s(even_s, late_s, value)
        # Two ways alike: half of what both are late, which leaves half of the variance.
        np.testing.assert_allclose(found_s, 0.5 * late_s, atol=0.05 * np.max(np.abs(late_s)))
        assert np.std(found_s - true_s) < 0.75 * np.std(true_s)


def test_readings_that_come_by_themselves_are_even():
    for seed in range(20):
        even_s, late_s, value, _ = answered(np.random.default_rng(seed), 0)
        assert not taken_late_s(even_s, late_s, value).any()


def test_what_a_stalled_host_hands_over_was_taken_in_time():
    even_s, late_s, value, _ = answered(np.random.default_rng(3), 1)
    late_s[5000:5030] += np.linspace(0.03, 0.0, 30)
    found_s = taken_late_s(even_s, late_s, value)
    assert not found_s[5000:5028].any()
    assert found_s.any()


def test_a_shaft_at_rest_tells_nothing_of_instants():
    even_s, late_s, _, _ = answered(np.random.default_rng(4), 1, count=3000)
    assert not taken_late_s(even_s, late_s, np.zeros(even_s.size)).any()
    assert not taken_late_s(even_s[:5], late_s[:5], np.arange(5.0)).any()


def test_readings_of_a_drive_that_is_asked_are_placed_by_their_questions():
    """However unevenly they were asked for, and however late the loop found the answers."""
    rng = np.random.default_rng(1)
    table = np.zeros(4000, MOTION)
    asked_ns = np.cumsum(rng.choice([2_000_000, 4_000_000], 4000, p=[0.7, 0.3]))
    table["device_ns"] = asked_ns
    table["arrival_ns"] = asked_ns + 1_200_000 + rng.integers(-150_000, 150_000, 4000)
    time_s, rows = instants(table, 0)
    assert rows.size == 4000
    assert np.ptp(time_s - asked_ns * 1e-9) < 20e-6
    table["device_ns"] = NO_DEVICE_TIME
    assert np.ptp(instants(table, 0)[0] - asked_ns * 1e-9) > 1e-3, "arrivals alone do not tell"


def test_readings_that_come_in_pairs_are_told_to_be_uneven():
    """And not that nothing was recorded. Those that come as evenly as they should can only be missing."""
    measured = synthetic.experiment(1, free=False, blocked=False, multisine_s=3.0)
    motion = measured.motion.copy()
    motion["device_ns"] = np.arange(len(motion)) * 1_000_000
    motion["device_ns"][1::2] -= 700_000
    with pytest.raises(ExperimentError, match=r"readings of the actuator's motion come too unevenly .* 0.3 to 1.7 ms"):
        signals(replace(measured, motion=motion), TICK_S, Use.IDENTIFY)
    with pytest.raises(ExperimentError, match="nothing was recorded"):
        signals(measured, TICK_S, Use.CALIBRATE)
