"""The model's own error: bounds that hold, statuses and sentences where something is missing, silence where not."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from norton_bench.identification.bootstrap import ErrorsSeen
from norton_bench.identification.departures import CHANGE, DRAG, Departure
from norton_bench.identification.judged_fit import beyond_bounds, possible
from norton_bench.identification.model_error import _times_simulated, expanded, judged, judged_estimates, model_error
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.prediction_error import LEVEL, prediction_error
from norton_bench.identification.sanity_checks import FailedCheck
from norton_bench.identification.signals import signals
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, Status
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.few_draws import judged_with_few_draws
from tests.bench.identification.synthetic import TICK_S


@pytest.fixture(scope="module")
def varied():
    return synthetic.varied(1)


@pytest.fixture(scope="module")
def stretches(experiment):
    return signals(experiment, TICK_S, Use.IDENTIFY)


@pytest.fixture(scope="module")
def unseen():
    return signals(synthetic.validation(9), TICK_S, Use.VALIDATE)


@pytest.fixture(scope="module")
def error(result, stretches, experiment):
    return error_of(result, stretches, (), experiment)


def error_of(result, stretches, unseen, measured):
    at = expanded(result, stretches, unseen)
    error = model_error(result, at, unseen, measured)
    prediction = prediction_error(result, at, error.zero.standing_nm, stretches, unseen, measured)
    return replace(error, prediction=prediction)


def changed(error, relative, kind=DRAG):
    """The same with a departure that moves the damping by so much, relative."""
    change = np.zeros(len(PHYSICAL))
    change[PHYSICAL.index("viscous_damping")] = relative
    return replace(error, departures=(Departure(kind, 5e-4, 0.5, 6e-4, 1e-9, change),))


@pytest.mark.long
def test_nothing_is_said_of_the_papers_motor(result, error):
    assert error.departures == ()
    assert not error.unexplained
    told = judged(result, error)
    assert told.estimates == result.estimates
    assert told.verdict == result.verdict
    assert told.network.prediction == error.prediction


@pytest.mark.parametrize(("moved", "status"), [(0.5, Status.INADEQUATE), (0.0, Status.VALID)])
def test_a_torque_limit_is_as_good_as_what_was_taken_off_to_find_it(error, result, moved, status):
    limit = Estimate("torque_limit", 0.3, 0.01, "N*m", Status.VALID)
    estimates = judged_estimates((*result.estimates, limit), changed(error, moved))
    assert estimates[-1] == replace(limit, status=status)


@pytest.mark.long
def test_torque_that_waited_for_the_loop_is_no_change_of_the_motor(varied):
    """On a serial line: the wait differs from pause to pause, by up to a tick."""
    torque = varied.torque.copy()
    torque["arrival_ns"] = synthetic.looked_at(torque["arrival_ns"], np.random.default_rng(1))
    found = judged_with_few_draws(replace(varied, torque=torque))
    assert found.error.departures == ()
    assert all(each.status is Status.VALID for each in found.result.estimates), found.result.verdict


def test_the_stated_error_has_no_cogging_that_the_network_has(error):
    """0.3 mN·m of cogging, 0.21 mN·m rms, are in the network."""
    assert error.rms_nm < 0.15e-3
    assert 0.0 < error.prediction.torque_nm < 0.15e-3
    assert error.prediction.level == pytest.approx(LEVEL)
    low, high = error.prediction.ranges["velocity"]
    assert low < -20 < 20 < high


@pytest.mark.long
def test_a_wrong_network_states_a_greater_error(result, stretches, unseen, experiment):
    """Of segments that no fit has seen: values that are off show there."""
    wrong = replace(result, network=replace(result.network, coulomb_torque_nm=1.1 * result.network.coulomb_torque_nm))
    left = error_of(wrong, stretches, unseen, experiment)
    assert left.prediction.torque_nm > 1e-3


def test_a_value_that_another_model_moves_is_no_estimate(result, error):
    told = judged(result, changed(error, -0.05))
    damping = told.estimate("viscous_damping")
    assert damping.status is Status.INADEQUATE
    assert damping.std > 0.05 * damping.value
    assert told.estimate("inertia").status is Status.VALID
    assert "goes with the speed" in told.verdict[0]
    assert "viscous damping" in told.verdict[1]
    assert "inertia" not in told.verdict[1]


def test_a_value_that_it_hardly_moves_stays_one(result, error):
    damping = result.estimate("viscous_damping")
    told = judged(result, changed(error, 0.3 * damping.std / damping.value)).estimate("viscous_damping")
    assert told.status is Status.VALID
    assert told.std >= damping.std


def test_what_only_looked_like_a_change_is_no_longer_said(result, error):
    doubt = FailedCheck("The inertia is not the same throughout.", midway=True)
    doubtful = replace(
        result,
        failed_checks=(doubt,),
        verdict=(doubt.sentence, *result.verdict),
        estimates=tuple(replace(each, status=Status.DOUBTFUL) for each in result.estimates),
    )
    explained = judged(doubtful, changed(error, -0.05))
    assert doubt.sentence not in explained.verdict
    assert explained.estimate("inertia").status is Status.VALID
    stays = judged(doubtful, changed(error, -0.05, CHANGE))
    assert doubt.sentence in stays.verdict
    assert stays.doubtful


def test_more_than_noise_that_nothing_explains_spoils_all(result, error):
    told = judged(result, replace(error, unexplained=True))
    assert all(each.status is Status.INADEQUATE for each in told.estimates)
    assert "nothing that was looked at explains it" in told.verdict[0]


@pytest.mark.parametrize(
    ("share", "scatter", "factor", "expected"),
    [
        (0.5, 0.05, None, 2.0),
        (0.5, 0.05, 0.8, 2.0),
        (0.5, 0.05, 1.5, nan),  # another encoder shows greater errors than the simulated one has
        (0.5, 0.3, None, nan),  # chance does that
        (0.7, 0.05, None, nan),  # most of what is left are errors of readings
    ],
)
def test_what_the_fit_leaves_is_compared_with_what_simulated_records_leave(result, share, scatter, factor, expected):
    bench = result.simulated.bench
    seen = None if factor is None else ErrorsSeen(factor, 0.1, np.zeros(9))
    bench = replace(bench, readings=replace(bench.readings, errors_seen=seen))
    left = share + scatter * np.linspace(-1.5, 1.5, 12)
    simulated = replace(result.simulated, left=left, bench=bench)
    assert _times_simulated(replace(result, simulated=simulated)) == pytest.approx(expected, nan_ok=True)


@pytest.mark.long
@pytest.mark.parametrize(("shaken_nm", "status"), [(0.0, Status.VALID), (1.4e-3, Status.INADEQUATE)])
def test_what_no_errors_of_readings_leave_spoils_all(varied, shaken_nm, status):
    """A torque at 20 to 60 Hz that comes from neither motor: about as much of the residual as the sensor's noise."""
    random, torque = np.random.default_rng(5), varied.torque.copy()
    spectrum = np.fft.rfft(random.standard_normal(len(torque)))
    frequency_hz = np.fft.rfftfreq(len(torque), TICK_S)
    shaken = np.fft.irfft(np.where((frequency_hz > 20.0) & (frequency_hz < 60.0), spectrum, 0.0), len(torque))
    torque["torque_nm"] += shaken_nm * shaken / np.std(shaken)
    found = judged_with_few_draws(replace(varied, torque=torque))
    assert found.result.estimate("inertia").status is status
    told = [text for text in found.result.verdict if "times the power that the readings' errors alone would" in text]
    assert bool(told) == bool(shaken_nm)


@pytest.mark.long
def test_the_zero_is_compared_with_the_tare(result, stretches, experiment, error):
    """0.3 s of 1 mN·m of noise tell the zero to 0.06 mN·m; what was read at rest stands where the two differ."""
    assert abs(error.zero.moved_nm) < 4 * error.zero.std_nm
    assert error.zero.standing_nm == 0.0
    assert error.zero.std_nm == pytest.approx(1e-3 / np.sqrt(300), rel=0.15)
    rest = experiment.segments[0]
    torque = experiment.torque.copy()
    torque["torque_nm"][torque["arrival_ns"] < rest.end_ns] -= 2e-3
    strained = replace(experiment, torque=torque)
    moved = error_of(result, stretches, (), strained)
    assert moved.zero.moved_nm == pytest.approx(error.zero.moved_nm + 2e-3, abs=1e-5)
    assert moved.prediction.torque_nm > 1.9e-3


def test_ratios_have_no_torque_to_be_off(result, stretches):
    ratios = replace(result, network=replace(result.network, provenance={"scale": "free motion only"}))
    assert expanded(ratios, stretches, ()) is None


def test_presliding_damping_below_zero_is_none_in_the_network(result, tmp_path):
    below = replace(
        result,
        network=replace(result.network, presliding_damping_nms_rad=-1e-4),
        estimates=tuple(
            replace(each, value=-1e-4, std=1e-5) if each.name == "presliding_damping" else each
            for each in result.estimates
        ),
    )
    told = possible(below)
    told.network.save(tmp_path / "network.json")
    assert NortonNetwork.load(tmp_path / "network.json").presliding_damping_nms_rad == 0.0
    assert told.estimate("presliding_damping").status is Status.AT_BOUND
    assert told.verdict[-1] == "Presliding damping comes out below zero: the network has none."
    assert possible(result) is result


def test_no_machine_has_a_negative_inertia(result):
    below = possible(replace(result, network=replace(result.network, inertia_kgm2=-1e-5)))
    assert beyond_bounds(below.network) == ("inertia",)
    assert "No network is written" in below.verdict[-1]


@pytest.mark.long
def test_a_fit_alone_is_judged_as_a_session_is(varied):
    """What a sweep reports: here with friction that is not the same both ways."""
    torque = varied.torque.copy()
    stamps = varied.motion["arrival_ns"].astype(float)
    velocity = np.gradient(varied.motion["position_rad"], stamps * 1e-9)
    speed = np.interp(torque["arrival_ns"].astype(float), stamps, np.abs(velocity))
    torque["torque_nm"] -= 2e-3 * (speed > 0.5)
    told = judged_with_few_draws(replace(varied, torque=torque)).result
    assert "friction differs between the two directions" in " ".join(told.verdict)
    assert told.estimate("coulomb_asymmetry").value == pytest.approx(0.1, abs=0.01)
    # The mean of both ways is what it was.
    assert told.estimate("coulomb_torque").value == pytest.approx(synthetic.Truth().coulomb_torque, rel=0.01)
