"""The matrices of two joints, from spectra made with matrices that are known."""

import numpy as np
import pytest
from scipy import stats

from norton_bench.errors import ExperimentError
from norton_bench.joints.arm import ImpedanceSection, LinksSection
from norton_bench.joints.experiment import lines, motion
from norton_bench.joints.hand import hand_stiffness, jacobian_m
from norton_bench.joints.impedance import MATRICES, JointImpedance, Spectra, fit

TRUE = {
    "inertia": np.array([[0.29, 0.07], [0.07, 0.08]]),
    "damping": np.array([[1.1, 0.3], [0.2, 0.8]]),
    "stiffness": np.array([[22.0, 6.0], [4.0, 16.0]]),
}
SECTION = ImpedanceSection()
LATE_S = np.array([[0.9e-3, 0.8e-3], [1.1e-3, 1.0e-3]])  # torque of the row's joint after motion of the column's


def made(seed: int, noise_nm: float = 1e-3, more: float = 0.0, signs: tuple[float, float] = (1.0, -1.0)):
    """Two runs of periods with noise in torques and angles; ``more`` is a torque with the cube of the frequency."""
    random = np.random.default_rng(seed)
    frequency_hz = lines(SECTION) / SECTION.period_s
    s = 2j * np.pi * frequency_hz
    z = sum(TRUE[name] * (s ** (2 - k))[:, None, None] for k, name in enumerate(MATRICES))
    z = (z + more * (s**3)[:, None, None]) * np.exp(-s[:, None, None] * LATE_S)
    runs = []
    for sign in signs:
        angle = np.stack([0.01 / frequency_hz, sign * 0.01 / frequency_hz], axis=1).astype(complex)
        torque = -np.einsum("nij,nj->ni", z, angle)
        shape = (SECTION.periods, *angle.shape)

        def noisy(values, size, shape=shape):
            return values + size * (random.normal(size=shape) + 1j * random.normal(size=shape))

        runs.append(Spectra(noisy(angle, 1e-6), noisy(torque, noise_nm), np.zeros(2), np.zeros(2)))
    return tuple(runs)


def test_intervals_hold_the_matrices():
    results = [fit(made(seed), SECTION) for seed in range(60)]
    inside = np.array(
        [np.abs(result.matrices[name] - TRUE[name]) <= result.half[name] for result in results for name in MATRICES]
    )
    # Entries of one fit go together: about a quarter of them count as independent.
    low = stats.binom.ppf(1e-3, inside.size // 4, 0.95) / (inside.size // 4)
    assert low <= inside.mean() <= 0.995
    assert all(result.adequate for result in results)


def test_delays_of_reading_are_told_from_damping():
    result = fit(made(1, noise_nm=1e-5), SECTION)
    np.testing.assert_allclose(result.damping, TRUE["damping"], rtol=0.01)
    np.testing.assert_allclose(result.delays_s, [0.9e-3, 1.1e-3, 0.1e-3], atol=2e-5)


def test_another_law_is_not_called_adequate():
    result = fit(made(2, more=2e-4), SECTION)
    assert not result.adequate
    # The intervals are wider by as much as the torques are not explained.
    assert result.half["stiffness"][0, 0] > 1.5 * fit(made(2), SECTION).half["stiffness"][0, 0]


def test_joints_that_move_alike_are_refused():
    with pytest.raises(ExperimentError, match="moved alike in both runs"):
        fit(made(3, signs=(1.0, 1.0)), SECTION)


def test_lines_are_odd_and_within_the_band():
    chosen = lines(SECTION)
    assert np.all(chosen % 2 == 1)
    assert chosen[0] / SECTION.period_s >= SECTION.lowest_hz
    assert chosen[-1] / SECTION.period_s <= SECTION.highest_hz


def test_motion_is_periodic_where_it_is_evaluated():
    wave, tick_s = motion(SECTION, 1e-3, SECTION.periods), 1e-3
    period = round(SECTION.period_s / tick_s)
    middle = wave.position_rad[period : (SECTION.periods + 1) * period].reshape(SECTION.periods, period)
    np.testing.assert_allclose(middle, np.broadcast_to(middle[0], middle.shape), atol=1e-9)
    assert np.max(np.abs(wave.position_rad)) == pytest.approx(1.0)


LINKS = LinksSection.model_validate({"upper": "0.31 m", "lower": "0.34 m", "shoulder": "0.8 rad", "elbow": "1.6 rad"})


def impedance(stiffness: np.ndarray) -> JointImpedance:
    zeros = np.zeros((2, 2))
    covariance = np.diag([1e-6] * 8 + [0.01] * 4)
    return JointImpedance(
        zeros, zeros, stiffness, covariance, 57, 60, 1.0, np.zeros(3), np.ones(1), np.zeros((1, 2, 2), complex),
        (0.03, 0.03), (0.0, 0.0),
    )  # fmt: skip


def test_hand_moves_by_the_jacobian():
    def hand(q):
        first, both = 0.8 + q[0], 2.4 + q[0] + q[1]
        return np.array([0.31 * np.cos(first) + 0.34 * np.cos(both), 0.31 * np.sin(first) + 0.34 * np.sin(both)])

    turned, step = np.array([0.2, -0.1]), 1e-6
    slopes = np.stack([(hand(turned + step * e) - hand(turned - step * e)) / (2 * step) for e in np.eye(2)], axis=1)
    np.testing.assert_allclose(jacobian_m(LINKS, turned), slopes, atol=1e-9)


def test_a_spring_at_the_hand_comes_back_as_it_is():
    at_hand = np.array([[300.0, 40.0], [40.0, 90.0]])
    jacobian = jacobian_m(LINKS, np.zeros(2))
    result = hand_stiffness(impedance(jacobian.T @ at_hand @ jacobian), LINKS)
    np.testing.assert_allclose(result.stiffness_n_m, at_hand, rtol=1e-9)
    values, axes = np.linalg.eigh(at_hand)
    assert (result.minor_n_m, result.major_n_m) == pytest.approx(tuple(values))
    assert result.direction_deg == pytest.approx(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])) % 180.0)
    assert result.curl == pytest.approx(0.0, abs=1e-12)
    assert result.curl_half > 0.0
