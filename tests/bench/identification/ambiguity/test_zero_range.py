"""Gaps of known width, in loops through springs, contacts and backlash."""

import numpy as np
import pytest

from norton_bench.identification.conditions import zero_range
from norton_bench.identification.rows import align
from norton_bench.identification.signals import FINE, Signals
from norton_bench.records import SegmentInfo
from norton_bench.segments import Use

TICK_S, COUNT, NOISE_NM = 1e-3, 3000, 6e-4
LOOP = SegmentInfo(0, "imposed", "loop 20 mrad", Use.IDENTIFY, "admittance", 0, COUNT * 1_000_000)


def loop(exertion, amplitude_rad=0.02, seed=2):
    """A port that exerts ``exertion(position, velocity)``, moved at 2 Hz, with a sensor's noise."""
    fine_s = np.arange(COUNT * FINE) * TICK_S / FINE
    position = amplitude_rad * np.sin(2 * np.pi * 2 * fine_s)
    velocity = np.gradient(position, TICK_S / FINE)
    torque = exertion(position, velocity)[::FINE] + 1e-3 * np.random.default_rng(seed).normal(size=COUNT)
    usable = np.zeros(COUNT, dtype=bool)
    usable[100:-100] = True
    signals = Signals(
        tick_s=TICK_S,
        origin_ns=0,
        time_s=np.arange(COUNT) * TICK_S,
        position_rad=position,
        path_rad=position,
        sent_s=np.arange(COUNT) * TICK_S,
        command=np.zeros(COUNT),
        segment=np.zeros(COUNT, dtype=np.int64),
        usable=usable,
        rests=np.empty(0, dtype=np.int64),
        torque_nm=torque,
    )
    return align((signals,), 0.0)


def found_in(exertion):
    return zero_range(loop(exertion), (LOOP,), inertia_kgm2=0.0, bias_nm=0.0, noise_nm=NOISE_NM)


def dahl(position, velocity):
    """The contact of a motor: 20 mN m, 10 N m/rad."""
    torque = np.zeros(position.size)
    for k in range(1, position.size):
        step = position[k] - position[k - 1]
        end = 0.02 * np.sign(step)
        torque[k] = end + (torque[k - 1] - end) * np.exp(-10 / 0.02 * abs(step))
    return -torque


@pytest.mark.parametrize("exertion", [lambda x, v: -10.0 * x, dahl])
def test_what_crosses_zero_is_no_gap(exertion):
    found = found_in(exertion)
    assert not found.is_gap
    assert found.width_rad < 0.3e-3
    assert found.strokes >= 8


@pytest.mark.parametrize("gap_rad", [2e-3, 10e-3])
def test_backlash_is_found_with_its_width(gap_rad):
    found = found_in(lambda x, v: -20.0 * np.sign(x) * np.maximum(np.abs(x) - gap_rad / 2, 0.0))
    assert found.is_gap
    assert found.width_rad == pytest.approx(gap_rad, rel=0.05)
    assert found.interval_rad[0] <= found.width_rad <= found.interval_rad[1]


def test_loops_that_never_go_well_through_zero_tell_nothing():
    assert found_in(lambda x, v: 0.0 * x) is None


def test_inertia_is_no_exertion_of_the_gap():
    def exertion(x, v):
        return -20.0 * np.sign(x) * np.maximum(np.abs(x) - 5e-3, 0.0) - 4e-3 * np.gradient(v, TICK_S / FINE)

    found = zero_range(loop(exertion), (LOOP,), inertia_kgm2=4e-3, bias_nm=0.0, noise_nm=NOISE_NM)
    assert found.width_rad == pytest.approx(10e-3, rel=0.05)
