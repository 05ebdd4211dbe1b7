"""What counting the motion again says of the friction's error, against the error itself."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification import loops
from norton_bench.identification.counts import NO_STEPS, Resolution, unquantised
from norton_bench.identification.expansion import Excitation, planned_signals
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.rows import Rows, friction_error
from norton_bench.identification.shape import Shape
from norton_bench.identification.signals import FINE, TimeSeries

TICK_S = 1e-3
TICKS = 4000
S_PER_RAD = 400.0
COUNT_RAD = 4.8e-5  # of 17 bits
PHASES = 48
INNER = slice(400, -400)


def motion(amplitude_rad, frequency_hz, phase):
    def path(time_s):
        slower = 0.3 * np.sin(2 * np.pi * 0.37 * frequency_hz * time_s)
        return amplitude_rad * (np.sin(2 * np.pi * frequency_hz * time_s + phase) + slower)

    return path


def counted(path, count_rad, phase):
    """The motion as ``Signals``, read in counts."""
    time_s = np.arange(TICKS) * TICK_S
    read = (np.floor(path(time_s) / count_rad + phase) - phase + 0.5) * count_rad
    smoothed = TimeSeries(time_s, unquantised(read, count_rad), TICK_S)
    planned = planned_signals(Excitation(TICK_S, np.zeros(TICKS), smoothed.value), 0.0)
    return replace(planned, path_rad=smoothed.at(fine_s()), smoothed=smoothed, counts=Resolution(count_rad))


def fine_s():
    return np.arange(TICKS * FINE) * TICK_S / FINE


def sliding(path_rad):
    return loops.friction_path(path_rad, S_PER_RAD, np.zeros(0, dtype=np.int64))[0]


def along(true, error):
    """How much of an error is more friction, and how much is friction that is ahead of its time (in samples)."""
    directions = np.stack([true, np.gradient(true)])[:, INNER]
    return np.linalg.lstsq(directions.T, error[INNER], rcond=None)[0]


@pytest.mark.parametrize(
    ("amplitude_rad", "frequency_hz", "count_rad", "told_by"),
    [
        pytest.param(0.001, 5.0, COUNT_RAD, 1, id="a small slow loop"),
        pytest.param(0.005, 5.0, 4 * COUNT_RAD, 1, id="a slow loop in coarse counts"),
        pytest.param(0.005, 60.0, COUNT_RAD, 0, id="a fast loop, whose turns are cut"),
    ],
)
def test_what_it_takes_off_is_most_of_the_error(amplitude_rad, frequency_hz, count_rad, told_by):
    rng = np.random.default_rng(1)
    actual, found = [], []
    for phase in rng.uniform(0, 1, PHASES):
        path = motion(amplitude_rad, frequency_hz * (1 + 0.01 * rng.random()), 2 * np.pi * phase)
        signals = counted(path, count_rad, rng.random())
        true = sliding(path(fine_s()))
        actual.append(along(true, sliding(signals.path_rad) - true)[told_by])
        found.append(along(true, friction_error(signals, S_PER_RAD))[told_by])
    assert abs(np.mean(actual)) > 3 * np.std(actual) / np.sqrt(PHASES), "there is an error to be told"
    assert abs(np.mean(actual) - np.mean(found)) < 0.5 * abs(np.mean(actual))


def test_an_encoder_without_counts_has_none():
    signals = counted(motion(0.005, 5.0, 0.0), COUNT_RAD, 0.3)
    assert friction_error(replace(signals, counts=NO_STEPS), S_PER_RAD) is None
    assert friction_error(replace(signals, smoothed=None), S_PER_RAD) is None
    assert friction_error(replace(signals, smoothed=signals.smoothed.between(0.0, 0.1)), S_PER_RAD) is None


def test_finer_counts_leave_less_to_correct():
    path = motion(0.005, 5.0, 0.4)
    errors = [
        np.sqrt(np.mean(friction_error(counted(path, count_rad, 0.3), S_PER_RAD)[INNER] ** 2))
        for count_rad in (4 * COUNT_RAD, COUNT_RAD, COUNT_RAD / 64)
    ]
    assert errors[0] > 2 * errors[1] > 20 * errors[2]


def test_the_regression_takes_it_off_the_friction():
    signals, shape = counted(motion(0.005, 60.0, 0.4), COUNT_RAD, 0.3), Shape(600.0, S_PER_RAD, 0.0, 0.0)
    exact = replace(signals, path_rad=motion(0.005, 60.0, 0.4)(fine_s()))
    rows = Rows(signals, FULL_BAND)
    true = Rows(exact, FULL_BAND).friction(shape)
    off = [along(true[0], (each.friction(shape) - true)[0])[0] for each in (rows, rows.recounted(shape))]
    assert abs(off[1]) < 0.5 * abs(off[0])
