"""Readings with which a drive answers commands, placed by the commands."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.identification.cleaning import clean, placed_by_commands
from norton_bench.identification.readings import LATE_READINGS
from norton_bench.identification.signals import instants
from norton_bench.records import MOTION, NO_DEVICE_TIME, Chain, has_device_clock
from tests.bench.identification import synthetic

TICK_NS = 1_000_000
COUNT = 60_000


def commands(rng, count=COUNT):
    return np.arange(count) * TICK_NS + rng.integers(200_000, 260_000, count)


def answers(commanded_ns, late_ns):
    table = np.zeros(commanded_ns.size, MOTION)
    table["arrival_ns"] = np.maximum.accumulate(commanded_ns + late_ns)
    table["device_ns"] = NO_DEVICE_TIME
    return table


def wandering_ns(rng, count=COUNT, most_ns=250_000, least_ns=300_000):
    """Of answers that wait for a system which looks for them at a rate of its own."""
    return least_ns + (np.arange(count) * 9) % most_ns + rng.integers(0, 30_000, count)


def placed_at_ns(table, commanded_ns):
    placed = placed_by_commands(table, commanded_ns)
    assert has_device_clock(placed)
    return placed["device_ns"]


def test_answers_that_wait_longer_and_longer_bend_no_clock():
    rng = np.random.default_rng(1)
    commanded_ns = commands(rng)
    table = answers(commanded_ns, wandering_ns(rng))
    np.testing.assert_array_equal(placed_at_ns(table, commanded_ns), commanded_ns)
    time_s, _ = instants(placed_by_commands(table, commanded_ns), 0)
    assert np.ptp(time_s - commanded_ns * 1e-9) < 20e-6
    unplaced_s, _ = instants(table, 0)
    assert np.ptp(unplaced_s - commanded_ns * 1e-9) > 100e-6, "arrivals alone do not tell"


@given(st.integers(0, 10_000), st.sets(st.integers(100, 5900), max_size=20), st.integers(0, 90_000_000))
@settings(max_examples=20, deadline=None)
def test_lost_answers_and_stalls_move_no_others(seed, lost, stall_ns):
    rng = np.random.default_rng(seed)
    commanded_ns = commands(rng, 6000)
    late_ns = wandering_ns(rng, 6000)
    late_ns[3000] += stall_ns
    kept = np.array(sorted(set(range(6000)) - lost))
    table = answers(commanded_ns, late_ns)[kept]
    wrong = placed_at_ns(table, commanded_ns) != commanded_ns[kept]
    assert not wrong[np.abs(kept - 3000) > LATE_READINGS].any()
    if not lost:
        assert not wrong.any(), "what was handed over at once answers one command each"


@pytest.mark.parametrize("ticks", [1, 2])
def test_answers_longer_than_a_tick_stay_together(ticks):
    rng = np.random.default_rng(ticks)
    commanded_ns = commands(rng)
    table = answers(commanded_ns, wandering_ns(rng) + ticks * TICK_NS - 400_000)
    placed = np.searchsorted(commanded_ns, placed_at_ns(table, commanded_ns))
    # The last ones are answers to commands that were not recorded.
    assert np.ptp((placed - np.arange(COUNT))[: -2 * LATE_READINGS]) == 0, "all by as many ticks: that is a delay"


def test_a_second_answer_to_one_command_moves_few_others():
    rng = np.random.default_rng(3)
    commanded_ns = commands(rng, 6000)
    rows = np.sort(np.append(np.arange(6000), 3000))
    table = answers(commanded_ns, wandering_ns(rng, 6000))[rows]
    wrong = placed_at_ns(table, commanded_ns) != commanded_ns[rows]
    assert not wrong[np.abs(rows - 3000) > LATE_READINGS].any()


def test_what_answers_no_commands_stays_as_it_is():
    rng = np.random.default_rng(4)
    table = answers(np.arange(COUNT) * 1_013_000, rng.integers(0, 30_000, COUNT))
    assert placed_by_commands(table, commands(rng)) is table


def test_only_drives_that_answer_commands_are_placed_by_them():
    measured = synthetic.experiment(1, free=False, blocked=False, multisine_s=3.0)
    assert not has_device_clock(clean(measured).measured.motion)
    answering = replace(measured, chain=Chain(answers_commands=frozenset({"actuator"})))
    cleaned = clean(answering).measured
    assert has_device_clock(cleaned.motion)
    assert has_device_clock(cleaned.current)
    assert not has_device_clock(cleaned.load_motion)
