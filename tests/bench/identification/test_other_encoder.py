"""How great an encoder's errors are, as the other machine's encoder tells it."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification import other_encoder
from norton_bench.identification.bootstrap import Readings, Simulation, scatter_of, stated_energy
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.motor_values import PHYSICAL, physical
from norton_bench.identification.other_encoder import (
    counts_energy,
    errors_of_simulated,
    matters,
    shown_energy,
    with_errors_seen,
)
from norton_bench.identification.reading_errors import NO_ERRORS
from norton_bench.identification.rows import Rows
from norton_bench.identification.sanity_checks import failed_checks
from norton_bench.identification.separable import solve
from norton_bench.identification.shape import STILL
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Bench, Truth, brief

STEP_RAD = 2 * np.pi / 16384
FINE = Bench(counts=2.0**22)
INERTIA = PHYSICAL.index("inertia")
# The fit of a noisy sensor's torque needs the whole band, in which counts are most of what the acceleration shows.
NOISY = replace(FINE, noise_nm=16e-3)
HIDING = {"noise": 0.5, "step_rad": 4 * STEP_RAD}


@pytest.fixture(scope="module")
def fine():
    """Both encoders as good as exact."""
    return brief(3, bench=FINE)


@pytest.fixture(scope="module")
def noisy():
    return brief(3, bench=NOISY)


@pytest.fixture(scope="module")
def hiding(noisy):
    """Noise of half a count behind the counts: measured, signals and solution."""
    measured = read(noisy, **HIDING)
    stretches = stretches_of(measured)
    return measured, stretches, solve(stretches)


def stretches_of(measured):
    return signals(measured, TICK_S, Use.IDENTIFY)


def read(measured, *, noise=0.0, field_rad=0.0, turns_rad=0.0, name="motion", step_rad=STEP_RAD):
    """The same with an encoder of such steps, its own noise in steps, a message that carries coarser angles, and an
    error that goes with the angle, once a turn."""
    table = getattr(measured, name).copy()
    angle = table["position_rad"]
    noisy = angle + noise * step_rad * np.random.default_rng(len(name)).standard_normal(len(table))
    noisy = noisy + turns_rad * np.cos(angle + 1.0)
    table["position_rad"] = np.floor(noisy / step_rad) * step_rad
    if field_rad:
        table["position_rad"] = np.round(table["position_rad"] / field_rad) * field_rad
    return replace(measured, **{name: table})


def true_energy(measured, fine, band=FULL_BAND):
    """What the errors are, against what the same machine's better encoder read at the same instants."""
    differences = []
    for each, other in zip(stretches_of(measured), stretches_of(fine), strict=True):
        rows, exact = Rows(each, band), Rows(other, band)
        differences.append((rows.kinematics(STILL)[1] - exact.kinematics(STILL)[1])[rows.usable])
    return float(np.mean(np.concatenate(differences) ** 2))


def shown(measured):
    return shown_energy(stretches_of(measured), measured.load_motion, STILL, FULL_BAND)


def readings_of(measured, **more):
    return Readings(measured, TICK_S, Use.IDENTIFY, **more)


@pytest.mark.parametrize("other", [{}, {"noise": 1.0}, {"turns_rad": 0.01}], ids=["fine", "coarse", "eccentric"])
@pytest.mark.parametrize(
    "errors",
    [{}, {"noise": 0.5}, {"noise": 2.0}, {"field_rad": 1.6 * STEP_RAD}],
    ids=["counts", "noise behind counts", "noise", "counted twice"],
)
def test_the_energy_of_its_errors_is_the_true_one_whatever_they_come_from(fine, errors, other):
    coarse = read(fine, **errors)
    if other:
        coarse = read(coarse, name="load_motion", **other)
    found = shown(coarse)
    assert found.energy == pytest.approx(true_energy(coarse, fine), rel=0.07)
    assert found.compliance_rad_nm == pytest.approx(1.0 / FINE.stiffness, rel=0.2)


def test_a_load_that_turns_otherwise_or_is_read_too_seldom_tells_nothing(fine):
    coarse, load = read(fine), fine.load_motion
    still = load.copy()
    still["position_rad"] = still["position_rad"][0]
    gap = np.concatenate([load[:5000], load[5200:]])
    at_once = load[:200].copy()
    at_once["arrival_ns"] = at_once["arrival_ns"][0]
    assert shown(coarse) is not None
    for other in (still, gap, load[:0], load[:1], at_once, load[::3]):
        assert shown(replace(coarse, load_motion=other)) is None


def test_a_load_whose_clock_wanders_shows_it(fine):
    late = fine.load_motion.copy()
    late["arrival_ns"] += (2e6 * np.sin(2 * np.pi * np.arange(len(late)) / 5000)).astype(np.int64)
    # The clock that is recovered from the arrivals does not follow them: the readings seem 2 ms early and late.
    nothing = np.zeros(0)
    spring = Coupling(FINE.stiffness, 1.0, 0.01, 0.01, 1.2e-4, 1.0, 1000.0, 0.0, nothing, nothing)
    steady, wandering = (shown(read(each)) for each in (fine, replace(fine, load_motion=late)))
    true = true_energy(read(fine), fine)
    for each, least, most in ((steady, 0.0, 0.05), (wandering, 0.1, 0.5)):
        doubt = each.doubt(readings_of(fine, coupling=spring))
        assert least * true < doubt < most * true
        assert abs(each.energy - true) < max(2.0 * doubt, 0.07 * true)


@pytest.mark.long
def test_noise_behind_counts_is_found_and_undone(noisy, hiding):
    """Readings alone do not tell it: the inertia is 12 % off."""
    measured, stretches, before = hiding
    readings, louder, after = with_errors_seen(readings_of(measured), stretches, before)
    seen, band = readings.errors_seen, before.regression.rows[0].kernel
    true = true_energy(measured, noisy, band) / stated_energy(stretches, band)
    assert true > 1.25
    assert abs(np.log(seen.factor / true)) < 3.0 * seen.known_to < 0.1
    assert louder[0].position_noise == seen.factor * stretches[0].position_noise
    was, now = (physical(each)[0][INERTIA] - Truth.inertia for each in (before, after))
    assert abs(now) < 0.3 * abs(was)
    assert seen.moved[INERTIA] == now - was


@pytest.mark.long
@pytest.mark.parametrize(
    ("bench", "errors"),
    [
        pytest.param(FINE, {"step_rad": 2 * np.pi / 2**19}, id="errors that do not matter"),
        pytest.param(replace(FINE, noise_nm=4e-3), HIDING, id="errors that it cannot tell"),
    ],
)
def test_otherwise_the_readings_are_taken_as_they_are(bench, errors):
    measured = read(brief(3, bench=bench), **errors)
    stretches = stretches_of(measured)
    solution = solve(stretches)
    readings, same, after = with_errors_seen(readings_of(measured), stretches, solution)
    assert (same, after) == (stretches, solution)
    assert readings.errors_seen is None
    assert counts_energy(stretches, FULL_BAND) > 0.0
    assert matters(solution) == (errors is HIDING)


def test_errors_that_are_greater_later_are_no_change_of_the_machine():
    """They are undone as they are on average: the inertia of either half is off by that, and the machine the same."""
    measured = brief(5, bench=NOISY)
    table, later = (read(measured, step_rad=4 * STEP_RAD, noise=noise).motion for noise in (0.0, 0.6))
    half = len(table) // 2
    table[half:] = later[half:]
    solution = solve(stretches_of(replace(measured, motion=table)))
    values, covariance = physical(solution)
    assert failed_checks(solution, values, np.sqrt(np.diag(covariance)), TICK_S) == ()


@pytest.mark.long
def test_a_spring_that_is_not_the_calibrated_one_is_not_believed(hiding):
    measured, stretches, solution = hiding
    nothing, known_to = np.zeros(0), []
    for stiffness in (FINE.stiffness, 0.4 * FINE.stiffness, 0.1 * FINE.stiffness):
        spring = Coupling(stiffness, 1.0, 0.01, 0.01, 1.2e-4, 1.0, 1000.0, 0.0, nothing, nothing)
        readings, _, _ = with_errors_seen(readings_of(measured, coupling=spring), stretches, solution)
        known_to.append(None if readings.errors_seen is None else readings.errors_seen.known_to)
    assert known_to[0] < 0.5 * known_to[1]
    assert known_to[2] is None


def test_counts_of_both_that_err_alike_are_seen_in_simulated_records(fine):
    """The same counts on both: in slow motion each reads what the other does."""
    same = read(read(fine, step_rad=16 * STEP_RAD), name="load_motion", step_rad=16 * STEP_RAD)
    stretches = stretches_of(same)
    solution = solve(stretches)
    bench = Simulation.of(readings_of(same, draws=4), stretches, solution)
    compliance = 1.0 / FINE.stiffness
    counts = counts_energy(stretches, solution.regression.rows[0].kernel)
    assert np.std(errors_of_simulated(bench.with_load(compliance))) > 0.1 * counts


def test_what_simulated_records_are_wrong_by_is_taken_off(hiding, monkeypatch):
    measured, stretches, solution = hiding
    stated = stated_energy(stretches, solution.regression.rows[0].kernel)
    scatter, factors = 1e-3 * np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0]), []
    for off in (0.0, 0.2):
        wrong = (off + scatter) * stated
        monkeypatch.setattr(other_encoder, "errors_of_simulated", lambda bench, wrong=wrong: wrong)
        factors.append(with_errors_seen(readings_of(measured), stretches, solution)[0].errors_seen.factor)
    assert factors[0] - factors[1] == pytest.approx(0.2, rel=0.05)


def test_a_simulated_load_is_twisted_by_the_torque(fine):
    stretches = stretches_of(fine)
    solution = solve(stretches)
    bench = Simulation.of(readings_of(fine), stretches, solution)
    record = bench.with_load(0.05).record(np.random.default_rng(3))
    found = shown_energy(stretches_of(record), record.load_motion, solution.shape, FULL_BAND)
    assert found.compliance_rad_nm == pytest.approx(0.05, rel=0.01)


@pytest.mark.long
def test_errors_of_simulated_records_are_undone_by_their_true_energy(hiding):
    """Each as well as the real one: not knowing it widens."""
    measured, stretches, before = hiding
    bench = Simulation.of(readings_of(measured, draws=6), stretches, before)
    record = bench.record(np.random.default_rng(3))
    exact = replace(bench, encoder=replace(bench.encoder, errors=NO_ERRORS)).record(np.random.default_rng(3))
    expected = true_energy(record, exact, before.regression.rows[0].kernel)
    assert bench.error_energy(record, stretches_of(record)) == pytest.approx(expected, rel=0.01)

    seen = with_errors_seen(readings_of(measured, draws=6), stretches, before)[0].errors_seen
    spread = []
    for known_to in (0.0, 0.3):
        readings = readings_of(measured, draws=6, errors_seen=replace(seen, known_to=known_to))
        scatter = scatter_of(Simulation.of(readings, stretches, before), physical(before)[0], physical)
        spread.append(scatter.std[INERTIA])
    assert spread[1] > 2.0 * spread[0]
