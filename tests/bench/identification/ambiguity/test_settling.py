"""How a made-up port settles: against time constants, oscillations and noise that are known."""

import numpy as np
import pytest

from norton_bench.identification.source_map import settling
from norton_bench.records import MOTION, TICK, Measured, SegmentInfo
from norton_bench.segments import Use

TICK_NS, DWELL = 1_000_000, 400
LEVELS = np.repeat(np.concatenate([np.linspace(-0.08, 0.08, 11), np.linspace(0.08, -0.08, 11)[1:]]), DWELL)


def staircase(velocity_of, noise_rad_s=1.0, seed=1):
    """Readings of a port whose velocity, at each tick, is ``velocity_of`` (command, ticks since the step, before)."""
    rng, velocity = np.random.default_rng(seed), np.zeros(LEVELS.size)
    for k in range(1, LEVELS.size):
        velocity[k] = velocity_of(LEVELS[k], k % DWELL, velocity[k - 1])
    ticks, motion = np.zeros(LEVELS.size, TICK), np.zeros(LEVELS.size, MOTION)
    ticks["tick_ns"] = motion["arrival_ns"] = np.arange(LEVELS.size) * TICK_NS
    ticks["command"] = LEVELS
    motion["position_rad"] = np.cumsum(velocity + noise_rad_s * rng.normal(size=LEVELS.size)) * 1e-3
    whole = SegmentInfo(0, "free", "staircase rising", Use.IDENTIFY, "admittance", 0, LEVELS.size * TICK_NS)
    return Measured(ticks=ticks, motion=motion, segments=(whole,))


@pytest.mark.parametrize("time_s", [0.03, 0.05, 0.1])
def test_a_first_order_approach_is_found_with_its_time_constant(time_s):
    found = settling(staircase(lambda c, _, before: before + (600 * c - before) * 1e-3 / time_s))
    assert found.time_s == pytest.approx(time_s, rel=0.1)
    assert found.time_interval_s[0] <= found.time_s <= found.time_interval_s[1]
    assert found.left < 0.15
    assert found.steps == 21


def test_a_faster_port_has_settled_at_once():
    found = settling(staircase(lambda c, _, __: 600 * c))
    assert found.time_s <= 0.01
    assert found.left_interval[1] < 0.05


def test_a_port_that_hunts_does_not_settle():
    found = settling(staircase(lambda c, k, _: 600 * c + 20 * np.sin(2 * np.pi * k / 190)))
    assert found.left_interval[0] > 0.3


def test_a_port_that_runs_away_does_not_settle():
    found = settling(staircase(lambda c, k, _: 600 * c + 5 * np.exp(k / 100)))
    assert found.left_interval[0] > 0.3


def test_without_a_staircase_there_is_nothing_to_say():
    assert settling(Measured()) is None
