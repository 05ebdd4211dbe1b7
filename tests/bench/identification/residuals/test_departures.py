"""What is named of a residual: nothing where the motor is the paper's, the true cause where it is not."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.departures import departures, greatest_share
from norton_bench.identification.expansion import Expansion, Sums
from norton_bench.identification.signals import signals
from norton_bench.identification.statistics import LEAST_GAIN
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S, Truth


@pytest.fixture(scope="module")
def at(experiment, result):
    return Expansion.of(result, signals(experiment, TICK_S, Use.IDENTIFY), ())


def motion(measured):
    """Position and a smooth velocity at the instants of the torque readings."""
    stamps = measured.motion["arrival_ns"].astype(float) * 1e-9
    position = measured.motion["position_rad"]
    velocity = np.convolve(np.gradient(position, stamps), np.hanning(17)[1:-1] / np.hanning(17).sum(), "same")
    at_s = measured.torque["arrival_ns"].astype(float) * 1e-9
    return at_s, np.interp(at_s, stamps, position), np.interp(at_s, stamps, velocity)


def with_torque(measured, result, more):
    """The equation about the same network, of readings to which a torque was added."""
    torque = measured.torque.copy()
    torque["torque_nm"] += more(*motion(measured))
    return Expansion.of(result, signals(replace(measured, torque=torque), TICK_S, Use.IDENTIFY), ())


def test_nothing_is_named_on_the_papers_motor(at):
    assert departures(at) == ()


def test_mere_noise_is_seldom_named(at):
    """Within 5 % in theory; the noise's spectrum and its bursts are those of the readings."""
    rng = np.random.default_rng(3)
    size = np.sqrt(np.mean(at.residual**2)) * (1 + (np.arange(at.residual.size) // 4000) % 2)
    named = [bool(departures(replace(at, residual=size * rng.normal(size=size.size)))) for _ in range(8)]
    assert sum(named) <= 2  # more happen once in 170 such tests


DRAG = 2e-6
CAUSES = {
    "drag": lambda time_s, position, velocity: -DRAG * velocity * np.abs(velocity),
    "stribeck": lambda time_s, position, velocity: (
        4e-3 * np.tanh(velocity / 0.3) * (1 - np.exp(-((velocity / 4) ** 2)))
    ),
    "damping_drift": lambda time_s, position, velocity: -1e-4 * (time_s - time_s[0]) / 60.0 * velocity,
    "friction_by_position": lambda time_s, position, velocity: -3e-3 * np.tanh(velocity / 0.3) * np.cos(5 * position),
    "position": lambda time_s, position, velocity: 1e-3 * np.sin(9 * position),
    "asymmetry": lambda time_s, position, velocity: -2e-3 * (np.abs(velocity) > 0.3),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_the_true_cause_is_named_first(experiment, result, cause):
    found = departures(with_torque(experiment, result, CAUSES[cause]))
    assert found[0].kind.name == cause
    if cause == "friction_by_position":
        assert found[0].periods_per_turn == 5
    assert found[0].left_nm ** 2 + found[0].rms_nm ** 2 == pytest.approx(found[0].rms_nm ** 2 / found[0].share)


def test_what_a_term_does_to_the_parameters_is_told(experiment, result):
    """Drag that is not in the model is mostly taken for damping: without it, damping is less by a share of k |ω|."""
    found = departures(with_torque(experiment, result, CAUSES["drag"]))
    damping = found[0].change[3] * Truth().viscous_damping
    fastest = float(np.max(np.abs(motion(experiment)[2])))
    assert -DRAG * fastest < damping < -0.2 * DRAG * fastest


def test_what_is_too_small_to_matter_is_not_named(experiment, result):
    """A hundredth of the noise's rms is sure with so many readings, but no matter."""
    quiet = departures(with_torque(experiment, result, lambda *at: 0.05 * CAUSES["position"](*at)))
    assert quiet == ()


def test_sums_solve_and_leave_out_as_least_squares_does(at):
    """Against dense algebra on the same columns."""
    sums = Sums.of(at, at.jacobian)
    chosen = np.arange(5)
    kept = at.part != 0
    scaled = at.jacobian[:5] / sums.scale[:5, None]
    expected = np.linalg.lstsq(scaled[:, kept].T, at.residual[kept], rcond=None)[0]
    assert sums.solved(chosen, 0) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    left = at.residual[~kept] - expected @ scaled[:, ~kept]
    assert sums.left(chosen, expected, 0) == pytest.approx(float(left @ left), rel=1e-6)


def test_the_zero_is_that_of_the_fit(at, result):
    assert np.mean(at.zero.value_nm) == pytest.approx(result.torque_bias_nm, abs=5e-5)
    assert at.zero.at(np.array([at.time_s[-1] + 100.0])) == at.zero.value_nm[-1]  # held on beyond


def test_the_least_gain_is_what_the_ladder_asks_for():
    assert LEAST_GAIN == 0.01


def test_what_errors_of_readings_alone_explain_as_well_is_not_named(experiment, result):
    at = with_torque(experiment, result, CAUSES["drag"])
    share = greatest_share(at)
    assert departures(at, 0.9 * share)
    assert departures(at, 1.1 * share) == ()
