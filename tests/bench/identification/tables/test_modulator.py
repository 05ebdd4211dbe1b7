"""Where a stiffness motor stood: at one place under each modulation, or not."""

from itertools import accumulate

import numpy as np
import pytest

from norton_bench.errors import ExperimentError
from norton_bench.identification.modulation import modulator_places
from norton_bench.records import MOTION, TICK, Measured

TICKS, COUNT_RAD = 2000, 5e-5


def measured(*stages: tuple[float, float]) -> Measured:
    """Two seconds at each modulation, at whose end the encoder stands there [rad]; on the way it takes 0.2 s."""
    ticks, motion = np.zeros(TICKS * len(stages), TICK), np.zeros(TICKS * len(stages), MOTION)
    ticks["tick_ns"] = motion["arrival_ns"] = np.arange(len(ticks)) * 1_000_000
    ticks["modulation"] = np.repeat([modulation for modulation, _ in stages], TICKS)
    places = np.repeat([place for _, place in stages], TICKS)
    lagging = np.array(list(accumulate(places, lambda at, to: at + 0.02 * (to - at), initial=0.0)))[1:]
    motion["position_rad"] = np.floor(lagging / COUNT_RAD) * COUNT_RAD
    return Measured(ticks=ticks, modulator_motion=motion)


def test_one_that_goes_where_it_is_sent_has_one_place_for_each():
    found = modulator_places(measured((0.0, 0.0), (2.0, 0.5), (4.0, 1.0), (2.0, 0.505), (0.0, 0.0)))
    assert [each.modulation for each in found.stood] == [0.0, 2.0, 4.0]
    assert [len(each.places_rad) for each in found.stood] == [2, 2, 1]
    assert found.stood[1].places_rad == pytest.approx((0.5, 0.505), abs=COUNT_RAD)
    assert found.followed


def test_one_that_slips_is_named_by_the_modulation_where_it_shows_most():
    found = modulator_places(measured((0.0, 0.0), (2.0, 0.5), (4.0, 0.9), (2.0, 0.4), (0.0, -0.05)))
    assert not found.followed
    assert found.stray is not None
    assert found.stray.modulation == 2.0
    assert found.stray.apart_rad == pytest.approx(0.1, abs=1e-3)


def test_one_at_a_stop_has_one_place_for_two_modulations():
    found = modulator_places(measured((0.0, 0.0), (2.0, 0.5), (4.0, 0.5)))
    assert found.stray is None
    assert not found.followed


def test_a_bench_without_one_has_nothing_to_tell():
    alone = measured((0.0, 0.0))
    ticks = alone.ticks.copy()
    ticks["modulation"] = np.nan
    for nothing in (Measured(ticks=ticks, modulator_motion=alone.modulator_motion), Measured(ticks=ticks), Measured()):
        with pytest.raises(ExperimentError, match="no modulation was held"):
            modulator_places(nothing)
