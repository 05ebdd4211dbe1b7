"""Ringing between motor and load that readings fold down: it is named, and where there is none nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.bootstrap import Simulation
from norton_bench.identification.departures import departures
from norton_bench.identification.expansion import Expansion
from norton_bench.identification.model_error import folded_ringing
from norton_bench.identification.separable import solve_again
from norton_bench.identification.signals import signals
from norton_bench.identification.simulated_bench import Coupling, likeliest
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Truth

RESONANCE_HZ, LOAD_KGM2 = 1015.0, 1.2e-4
MOBILITY = 1.0 / Truth().inertia + 1.0 / LOAD_KGM2


def coupling(resonance_hz=RESONANCE_HZ):
    """The load is told three waves, in steps of a tick. The damping is far too great, as it is found where the twist
    hardly tells it."""
    stiffness = (2 * np.pi * resonance_hz) ** 2 / MOBILITY
    sent_s = np.arange(0.0, 120.0, TICK_S)
    told_nm = sum(0.05 * np.sin(2 * np.pi * frequency_hz * sent_s) for frequency_hz in (7.3, 23.1, 61.7))
    return Coupling(stiffness, 0.02 * stiffness, 0.5, 0.05, LOAD_KGM2, 1.0, 1000.0, 0.0, sent_s, told_nm)


def simulation(result, spring):
    bench = result.simulated.bench
    return replace(bench, readings=replace(bench.readings, coupling=spring))


def ringing(result, spring):
    """What is folded down of it over what was fitted."""
    bench = simulation(result, spring)
    return folded_ringing(bench, result, bench.stretches)


def shaken(experiment, result, spring):
    """The same readings of a torque that this spring has shaken."""
    bench = simulation(result, None)
    torque = experiment.torque.copy()
    for truth in bench.truths:
        own = (bench.torque.time_s >= truth.time_s[0]) & (bench.torque.time_s <= truth.time_s[-1])
        driving = truth.driving(bench.solution, spring, 0.0)
        torque["torque_nm"][own] += truth.ringing(driving, bench.solution, spring)(bench.torque.time_s[own])
    return replace(experiment, torque=torque)


def ringing_at(experiment, result, resonance_hz, ratio):
    """The equation about the same network, of readings that a spring of this resonance and damping has shaken."""
    readings = shaken(experiment, result, coupling(resonance_hz).damped(ratio, Truth().inertia))
    return Expansion.of(result, signals(readings, TICK_S, Use.IDENTIFY), ())


@pytest.mark.parametrize(("off", "ratio"), [(1.0, 0.02), (0.985, 0.05), (1.01, 0.02)])
def test_ringing_is_named_whatever_stiffness_and_damping_are_within_what_is_known(experiment, result, off, ratio):
    at = ringing_at(experiment, result, off * RESONANCE_HZ, ratio)
    found = departures(at, others=ringing(result, coupling()))
    assert found[0].kind.name == "ringing"
    assert "at some 1015 Hz, and it is read at 1000 Hz" in found[0].kind.cause


def test_where_nothing_rings_nothing_is_named(experiment, result):
    at = Expansion.of(result, signals(experiment, TICK_S, Use.IDENTIFY), ())
    assert departures(at, others=ringing(result, coupling())) == ()


def test_validation_may_follow_what_was_fitted_without_a_pause(experiment, result):
    """Both then lie in one span of time, of which each has its own samples."""
    fitted = signals(experiment, TICK_S, Use.IDENTIFY)
    half = fitted[-1].time_s > np.median(fitted[-1].time_s)
    early = (*fitted[:-1], replace(fitted[-1], usable=fitted[-1].usable & ~half))
    unseen = (replace(fitted[-1], usable=fitted[-1].usable & half),)
    bench = simulation(result, coupling()).over(unseen)
    ((_, _, columns),) = folded_ringing(bench, result, (*early, *unseen))
    assert columns.shape[1] == Expansion.of(result, early, unseen).residual.size
    assert np.all(np.any(columns != 0.0, axis=1))


@pytest.mark.parametrize("resonance_hz", [400.0, 700.0, 1300.0, 1500.0])
def test_ringing_that_is_not_folded_into_the_band_is_not_looked_for(result, resonance_hz):
    assert ringing(result, coupling(resonance_hz)) == ()


def test_without_a_calibration_no_spring_is_known(result):
    assert ringing(result, None) == ()


@pytest.mark.parametrize(("off", "ratio"), [(1.0, 0.02), (0.985, 0.06)])
def test_the_readings_tell_the_spring_where_the_calibration_does_not(experiment, result, off, ratio):
    """Its damping could be anything, and its stiffness is known to 2 %."""
    true = coupling(off * RESONANCE_HZ).damped(ratio, Truth().inertia)
    measured = shaken(experiment, result, true)
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    unsure = replace(coupling(), damping_std_nms_rad=1.0)
    readings = replace(result.simulated.bench.readings, measured=measured, coupling=unsure)
    told = Simulation.of(readings, stretches, solve_again(stretches, result.simulated.bench.solution)).readings.coupling
    assert told.stiffness_nm_rad == pytest.approx(true.stiffness_nm_rad, rel=0.01)
    assert told.damping_nms_rad == pytest.approx(true.damping_nms_rad, rel=0.2)
    assert told.damping_std_nms_rad < 0.1 * told.damping_nms_rad


def test_a_spring_that_nobody_hears_stays_as_it_was_calibrated():
    calibrated = coupling()
    assert likeliest(calibrated, Truth().inertia, lambda spring: 0.0) is calibrated


def test_what_is_heard_is_weighed_against_the_calibration():
    """Both normal: the mean of both, each by its variance, and the variances' inverses add."""
    told = replace(coupling(), damping_nms_rad=0.10, damping_std_nms_rad=0.02)
    found = likeliest(told, Truth().inertia, lambda spring: -0.5 * ((spring.damping_nms_rad - 0.14) / 0.01) ** 2)
    assert found.damping_nms_rad == pytest.approx(0.132, rel=0.01)
    assert found.damping_std_nms_rad == pytest.approx(0.02 / np.sqrt(5.0), rel=0.05)
    assert found.stiffness_nm_rad == pytest.approx(told.stiffness_nm_rad, rel=0.002)
    assert found.stiffness_std_nm_rad == pytest.approx(told.stiffness_std_nm_rad, rel=0.05)
