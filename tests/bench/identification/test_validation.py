"""Prediction of the unseen, and the static maps."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.errors import ExperimentError
from norton_bench.identification.results import SensorZero
from norton_bench.identification.signals import signals
from norton_bench.identification.source_map import blocked_map, source_map
from norton_bench.identification.validation import validate, validate_signals
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Bench, Truth


@pytest.fixture(scope="module")
def free_shaft():
    """A load so light that what control leaves over at the port cannot matter."""
    return Bench(load=Truth(1.0, 1000.0, 1e-7, 1e-8, 1e-7, 1e-3, 1e-9), stiffness=20.0, damping=1e-3)


def test_unseen_torque_is_predicted_to_the_noise(result):
    validation = validate(result, synthetic.validation(9), tick_s=TICK_S)
    assert validation.torque_rms_nm < 0.8e-3
    assert validation.torque_relative < 0.06


def test_a_wrong_network_shows(result):
    wrong = replace(result, network=replace(result.network, inertia_kgm2=1.2 * result.network.inertia_kgm2))
    right = validate(result, synthetic.validation(9), tick_s=TICK_S)
    assert validate(wrong, synthetic.validation(9), tick_s=TICK_S).torque_rms_nm > 1.5 * right.torque_rms_nm


def test_unseen_free_motion_is_predicted(result, free_shaft):
    measured = synthetic.validation(9, bench=free_shaft)
    validation = validate(result, measured, tick_s=TICK_S)
    assert validation.velocity_relative < 0.06
    assert validation.velocity.unit == "rad/s"


def test_a_torque_left_at_the_port_is_no_error_of_the_prediction(result):
    """On the bench's own load, whose control leaves torque at the port; and a wrong zero of the sensor does show."""
    measured = synthetic.validation(9)
    zero = SensorZero.constant(result.torque_bias_nm)
    segments = [segment for segment in measured.segments if segment.use is Use.VALIDATE]
    stretches = signals(measured, TICK_S, Use.VALIDATE)
    known = validate_signals(result, stretches, segments, zero=zero)
    ignored = validate_signals(result, _without_torque(stretches), segments, zero=SensorZero.constant(0.0))
    assert known.velocity_rms_rad_s < 1.5 * known.velocity_noise_rad_s  # drawn with 80 independent values: ± 8 %
    assert ignored.velocity_rms_rad_s > 2 * known.velocity_rms_rad_s
    # White noise of 1 mN·m at 1 kHz through 1/(I s + B), where the shaft slides: sqrt(S / (2 I B)) = 0.1 rad/s.
    assert 0.03 < known.velocity_noise_rad_s < 0.1
    wrong = validate_signals(result, stretches, segments, zero=zero.moved(0.5e-3))
    assert wrong.velocity_rms_rad_s > 3 * known.velocity_rms_rad_s  # 0.5 rad/s, while it slides
    assert wrong.torque_rms_nm > known.torque_rms_nm


def _without_torque(stretches):
    """As if nothing had been left at the port."""
    return tuple(replace(each, torque_nm=None) for each in stretches)


def test_without_unseen_segments_it_refuses(experiment, result):
    with pytest.raises(ExperimentError, match="validate"):
        validate(result, experiment, tick_s=TICK_S)


def test_the_source_map_shows_the_three_branches(free_shaft):
    measured = synthetic.experiment(4, bench=free_shaft, blocked=False, imposed=False)
    found, truth = source_map(measured), Truth()
    torque = truth.torque_gain * found.command
    expected = np.sign(torque) * np.maximum(np.abs(torque) - truth.coulomb_torque, 0) / truth.viscous_damping
    assert len(found.command) == 22
    assert found.rising.sum() == 11
    # Cogging of 0.3 mN·m over 1 mN·m·s/rad leaves 0.3 rad/s of doubt next to the threshold.
    assert np.all(np.abs(found.velocity_rad_s - expected) < 0.35 + 4 * found.velocity_std_rad_s)


def test_the_blocked_map_shows_the_ambiguity_of_friction(experiment):
    """Section IV.D: the torque at standstill differs by 2 τc between the two sides of approach."""
    found, truth = blocked_map(experiment), Truth()
    above = found.torque_nm[found.from_above]
    below = found.torque_nm[~found.from_above]
    assert below - above == pytest.approx(np.full(5, 2 * truth.coulomb_torque), abs=3e-3)
    assert np.polyfit(found.command, found.torque_nm, 1)[0] == pytest.approx(truth.torque_gain, rel=0.02)


def test_maps_refuse_what_was_not_measured():
    measured = synthetic.calibration(1)
    with pytest.raises(ExperimentError, match="staircase"):
        source_map(measured)
    with pytest.raises(ExperimentError, match="held level"):
        blocked_map(measured)
