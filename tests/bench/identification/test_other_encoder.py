"""How great an encoder's errors are, as the other machine's encoder tells it."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.bootstrap import Readings, Simulation
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.other_encoder import _shown, with_errors_seen
from norton_bench.identification.rows import Rows
from norton_bench.identification.separable import solve
from norton_bench.identification.shape import INERTIA, STILL
from norton_bench.identification.signals import signals
from norton_bench.identification.simulated_bench import NO_ERRORS
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Bench, Truth, brief

STEP_RAD = 2 * np.pi / 16384
FINE = Bench(counts=2.0**22)


@pytest.fixture(scope="module")
def fine():
    """Both encoders as good as exact."""
    return brief(3, bench=FINE)


def rows_of(measured, band=FULL_BAND):
    return tuple(Rows(stretch, band) for stretch in signals(measured, TICK_S, Use.IDENTIFY))


def read(measured, *, noise=0.0, field_rad=0.0, name="motion", step_rad=STEP_RAD):
    """The same with an encoder of such steps, its own noise in steps, and a message that carries coarser angles."""
    table = getattr(measured, name).copy()
    noisy = table["position_rad"] + noise * step_rad * np.random.default_rng(len(name)).standard_normal(len(table))
    table["position_rad"] = np.floor(noisy / step_rad) * step_rad
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
    assert _shown(rows, 0.0).energy == pytest.approx(true_energy(rows, rows_of(fine)), rel=0.07)


def test_a_load_that_does_not_turn_with_the_shaft_or_is_not_read_throughout_tells_nothing(fine):
    coarse, load = read(fine), fine.load_motion
    still = load.copy()
    still["position_rad"] = still["position_rad"][0]
    assert _shown(rows_of(replace(coarse, load_motion=still)), 0.0) is None
    for other in (load[:0], np.concatenate([load[:5000], load[5200:]])):
        assert _shown(rows_of(replace(coarse, load_motion=other)), 0.0) is None


def seen(measured):
    """Signals, solution and what another encoder makes of them."""
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    solution = solve(stretches)
    readings = Readings(measured, TICK_S, Use.IDENTIFY)
    return stretches, solution, with_errors_seen(readings, stretches, solution)


def test_noise_behind_counts_is_found_and_undone():
    """Readings alone do not tell it: behind a noisy sensor, whose fit needs the whole band, the inertia is 12 % off."""
    noisy = brief(3, bench=replace(FINE, noise_nm=16e-3))
    coarse = read(noisy, noise=0.5, step_rad=4 * STEP_RAD)
    stretches, before, (readings, louder, after) = seen(coarse)
    band = before.regression.rows[0].kernel
    rows = rows_of(coarse, band)
    true = true_energy(rows, rows_of(noisy, band)) / assumed(rows)
    factor = louder[0].position_noise / stretches[0].position_noise
    assert true > 1.25
    assert abs(np.log(factor / true)) < 3.0 * readings.errors_known_to < 0.1
    assert abs(after.linear[INERTIA] - Truth.inertia) < 0.3 * abs(before.linear[INERTIA] - Truth.inertia)


def test_a_fine_encoder_is_taken_as_it_reads(fine):
    stretches, solution, (readings, louder, after) = seen(fine)
    assert (louder, after) == (stretches, solution)
    assert readings.errors_known_to is None


def test_errors_of_simulated_records_are_undone_by_their_true_energy(fine):
    coarse = read(fine, noise=0.5)
    stretches = signals(coarse, TICK_S, Use.IDENTIFY)
    solution = solve(stretches)
    bench = Simulation.of(Readings(coarse, TICK_S, Use.IDENTIFY), stretches, solution)
    record = bench.record(np.random.default_rng(3))
    exact = replace(bench, encoder=replace(bench.encoder, errors=NO_ERRORS)).record(np.random.default_rng(3))
    rows, perfect = (rows_of(each, solution.regression.rows[0].kernel) for each in (record, exact))
    expected = true_energy(rows, perfect) / assumed(rows)
    assert bench.noise_factor(record, tuple(each.signals for each in rows)) == pytest.approx(expected, rel=0.01)
