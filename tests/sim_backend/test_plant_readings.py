"""What the plant's amplifiers do and what its encoders and sensors report: signs, noise, steps, delays."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from norton_sim import integrator as columns
from norton_sim.packing import pack
from norton_sim.plant import Plant
from norton_sim.truth import Truth, read_truth

RIG = Path(__file__).parents[2] / "rigs" / "sim-odrive.toml"
MS = 1_000_000


@pytest.fixture
def truth() -> Truth:
    return read_truth(tomllib.loads(RIG.read_text())["simulated"], seed=None, place="")


def changed(truth: Truth, table: str, **changes: object) -> Truth:
    return truth.model_copy(update={table: getattr(truth, table).model_copy(update=changes)})


def alone(truth: Truth) -> Truth:
    return truth.model_copy(update={"load": None})


def story(truth: Truth, seed: int) -> list[float]:
    """Every reading of a short experiment."""
    plant, readings = Plant(truth, seed), []
    for tick in range(1, 50):
        plant.command("actuator", 0.1 * math.sin(tick))
        plant.advance(tick * MS)
        readings += [plant.sensor_torque_nm(), plant.current_a("actuator"), plant.encoder_position_rad("load")]
    return readings


def test_the_same_seed_gives_the_same_readings_bit_for_bit(truth):
    assert story(truth, 4) == story(truth, 4)
    assert story(truth, 4) != story(truth, 5)


def test_reading_one_signal_leaves_the_others_noise_alone(truth):
    quiet, curious = Plant(truth, 1), Plant(truth, 1)
    for _ in range(10):
        curious.current_a("actuator")
        curious.current_a("load")
    assert curious.sensor_torque_nm() == quiet.sensor_torque_nm()


def test_sensor_noise_is_white_with_the_deviation_and_bias_written(truth):
    plant = Plant(truth, 11)
    samples = np.array([plant.sensor_torque_nm() for _ in range(20_000)])
    count, deviation = len(samples), truth.torque_sensor.noise_nm
    assert abs(samples.mean() - truth.torque_sensor.bias_nm) < 4 * deviation / math.sqrt(count)
    assert abs(samples.std() / deviation - 1) < 4 / math.sqrt(2 * count)
    noise = samples - samples.mean()
    assert abs(noise[1:] @ noise[:-1] / (noise @ noise)) < 4 / math.sqrt(count)


def test_current_noise_has_the_deviation_written_and_another_stream_for_each_machine(truth):
    truth = changed(truth, "load", current_noise_a=truth.actuator.current_noise_a)
    plant = Plant(truth, 11)
    samples = np.array([[plant.current_a("actuator"), plant.current_a("load")] for _ in range(10_000)])
    assert np.abs(samples.std(axis=0) / 5e-3 - 1).max() < 4 / math.sqrt(2 * len(samples))
    assert abs(np.corrcoef(samples.T)[0, 1]) < 4 / math.sqrt(len(samples))


def test_the_sensor_drifts_steadily_from_its_bias(truth):
    plant = Plant(changed(truth, "torque_sensor", noise_nm=0.0), 0)
    plant.advance(5000 * MS)
    assert plant.sensor_torque_nm() == pytest.approx(3e-3 + 5 * 2e-6, abs=1e-12)


def test_a_sensor_mounted_the_other_way_round_turns_the_torque_but_not_its_bias(truth):
    truth = changed(truth, "torque_sensor", noise_nm=0.0, drift_nm_s=0.0)
    readings = []
    for mounted in (1, -1):
        plant = Plant(changed(truth, "torque_sensor", mounted=mounted), 0)
        plant.command("actuator", 0.2)
        plant.advance(20 * MS)
        readings.append(plant.sensor_torque_nm() - 3e-3)
    assert readings[0] > 0.01
    assert readings[1] == pytest.approx(-readings[0])


def test_positive_port_torque_accelerates_the_load_forwards(truth):
    plant = Plant(truth, 0)
    plant.command("actuator", 0.2)
    plant.advance(20 * MS)
    assert plant.true_port_torque_nm() > 0.01
    assert plant.true_velocity_rad_s("load") > 1


def test_a_load_mounted_face_to_face_turns_and_reports_the_other_way(truth):
    plant = Plant(truth, 0)
    plant.command("load", 0.2)
    plant.advance(50 * MS)
    assert plant.true_velocity_rad_s("actuator") < -1
    assert plant.encoder_velocity_rad_s("actuator") < -1
    assert plant.encoder_velocity_rad_s("load") > 1
    assert plant.encoder_position_rad("load") == pytest.approx(-plant.true_position_rad("load"), abs=1e-4)
    assert plant.true_current_a("load") > 0


def test_positions_are_whole_counts_and_their_error_is_uniform_within_one(truth):
    plant = Plant(changed(truth, "actuator", counts_per_turn=4096), 0)
    plant.command("actuator", 0.1)
    step_rad, errors = math.tau / 4096, []
    for tick in range(1, 2001):
        plant.advance(tick * MS)
        reading = plant.encoder_position_rad("actuator")
        assert reading / step_rad == pytest.approx(round(reading / step_rad), abs=1e-6)
        errors.append((plant.true_position_rad("actuator") - reading) / step_rad)
    assert min(errors) >= 0
    assert max(errors) < 1
    assert np.mean(errors) == pytest.approx(1 / 2, abs=4 * math.sqrt(1 / 12 / 2000))
    assert np.var(errors) == pytest.approx(1 / 12, abs=4 * math.sqrt(1 / 180 / 2000))


def test_a_drive_estimates_velocity_with_a_critically_damped_tracking_loop(truth):
    """After a step of velocity the estimate is v (1 − (1 + b t) exp(−b t)), b the loop's bandwidth."""
    bandwidth, velocity = 100.0, 40.0
    drive = changed(truth, "actuator", counts_per_turn=2**24, encoder_bandwidth_rad_s=bandwidth)
    bench, state = pack(alone(drive), "free"), np.zeros((2, columns.STATE_COLUMNS))
    state[:, columns.CURRENT_RATE] = 1000.0
    bench.machines[columns.ACTUATOR, columns.INVERSE_INERTIA] = 0.0
    state[columns.ACTUATOR, columns.VELOCITY] = velocity
    for tick in range(100):
        columns.advance(state, bench.machines, 0.0, 0.0, bench.substep_s, tick * MS, (tick + 1) * MS)
        turned = bandwidth * (tick + 1) * 1e-3
        expected = velocity * (1 - (1 + turned) * math.exp(-turned))
        estimate = state[columns.ACTUATOR, columns.TRACKED_RATE] * math.tau / 2**24
        assert estimate == pytest.approx(expected, abs=0.02 * velocity)


def test_a_drive_at_rest_says_exactly_zero(truth):
    plant = Plant(alone(changed(truth, "actuator", encoder_bandwidth_rad_s=733.0)), 0)
    plant.command("actuator", 0.1)
    plant.advance(500 * MS)
    plant.release("actuator")
    plant.advance(3000 * MS)
    for tick in range(3000, 3050):
        plant.advance(tick * MS)
        assert plant.encoder_velocity_rad_s("actuator") == 0.0


def test_the_velocity_estimate_is_right_on_average(truth):
    plant = Plant(alone(truth), 0)
    plant.command("actuator", 0.05)
    plant.advance(1000 * MS)
    estimates, truths = [], []
    for tick in range(1001, 2001):
        plant.advance(tick * MS)
        estimates.append(plant.encoder_velocity_rad_s("actuator"))
        truths.append(plant.true_velocity_rad_s("actuator"))
    assert np.mean(estimates) == pytest.approx(np.mean(truths), rel=1e-4)
    assert 0 < np.std(np.array(estimates) - np.array(truths)) < 0.1


def test_the_amplifier_follows_its_command_with_a_first_order_lag(truth):
    plant = Plant(truth, 0)
    plant.command("actuator", 0.1)
    for tick in range(1, 10):
        plant.advance(tick * MS)
        expected = 18 * 0.1 * (1 - math.exp(-600 * tick * 1e-3))
        assert plant.true_current_a("actuator") == pytest.approx(expected, rel=1e-9)


def test_a_released_amplifier_gives_no_current_until_it_is_commanded_again(truth):
    plant = Plant(truth, 0)
    assert plant.true_current_a("actuator") == 0.0
    plant.command("actuator", 0.1)
    plant.advance(20 * MS)
    plant.release("actuator")
    plant.advance(21 * MS)
    assert abs(plant.true_current_a("actuator")) < 1e-3
    plant.advance(30 * MS)
    assert abs(plant.true_current_a("actuator")) < 1e-12
    plant.command("actuator", 0.1)
    plant.advance(50 * MS)
    assert plant.true_current_a("actuator") == pytest.approx(1.8, rel=1e-4)


def test_cogging_holds_the_rotor_in_its_detents(truth):
    """Against cogging stronger than friction, a displaced rotor comes to rest within one detent."""
    stiff = truth.actuator.cogging.model_copy(update={"amplitude_nm": 0.2, "periods_per_turn": 10})
    plant = Plant(alone(changed(truth, "actuator", cogging=stiff)), 0)
    plant.command("actuator", 0.15)
    plant.advance(1000 * MS)
    detent = 0.15 * 0.9 / 0.2
    friction = 0.02 / 0.2
    assert abs(math.sin(10 * plant.true_position_rad("actuator")) - detent) <= friction
    assert abs(plant.true_velocity_rad_s("actuator")) < 1e-6


def test_time_does_not_run_backwards(truth):
    plant = Plant(truth, 0)
    plant.advance(5 * MS)
    with pytest.raises(ValueError, match="cannot go back to 4000000 ns"):
        plant.advance(4 * MS)
    assert plant.now_ns == 5 * MS


def test_an_unknown_shaft_is_refused(truth):
    with pytest.raises(ValueError, match='should be "free" or "clamped"'):
        Plant(alone(truth), 0, "bent")
