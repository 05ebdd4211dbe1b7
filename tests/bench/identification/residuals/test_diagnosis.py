"""The tests of the residual: seldom an alarm where there is nothing, and the right one where there is something."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from norton_bench.identification.judged_fit import fit
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.residual_tests import (
    MEMORY_LAGS,
    STRIDE,
    dependence,
    diagnose,
    memory,
    residual_tests,
    whiten,
)
from norton_bench.identification.rows import align
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification.synthetic import TICK_S

STEP_S = STRIDE * TICK_S
TRIALS = 150


def banded(noise):
    """White noise as the fit's low-pass leaves it, thinned."""
    reach = int(np.ceil(FULL_BAND.half_width))
    taps = FULL_BAND.taps(np.arange(-reach, reach + 1.0), 0)
    return np.convolve(noise, taps, mode="same")[::STRIDE]


def bursts(rng, count):
    """White noise whose deviation changes threefold, and a gap."""
    noise = rng.normal(size=count) * (1 + 2 * (np.sin(np.arange(count) / 700) > 0))
    noise[count // 3 : count // 3 + 200] = np.nan
    return noise


@pytest.fixture(scope="module")
def aligned(experiment, result):
    return align(signals(experiment, TICK_S, Use.IDENTIFY), result.motion_delay_s)


def made_up(aligned, seed, extra=lambda each: 0.0):
    """Residuals on the real motion: bursts of white noise in the band, and whatever is put on top."""
    rng = np.random.default_rng(seed)
    parts = []
    for each in aligned:
        noise = 1e-3 * rng.normal(size=each.command.size) * (1 + (np.arange(each.command.size) // 4000) % 2)
        part = each.rows.of_tick_signal(noise) + extra(each)
        parts.append(np.where(each.usable, part, np.nan))
    return parts


def test_noise_within_the_band_is_white_once_freed_of_the_bands_colour():
    rng = np.random.default_rng(0)
    alarms = [
        memory(whiten(banded(bursts(rng, 9000)), FULL_BAND, STRIDE), STEP_S).p_value < 0.05 for _ in range(TRIALS)
    ]
    assert abs(np.mean(alarms) - 0.05) < 3 * np.sqrt(0.05 * 0.95 / TRIALS)


def test_without_that_the_same_noise_would_be_called_coloured():
    """What the whitening is for."""
    rng = np.random.default_rng(0)
    thinned = banded(rng.normal(size=60_000))
    assert memory(thinned, STEP_S).p_value < 1e-6
    assert memory(whiten(thinned, FULL_BAND, STRIDE), STEP_S).p_value > 0.001


def test_little_memory_is_noticed():
    """A tenth of the sample before it remains: a correlation of 0.1 over 3000 samples is five deviations."""
    rng = np.random.default_rng(1)
    caught = [memory(lfilter([1.0], [1.0, -0.1], rng.normal(size=3000)), STEP_S).p_value < 0.05 for _ in range(50)]
    assert np.mean(caught) > 0.8


def test_the_band_of_each_lag_holds_nineteen_in_twenty():
    rng = np.random.default_rng(2)
    tests = [memory(whiten(banded(bursts(rng, 9000)), FULL_BAND, STRIDE), STEP_S) for _ in range(100)]
    outside = np.mean([np.abs(each.correlation) > each.band for each in tests])
    assert outside == pytest.approx(0.05, abs=0.01)
    assert tests[0].lags_s.shape == (MEMORY_LAGS,)


@pytest.mark.long
def test_inputs_that_have_nothing_to_do_with_it_raise_few_alarms():
    """The input is strongly coloured, as velocities are, and the residual's noise comes in bursts."""
    rng = np.random.default_rng(3)
    alarms = []
    for _ in range(TRIALS):
        residual = whiten(banded(bursts(rng, 60_000)), FULL_BAND, STRIDE)
        velocity = whiten(banded(lfilter([1.0], [1.0, -0.98], rng.normal(size=60_000))), FULL_BAND, STRIDE)
        alarms.append(dependence(residual, velocity, STEP_S, "velocity", 1.0).p_value < 0.05)
    assert np.mean(alarms) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / TRIALS)


def test_an_input_that_it_follows_is_found_with_its_size():
    """A twentieth of the variance."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        cause = rng.normal(size=60_000)
        residual = banded(np.roll(cause, 2 * STRIDE) * np.sqrt(0.05) + rng.normal(size=60_000) * np.sqrt(0.95))
        found = dependence(
            whiten(residual, FULL_BAND, STRIDE), whiten(banded(cause), FULL_BAND, STRIDE), STEP_S, "command", 2e-3
        )
        assert found.p_value < 1e-6
        assert found.share == pytest.approx(0.05, abs=0.01)
        assert found.rms_nm == pytest.approx(2e-3 * np.sqrt(0.05), rel=0.1)
        assert found.lags_s[np.argmax(found.correlation)] == pytest.approx(2 * STEP_S)


def test_a_resonance_shows_its_frequency():
    rng = np.random.default_rng(5)
    acceleration = rng.normal(size=60_000)
    pole = 0.985 * np.exp(2j * np.pi * 90.0 * TICK_S)
    ringing = lfilter([1.0], np.poly([pole, pole.conjugate()]).real, acceleration)
    residual = banded(ringing / np.std(ringing) + 2 * rng.normal(size=60_000))
    found = dependence(
        whiten(residual, FULL_BAND, STRIDE),
        whiten(banded(acceleration), FULL_BAND, STRIDE),
        STEP_S,
        "acceleration",
        1.0,
    )
    assert found.peak_hz == pytest.approx(90.0, abs=13.0)  # 13 lags of 3 ms resolve 26 Hz


def test_an_input_that_stands_still_or_a_short_record_gives_no_verdict():
    noise = np.random.default_rng(6).normal(size=20_000)
    assert dependence(noise, np.zeros(20_000), STEP_S, "velocity", 1.0) is None
    assert dependence(noise[:500], noise[:500], STEP_S, "velocity", 1.0) is None


@pytest.mark.long
def test_on_a_real_motion_noise_raises_few_alarms(aligned):
    trials = [residual_tests(made_up(aligned, seed), aligned) for seed in range(30)]
    p_values = [each.p_value for tests in trials for each in tests.dependences]
    assert np.mean(np.array(p_values) < 0.05) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / len(p_values))
    assert sum(len(tests.harmonics) for tests in trials) <= 2
    assert np.mean([tests.memory.p_value < 0.05 for tests in trials]) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 30)


def test_position_is_named_by_its_periods_and_amplitude(aligned):
    def wave(each):
        return 0.25e-3 * np.sin(42 * each.position_rad) + 0.4e-3 * np.cos(7 * each.position_rad + 1.0)

    found = residual_tests(made_up(aligned, 1, wave), aligned).harmonics
    assert [each.periods_per_turn for each in found] == [7, 42]
    assert [each.amplitude_nm for each in found] == [pytest.approx(0.4e-3, rel=0.15), pytest.approx(0.25e-3, rel=0.2)]


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("acceleration", lambda each: 5e-7 * np.roll(each.acceleration_rad_s2, 3)),
        ("direction", lambda each: each.rows.of_tick_signal(1e-4 * np.sign(each.velocity_rad_s))),
    ],
)
def test_what_the_motion_leaves_is_named(aligned, name, part):
    tests = residual_tests(made_up(aligned, 2, part), aligned)
    p_values = {each.name: each.p_value for each in tests.dependences}
    assert p_values[name] < 1e-3


def test_the_cogging_of_the_simulated_motor_is_found_in_the_residual_of_its_fit(experiment, result):
    """0.3 mN·m with 42 periods a turn, which no parameter of the network stands for."""
    tests = diagnose(result, signals(experiment, TICK_S, Use.IDENTIFY))
    assert tests.harmonics[0].periods_per_turn == 42
    assert tests.harmonics[0].amplitude_nm == pytest.approx(0.3e-3, rel=0.15)
    assert int(np.nanargmax(tests.spectrum_nm)) + 1 == 42


@pytest.mark.long
def test_free_motion_alone_shows_the_cogging_too_but_no_verdict_on_its_own_noise(without_torque):
    free = replace(without_torque, segments=tuple(each for each in without_torque.segments if each.procedure == "free"))
    found = fit(free, command_unit="N*m", tick_s=TICK_S)
    assert found.ratios_only
    tests = diagnose(found, signals(free, TICK_S, Use.IDENTIFY))
    assert tests.memory is None
    assert not {"velocity", "acceleration"} & {each.name for each in tests.dependences}


def test_too_little_is_not_judged(aligned):
    nothing = [np.full(each.command.size, np.nan) for each in aligned]
    assert residual_tests(nothing, aligned) is None
