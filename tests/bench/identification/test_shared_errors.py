"""What the position readings' own errors add to the products of a servo's columns, against draws of such errors."""

import numpy as np
import pytest

from norton_bench.identification.fed_back import SharedErrors, fed_back_of, position_errors
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.shape import GAIN, INERTIA, VISCOUS
from norton_drivers.servo import Servo

SERVOS = [Servo(0.0, 0.04, 62.5e-6, 500e-6), Servo(2.0, 0.02, 62.5e-6, 500e-6)]
PRODUCTS = np.arange(25.0).reshape(5, 5) + np.arange(25.0).reshape(5, 5).T
LINEAR = np.array([0.3, -0.2, 0.1, 0.5, -0.4, 7.0])


@pytest.mark.parametrize("free_motion", [False, True])
def test_the_pull_is_half_of_the_slope_of_the_square(free_motion):
    """What is taken off the gradient is the gradient of what is taken off the cost."""
    shared = SharedErrors(PRODUCTS, free_motion)
    for place in range(5):
        step = np.zeros(6)
        step[place] = 1e-6
        slope = (shared.square(LINEAR + step) - shared.square(LINEAR - step)) / 2e-6
        expected = 0.0 if free_motion and place == INERTIA else 0.5 * slope
        assert shared.pull(LINEAR)[place] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_of_free_motion_the_acceleration_is_the_target():
    shared = SharedErrors(PRODUCTS, free_motion=True)
    assert not shared.of_columns[INERTIA].any()
    assert shared.pull(np.zeros(5)) == pytest.approx(np.where(np.arange(5) == INERTIA, 0.0, PRODUCTS[:, INERTIA]))


@pytest.mark.parametrize("servo", SERVOS)
def test_columns_of_white_errors_have_these_products(servo):
    """Errors of density 1 every quarter of a millisecond, through loop, lag and low-pass."""
    tick_s, fine, bandwidth = 1e-3, 4, 800.0
    expected = position_errors(servo, bandwidth, FULL_BAND, tick_s)
    step_s, random = tick_s / fine, np.random.default_rng(3)
    frequency_hz = np.fft.rfftfreq(400_000, step_s)
    omega = 2j * np.pi * frequency_hz
    error = np.fft.rfft(random.standard_normal(400_000) / np.sqrt(step_s))
    late = servo.of_angle + servo.of_velocity / servo.window_s * (1.0 - np.exp(-omega * servo.window_s))
    gain = -np.exp(-omega * servo.delay_s) * late / (1.0 + omega / bandwidth)
    at_cycles, power = FULL_BAND.spectrum()
    passed = np.sqrt(np.interp(frequency_hz * tick_s, at_cycles, power, right=0.0))
    columns = {GAIN: gain, INERTIA: -(omega**2), VISCOUS: -omega}
    found = {place: np.fft.irfft(column * passed * error) for place, column in columns.items()}
    for one in columns:
        for other in columns:
            scale = np.sqrt(expected[one, one] * expected[other, other])
            assert np.mean(found[one] * found[other]) == pytest.approx(expected[one, other], abs=0.05 * scale)


@pytest.mark.parametrize("window_s", [1e-6, 100e-6, 500e-6])
def test_the_velocity_taken_off_is_as_late_as_delay_and_window_say(window_s):
    """However short the window is beside the time between two samples."""
    servo, step_s = Servo(0.0, 0.04, 17e-6, window_s), 250e-6
    time_s = np.arange(4000) * step_s
    omega = 2 * np.pi * 20.0
    found = fed_back_of(servo, np.sin(omega * time_s), step_s)
    expected = omega * np.cos(omega * (time_s - 17e-6 - 0.5 * window_s))
    assert found[10:-10] == pytest.approx(expected[10:-10], abs=2e-4 * omega)
