"""The final fit, from nothing, on a bench that shares no code with it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from norton_bench.errors import ExperimentError
from norton_bench.identification.bootstrap import DRAWS
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.load import fit_load
from norton_bench.identification.motor_values import covariance_of, physical
from norton_bench.identification.separable import solve
from norton_bench.identification.shape import Shape
from norton_bench.identification.signals import signals
from norton_bench.identification.term_estimates import cogging_found
from norton_bench.models.parameters import Status
from norton_bench.records import Chain
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import LOAD, NAMES, TICK_S, Bench, Truth

LOOSE = ("amplifier_bandwidth", "presliding_damping")
# Half of the usual draws: intervals are as wide as so few make them.
FEWER_DRAWS = DRAWS // 2


def errors(result, truth):
    return {name: result.estimate(name).value / getattr(truth, name) - 1 for name in NAMES}


def deviates(result, truth):
    return np.array([(result.estimate(n).value - getattr(truth, n)) / result.estimate(n).std for n in NAMES])


def within_targets(result, truth):
    return all(abs(error) < (0.15 if name in LOOSE else 0.03) for name, error in errors(result, truth).items())


@pytest.fixture(scope="module")
def short():
    return synthetic.brief(1)


@pytest.fixture(scope="module")
def result_of_short(short):
    return fit(short, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)


def test_every_parameter_is_found(result):
    assert result.converged
    assert within_targets(result, Truth()), errors(result, Truth())
    assert np.all(np.abs(deviates(result, Truth())) < 3)
    assert all(estimate.status is Status.VALID for estimate in result.estimates)
    assert result.verdict == ()


def test_current_tells_torque_constant_and_gain_apart(result):
    truth = Truth()
    for name in ("torque_constant", "amplifier_gain"):
        estimate = result.estimate(name)
        assert abs(estimate.value - getattr(truth, name)) < 3 * estimate.std
        assert estimate.std < 0.01 * estimate.value


def test_a_drive_that_reports_its_current_slowly_will_do(short):
    """ODrive sends it every 10 ms: far too slowly to be interpolated."""
    result = fit(replace(short, current=short.current[::10]), command_unit="N*m", tick_s=TICK_S, draws=0)
    estimate = result.estimate("torque_constant")
    assert abs(estimate.value - Truth().torque_constant) < 3 * estimate.std
    assert estimate.std < 0.01 * estimate.value


@pytest.mark.long
def test_a_current_in_coarse_steps_widens_its_interval_alone(short, result_of_short):
    """As a VESC's: cut off towards zero to 0.1 A, read as the middle of each step."""
    current = short.current.copy()
    cut = np.trunc(current["current_a"] / 0.1)
    current["current_a"] = 0.1 * cut + 0.05 * np.sign(cut)
    coarse = fit(replace(short, current=current), command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)
    for name in ("torque_constant", "amplifier_gain"):
        estimate = coarse.estimate(name)
        assert abs(estimate.value - getattr(Truth(), name)) < 3 * estimate.std
        assert 2 * result_of_short.estimate(name).std < estimate.std < 0.02 * estimate.value
    assert coarse.estimate("torque_gain") == result_of_short.estimate("torque_gain")


def test_a_contact_that_the_encoder_does_not_resolve_is_not_told(result_of_short):
    """Steps of 0.1 degrees, as a CubeMars sends them: 1.2 to the way in which this friction builds up."""
    coarse = fit(synthetic.brief(1, bench=Bench(counts=3600.0)), command_unit="N*m", tick_s=TICK_S, draws=0)
    statuses = {name: coarse.estimate(name).status for name in NAMES}
    untold = {"presliding_stiffness", "presliding_damping"}
    assert {name for name, status in statuses.items() if status is Status.UNEXCITED} == untold
    assert [sentence for sentence in coarse.verdict if "does not resolve a presliding length of 2" in sentence]
    assert not [sentence for sentence in result_of_short.verdict if "does not resolve" in sentence]


@pytest.mark.long
def test_a_motion_that_chatters_within_its_counts_needs_finer_ones():
    """Five to the way in which this friction builds up are enough, but not where the path errs unseen by a third."""
    bench = synthetic.brief(1, bench=Bench(counts=15700.0))
    count_rad, motion = 2 * np.pi / 15700.0, bench.motion.copy()
    unseen = np.convolve(np.random.default_rng(5).standard_normal(len(motion)), np.hanning(25), "same")
    motion["position_rad"] += 0.3 * count_rad / np.std(unseen) * unseen
    motion["position_rad"] = np.floor(motion["position_rad"] / count_rad) * count_rad
    smooth, chatters = (
        fit(each, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)
        for each in (bench, replace(bench, motion=motion))
    )
    statuses = (smooth.estimate("presliding_stiffness").status, chatters.estimate("presliding_stiffness").status)
    assert statuses == (Status.VALID, Status.UNEXCITED)
    assert chatters.estimate("inertia").status is Status.VALID
    assert [sentence for sentence in chatters.verdict if "less smooth than its counts tell" in sentence]


@pytest.mark.long
def test_coarse_counts_widen_the_intervals_of_friction(result_of_short):
    """0.02 degrees: a sixth of the way in which this friction builds up."""
    measured = synthetic.brief(1, bench=Bench(counts=18_000.0))
    coarse = fit(measured, command_unit="N*m", tick_s=TICK_S)  # deviations of fewer draws scatter by a fifth
    assert np.all(np.abs(deviates(coarse, Truth())) < 3)
    for name in ("presliding_stiffness", "presliding_damping"):
        assert coarse.estimate(name).std > 1.2 * result_of_short.estimate(name).std


def test_delays_are_relative_to_the_torque(result):
    # Transport: 0.25 ms to the drive, 0.25 ms for its encoder, 1.16 ms for the torque; the devices' own phases, up to
    # half a tick either way of what is drawn here, are in the stamps and cancel.
    assert result.command_delay_s == pytest.approx(0.25e-3 + 1.16e-3, abs=4e-5)
    assert result.motion_delay_s == pytest.approx(0.25e-3 - 1.16e-3, abs=4e-5)


def test_the_residual_is_noise(result):
    # 1 mN·m of white noise in the fit's band (0.36 of it), and 0.3 mN·m of cogging.
    assert 0.5e-3 < result.torque_rms_nm < 0.75e-3
    assert np.nanstd(result.trace.measured - result.trace.predicted) == pytest.approx(result.torque_rms_nm, rel=1e-3)


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_other_true_values_are_found_as_well(seed):
    """Any factor between 0.5 and 2 on every true value: nothing in the identifier knows them.

    Without simulated records deviations are the narrowest: what lies within them lies within wider ones.
    """
    factors = 2 ** np.random.default_rng(seed).uniform(-1, 1, 7)
    truth = Truth(*(Truth().array() * factors))
    result = fit(synthetic.brief(seed, truth), command_unit="N*m", tick_s=TICK_S, draws=0)
    assert within_targets(result, truth), errors(result, truth)
    # 95 of 100 within 3 deviations is the promise; of 7, one outside by a little has a chance in three.
    assert np.all(np.abs(deviates(result, truth)) < 4.5)


@pytest.mark.long
def test_a_drive_that_lets_go_at_zero_has_no_lag_there():
    """Every twentieth command lies below the least one: taken for a lag, that makes the amplifier seem quicker."""
    bench = Bench(least_command=2e-3)
    experiment = synthetic.brief(5, bench=bench)
    released = 1.0 - np.count_nonzero(experiment.ticks["command"]) / len(experiment.ticks)
    assert released > 0.05
    known = replace(experiment, chain=Chain(released_at_zero=frozenset({"actuator"})))
    told = fit(known, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)
    not_told = fit(experiment, command_unit="N*m", tick_s=TICK_S, draws=0)
    assert np.all(np.abs(deviates(told, Truth())) < 4.0)
    assert told.torque_rms_nm < not_told.torque_rms_nm
    lag, other = (result.estimate("amplifier_bandwidth") for result in (told, not_told))
    assert other.value - lag.value > 5 * lag.std


@pytest.mark.long
def test_a_sensor_that_averages_is_no_lag_of_the_amplifier():
    """Three readings are as wide as 2.83 ms of a flat average."""
    measured = synthetic.brief(1, multisine_s=28.0)
    torque, window_s = measured.torque.copy(), np.sqrt(8.0) * TICK_S
    torque["torque_nm"] = np.convolve(torque["torque_nm"], np.full(3, 1 / 3), "same")
    averaged = replace(measured, torque=torque)
    result = fit(measured, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)
    not_told = fit(averaged, command_unit="N*m", tick_s=TICK_S, draws=0)
    known_window = replace(averaged, chain=Chain(torque_averaging_s=window_s))
    told = fit(known_window, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)
    for name in ("amplifier_bandwidth", "inertia"):
        known, found = result.estimate(name), told.estimate(name)
        assert found.value == pytest.approx(known.value, abs=2 * np.hypot(found.std, known.std))
    known, found = (each.estimate("amplifier_bandwidth") for each in (result, told))
    assert found.std > known.std
    lag = not_told.estimate("amplifier_bandwidth")
    assert lag.value < 0.92 * known.value
    assert known.value - lag.value > 4 * found.std


def test_a_sensor_without_a_clock_of_its_own_will_do():
    measured = synthetic.brief(2, bench=Bench(device_clock=False))
    result = fit(measured, command_unit="N*m", tick_s=TICK_S, draws=0)
    assert within_targets(result, Truth()), errors(result, Truth())


def test_lost_readings_do_no_harm(short):
    keep = np.random.default_rng(0).random(len(short.motion)) > 0.002
    keep_torque = np.random.default_rng(1).random(len(short.torque)) > 0.002
    measured = replace(short, motion=short.motion[keep], torque=short.torque[keep_torque])
    result = fit(measured, command_unit="N*m", tick_s=TICK_S, draws=0)
    assert within_targets(result, Truth()), errors(result, Truth())


def test_free_motion_alone_gives_ratios_and_says_so(without_torque):
    """A shaft that is really free: no load, no sensor."""
    bench = Bench(load=Truth(1.0, 1000.0, 1e-7, 1e-8, 1e-7, 1e-3, 1e-9), stiffness=20.0, damping=1e-3)
    measured = synthetic.experiment(3, bench=bench, blocked=False, imposed=False)
    result = fit(replace(measured, torque=measured.torque[:0]), command_unit="N*m", tick_s=TICK_S, draws=0)
    truth = Truth()
    for name in ("torque_gain", "inertia", "viscous_damping", "coulomb_torque", "presliding_stiffness"):
        assert result.estimate(name).status is Status.RATIO_ONLY
        assert np.isnan(result.estimate(name).value)
    assert "common factor" in result.verdict[0]
    network, gain = result.network, truth.torque_gain
    assert network.torque_gain == 1.0
    assert network.viscous_damping_nms_rad * gain == pytest.approx(truth.viscous_damping, rel=0.03)
    assert network.coulomb_torque_nm * gain == pytest.approx(truth.coulomb_torque, rel=0.03)
    assert network.inertia_kgm2 * gain == pytest.approx(truth.inertia, rel=0.05)
    assert network.amplifier_bandwidth_rad_s == pytest.approx(truth.amplifier_bandwidth, rel=0.15)


@pytest.mark.parametrize("free_motion", [False, True])
def test_deviations_follow_from_the_unknowns_by_the_gradient(free_motion):
    """Each parameter's change with each unknown, as small steps of the unknowns themselves tell it."""
    linear, shape = np.array([0.8, 2.1e-4, 3e-3, 0.05, 7e-4]), np.array([np.log(900.0), np.log(60.0), 1.2e-3, 4e-4])

    def found(unknowns, covariance):
        at = SimpleNamespace(
            linear=unknowns[:5], shape=Shape.of(unknowns[5:]), free=(0, 1, 2, 3), free_motion=free_motion
        )
        return physical(at, covariance)

    unknowns = np.concatenate([linear, shape])
    for k, size in enumerate(np.abs(unknowns)):
        step = np.zeros(9)
        step[k] = 1e-6 * size
        above, below = (found(unknowns + sign * step, np.zeros((9, 9)))[0] for sign in (1.0, -1.0))
        change = (above - below) / 2e-6  # for a deviation as great as the unknown itself
        covariance = found(unknowns, np.diag((step / 1e-6) ** 2))[1]
        assert covariance == pytest.approx(np.outer(change, change), rel=1e-5, abs=1e-15)


def test_zero_torque_sets_no_scale():
    measured = synthetic.experiment(1, blocked=False, imposed=False)
    result = fit(measured, command_unit="N*m", tick_s=TICK_S, draws=0)
    assert result.estimate("inertia").status is Status.RATIO_ONLY


def test_an_actuator_that_was_never_commanded_is_refused(experiment):
    ticks = experiment.ticks.copy()
    ticks["command"] = 0.0
    with pytest.raises(ExperimentError, match="never commanded"):
        fit(replace(experiment, ticks=ticks), command_unit="N*m", tick_s=TICK_S)


def test_nothing_measured_is_refused(experiment):
    with pytest.raises(ExperimentError, match="no motion"):
        fit(replace(experiment, motion=experiment.motion[:0]), command_unit="N*m", tick_s=TICK_S)
    with pytest.raises(ExperimentError, match='"identify"'):
        fit(synthetic.calibration(1), command_unit="N*m", tick_s=TICK_S)


def test_the_load_is_fitted_by_the_same_core():
    found = fit_load(synthetic.calibration(1), TICK_S)
    for name in ("torque_gain", "inertia", "coulomb_torque"):
        assert found.result.estimate(name).value == pytest.approx(getattr(LOAD, name), rel=0.03)
    assert found.sensor_stiffness_nm_rad == pytest.approx(200, abs=3 * found.sensor_stiffness_std_nm_rad)
    assert found.torque_bias_nm == pytest.approx(3e-3, abs=3e-4)
    assert found.sensor_damping_nms_rad == pytest.approx(0.01, abs=0.005)
    assert found.position_resolution_rad == pytest.approx(2 * np.pi / 131072, rel=1e-3)


@pytest.mark.parametrize("noise_nm", [1e-3, 8e-3])
def test_a_load_shaken_against_an_idle_actuator_tells_nothing(noise_nm):
    """The idle actuator answers the motion as the load does: the torque between them sets no scale."""
    with pytest.raises(ExperimentError, match="command the actuator too"):
        fit_load(synthetic.calibration(1, bench=Bench(noise_nm=noise_nm), share=0.0), TICK_S)


def test_a_noisy_sensor_widens_the_loads_interval_and_hides_no_scale():
    found = fit_load(synthetic.calibration(2, bench=Bench(noise_nm=8e-3)), TICK_S)
    for name in ("torque_gain", "inertia", "coulomb_torque"):
        estimate = found.result.estimate(name)
        assert estimate.status is Status.VALID
        assert abs(estimate.value - getattr(LOAD, name)) < 3.0 * estimate.std
        assert estimate.std < 0.05 * estimate.value


@pytest.mark.long
@pytest.mark.parametrize(
    "bench",
    [Bench(cogging_nm=0.0), Bench(serial_delay_s=1160e-6 + TICK_S / 2)],
    ids=["plain", "cogging and delay"],
)
def test_intervals_hold_what_they_promise(bench):
    """Plain, and with cogging and half a tick of delay that nobody told: other truths, other noise every time."""
    deviations = []
    for seed in range(40, 46):
        truth = Truth(*(Truth().array() * 2 ** np.random.default_rng(seed).uniform(-1, 1, 7)))
        measured = synthetic.brief(seed, truth, bench)
        deviations.append(deviates(fit(measured, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS), truth))
    # Of 42 intervals of 95 %, fewer than 35 hold the truth once in a thousand; the rms is 1 ± 0.11.
    assert np.count_nonzero(np.abs(deviations) < 1.96) >= 35
    assert 0.6 < np.sqrt(np.mean(np.square(deviations))) < 1.4
    assert np.max(np.abs(np.mean(deviations, axis=0))) < 1.6


def test_cogging_is_taken_out(short):
    """42 periods a turn of 0.3 mN·m stand in the record, and in no estimate."""
    solution = solve(signals(short, TICK_S, Use.IDENTIFY))
    assert solution.regression.cogging == (42.0,)
    cosine, sine = solution.linear[5:7]
    assert np.hypot(cosine, sine) == pytest.approx(0.3e-3, rel=0.1)


@pytest.mark.long
def test_the_amplitude_of_cogging_has_an_interval():
    """Each seed has another noise, and another size. Of ten intervals of 95 %, fewer than seven hold the truth once in
    1000; the rms is 1 ± 0.22."""
    deviations = []
    for seed in range(60, 70):
        size = 0.3e-3 * (1 + seed % 4)
        measured = synthetic.brief(seed, bench=Bench(cogging_nm=size))
        solution = solve(signals(measured, TICK_S, Use.IDENTIFY))
        waves = {each.periods_per_turn: each for each in cogging_found(solution, covariance_of(solution), 1.0)}
        wave = waves[42.0]
        assert wave.std_nm < 0.2 * wave.amplitude_nm
        deviations.append((wave.amplitude_nm - size) / wave.std_nm)
    assert np.count_nonzero(np.abs(deviations) < 1.96) >= 7
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.6


@pytest.mark.parametrize("seed", range(4))
def test_a_fast_machine_behind_a_slow_sensor_is_found_from_nothing(seed):
    """Bandwidth and delays make up for each other: a lower band has minima in which they do."""
    load = Truth(0.9974, 1921.0, 9.5e-5, 5.33e-4, 7.66e-3, 15.4, 7e-3)
    bench = Bench(load=load, serial_delay_s=1660e-6)
    found = fit_load(synthetic.calibration(seed, bench=bench), TICK_S)
    assert found.result.converged
    assert found.result.estimate("amplifier_bandwidth").value == pytest.approx(1921.0, rel=0.15)
    assert found.result.estimate("inertia").value == pytest.approx(9.5e-5, rel=0.03)
