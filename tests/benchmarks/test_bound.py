"""The bound of both noises: against dense algebra, an independent impedance, and the scatter of real estimates."""

from dataclasses import replace

import numpy as np

from benchmarks import bound
from benchmarks.bound import Noise, PathResponse
from norton_bench.identification import loops
from norton_bench.identification.expansion import Excitation, Linearised, Slopes, information, planned_signals
from norton_bench.identification.signals import FINE, TimeSeries
from norton_bench.models.network import NortonNetwork

TICK_S = 1e-3
NETWORK = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")
BAND = bound.WIDE_BAND
AT = Linearised(NETWORK, 1.5e-3, -0.4e-3, BAND)
NOISE = Noise(torque_nm=3e-4, position_rad=3e-5)
DRAWS = 200


def multisine(rng, ticks, low_hz, high_hz, lines=25):
    time_s = np.arange(ticks) * TICK_S
    frequencies = np.geomspace(low_hz, high_hz, lines)
    wave = np.sin(2 * np.pi * np.outer(frequencies, time_s) + rng.uniform(0, 2 * np.pi, lines)[:, None]).T @ (
        1 / frequencies
    )
    return wave / np.max(np.abs(wave))


def excitation(ticks, amplitude_rad):
    rng = np.random.default_rng(5)
    return Excitation(TICK_S, 0.1 * multisine(rng, ticks, 3, 200), amplitude_rad * multisine(rng, ticks, 2, 80))


def stretch(ticks, amplitude_rad=0.02):
    return planned_signals(excitation(ticks, amplitude_rad), 0.0)


def covariance(response, noise):
    """Σ and H, dense."""
    path = response.direct + response.held @ np.linalg.inv(response.memory.toarray()) @ response.entry
    read = np.diag(noise.position_rad**2 + (noise.reading_s * response.velocity_rad_s) ** 2)
    late = noise.command_s * (np.linalg.inv(response.lag.toarray()) @ response.late)[response.used]
    return noise.torque_nm**2 * np.eye(len(path)) + path @ read @ path.T + late @ late.T, path


def with_a_rest(signals):
    """Some samples of no use, and a rest after which the friction is unknown."""
    usable = np.ones(signals.time_s.size, dtype=bool)
    usable[:20], usable[120:160], usable[-20:] = False, False, False
    return replace(signals, usable=usable, rests=np.array([150]))


def test_what_it_solves_is_what_dense_algebra_gives():
    parts = (with_a_rest(stretch(300)), with_a_rest(stretch(260, 0.005)))
    uneven = replace(NOISE, reading_s=5e-5, command_s=1e-4)
    slopes = Slopes.of(parts, AT)
    columns = np.concatenate([slopes.wanted, slopes.others, slopes.memory.columns()])
    whole, first = np.zeros((columns.shape[1],) * 2), 0
    for rows in slopes.regression.rows:
        sigma, _ = covariance(PathResponse.along(rows, AT), uneven)
        last = first + len(sigma)
        whole[first:last, first:last] = sigma
        first = last
    scale = np.linalg.norm(columns, axis=1)
    products = columns / scale[:, None] @ np.linalg.solve(whole, (columns / scale[:, None]).T)
    expected = np.linalg.pinv(products, rcond=1e-14, hermitian=True)[:9, :9] / np.outer(scale[:9], scale[:9])
    found = np.linalg.inv(bound.information(parts, AT, uneven))
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=1e-6)


def test_an_exact_encoder_leaves_the_bound_of_the_torque_sensor():
    parts = (with_a_rest(stretch(600)), stretch(300))
    exact = bound.information(parts, AT, replace(NOISE, position_rad=0.0))
    alone = information(parts, AT, NOISE.torque_nm)
    np.testing.assert_allclose(exact, alone, rtol=1e-7, atol=1e-9 * np.max(alone))


def test_a_late_command_leaves_out_what_the_lag_says():
    at = replace(AT, command_delay_s=0.0)
    signals = stretch(400)
    response = PathResponse.along(Slopes.of((signals,), at).regression.rows[0], at)
    late_s, command = 1e-4, 200
    sent_s = signals.sent_s.copy()
    sent_s[command] += late_s
    step_s = TICK_S / FINE
    torque = [
        NETWORK.torque_gain
        * loops.mean_lag_of_held(
            sent, signals.command, NETWORK.amplifier_bandwidth_rad_s, 0.0, step_s, 400 * FINE, False
        )
        for sent in (signals.sent_s, sent_s)
    ]
    lost = np.mean((torque[0] - torque[1]).reshape(400, FINE), axis=1)
    one = np.zeros(400)
    one[command] = late_s
    expected = np.linalg.solve(response.lag.toarray(), response.late @ one)
    assert abs(np.sum(expected)) > 0
    # Seen through any low-pass, the sum counts, and where it lies to within a tick.
    np.testing.assert_allclose(np.abs(np.sum(expected)), np.abs(np.sum(lost)), rtol=0.02)
    ticks = np.arange(400)
    assert abs(expected @ ticks / np.sum(expected) - lost @ ticks / np.sum(lost)) < 1.0


def test_readings_that_tell_less_never_narrow_the_bound():
    parts = (stretch(600),)
    least = [np.diag(np.linalg.inv(bound.information(parts, AT, Noise(1e-3, q)))) for q in (0.0, 1e-5, 1e-4)]
    assert np.all(np.diff(least, axis=0) > 0)
    slower = replace(parts[0], position_period_s=4 * TICK_S)
    np.testing.assert_allclose(
        bound.information((slower,), AT, Noise(1e-3, 1e-5)), bound.information(parts, AT, Noise(1e-3, 2e-5)), rtol=1e-6
    )


def test_the_torque_answers_another_path_as_the_impedance_does():
    at = replace(AT, motion_delay_s=0.0)
    signals = stretch(400)
    rows = Slopes.of((signals,), at).regression.rows[0]
    _, response = covariance(PathResponse.along(rows, at), NOISE)
    path = signals.path_rad[::FINE]
    ticks = np.arange(path.size)
    for centre in (80, 150, 210, 300):
        bump = 1e-6 * np.exp(-0.5 * ((ticks - centre) / 10.0) ** 2)
        torques = [NETWORK.torque(np.zeros(path.size), path + sign * bump, TICK_S) for sign in (1, -1)]
        expected = (torques[0] - torques[1]) / 2
        inner = slice(20, -20)
        off = response @ bump - expected
        assert np.linalg.norm(off[inner]) < 0.05 * np.linalg.norm(expected[inner])


def test_generalised_least_squares_attains_it_and_plain_least_squares_does_not():
    """Many records of one motion with noise of both kinds, explained by the fit's own regression along the path read.

    Over ``DRAWS`` records a scatter is known to 5 %.
    """
    ticks, rng = 2000, np.random.default_rng(11)
    plan = excitation(ticks, 0.1)
    clean = planned_signals(plan, 0.0)
    usable = np.ones(ticks, dtype=bool)
    usable[:30], usable[-30:] = False, False
    clean = replace(clean, usable=usable)
    fine_s = np.arange(ticks * FINE) * TICK_S / FINE

    def explained(signals):
        return AT.linear @ Slopes.of((signals,), AT).regression.columns(AT.shape)[0][:5]

    slopes = Slopes.of((clean,), AT)
    columns = np.concatenate([slopes.wanted, slopes.others, slopes.memory.columns()])
    weighed = PathResponse.along(slopes.regression.rows[0], AT).weighed(NOISE, columns)
    best = np.linalg.pinv(columns @ weighed.T) @ weighed
    plain = np.linalg.pinv(columns.T)
    true = explained(clean)
    errors = []
    for _ in range(DRAWS):
        read = plan.position_rad + NOISE.position_rad * rng.standard_normal(ticks)
        path = TimeSeries(clean.time_s, read, TICK_S).at(fine_s)
        torque = true + NOISE.torque_nm * rng.standard_normal(true.size)
        left = torque - explained(replace(clean, position_rad=path, path_rad=path))
        errors.append((best @ left, plain @ left))
    scatter = np.std(errors, axis=0)[:, :9]
    least = np.sqrt(np.diag(np.linalg.inv(bound.information((clean,), AT, NOISE))))
    np.testing.assert_allclose(scatter[0], least, rtol=0.2)
    assert np.all(scatter[1] > 1.3 * least)
    alone = np.sqrt(np.diag(np.linalg.inv(information((clean,), AT, NOISE.torque_nm))))
    assert np.all(least > 1.1 * alone)
