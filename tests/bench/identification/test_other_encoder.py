"""How great an encoder's errors are, as the other machine's encoder tells it."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.other_encoder import position_noise_factor, with_errors_seen
from norton_bench.identification.regression import Regression
from norton_bench.identification.rows import Rows
from norton_bench.identification.shape import STILL
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Bench, brief

STEP_RAD = 2 * np.pi / 16384
FINE = Bench(counts=2.0**22)


@pytest.fixture(scope="module")
def fine():
    """Both encoders as good as exact."""
    return brief(3, bench=FINE)


def rows_of(measured):
    return tuple(Rows(stretch, FULL_BAND) for stretch in signals(measured, TICK_S, Use.IDENTIFY))


def read(measured, *, noise=0.0, field_rad=0.0, name="motion"):
    """The same with an encoder of STEP_RAD, its own noise in steps, and a message that carries coarser angles."""
    table = getattr(measured, name).copy()
    noisy = table["position_rad"] + noise * STEP_RAD * np.random.default_rng(len(name)).standard_normal(len(table))
    table["position_rad"] = np.floor(noisy / STEP_RAD) * STEP_RAD
    if field_rad:
        table["position_rad"] = np.round(table["position_rad"] / field_rad) * field_rad
    return replace(measured, **{name: table})


def true_energy(rows, fine):
    """What the errors are, against what the same machine's better encoder read at the same instants."""
    differences = [
        (each.kinematics(STILL)[1] - other.kinematics(STILL)[1])[each.usable]
        for each, other in zip(rows, fine, strict=True)
    ]
    return np.mean(np.concatenate(differences) ** 2)


def assumed(rows):
    return np.average([each.motion_noise(2) for each in rows], weights=[each.usable.size for each in rows])


@pytest.mark.parametrize("other", ["fine", "coarse"])
@pytest.mark.parametrize(
    "errors",
    [{}, {"noise": 0.5}, {"noise": 2.0}, {"field_rad": 1.6 * STEP_RAD}],
    ids=["counts", "noise behind counts", "noise", "counted twice"],
)
def test_the_energy_of_its_errors_is_the_true_one_whatever_they_come_from(fine, errors, other):
    coarse = read(fine, **errors)
    if other == "coarse":
        coarse = read(coarse, name="load_motion", noise=1.0)
    rows = rows_of(coarse)
    true = true_energy(rows, rows_of(fine))
    assert position_noise_factor(rows) * assumed(rows) == pytest.approx(true, rel=0.07)


def test_noise_behind_counts_is_more_than_readings_alone_tell_and_the_regression_has_it(fine):
    coarse = read(fine, noise=0.5)
    rows = rows_of(coarse)
    assert assumed(rows) < 0.8 * true_energy(rows, rows_of(fine))
    regression = Regression.of(signals(coarse, TICK_S, Use.IDENTIFY), FULL_BAND)
    expected = position_noise_factor(rows) * rows[0].signals.position_noise
    assert regression.rows[0].signals.position_noise == expected > rows[0].signals.position_noise


def test_of_a_fine_encoder_it_tells_nothing_that_matters(fine):
    """The twist of the shaft between both is known less well than such errors are great."""
    rows = rows_of(fine)
    accelerations = np.concatenate([each.kinematics(STILL)[1][each.usable] for each in rows])
    change = (position_noise_factor(rows) - 1.0) * assumed(rows)
    assert abs(change) < 1e-4 * np.mean(accelerations**2)


def test_a_load_that_does_not_turn_with_the_shaft_tells_nothing(fine):
    still = fine.load_motion.copy()
    still["position_rad"] = still["position_rad"][0]
    assert position_noise_factor(rows_of(read(replace(fine, load_motion=still)))) == 1.0


def test_without_a_load_or_where_its_readings_have_a_gap_the_rows_stay_as_they_are(fine):
    coarse, load = read(fine), fine.load_motion
    gap = np.concatenate([load[:5000], load[5200:]])
    for other in (load[:0], gap):
        rows = rows_of(replace(coarse, load_motion=other))
        assert all(each.signals.other_rad is None for each in rows)
        assert with_errors_seen(rows) is rows
