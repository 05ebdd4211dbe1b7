"""The controller on a bench that nobody told it about."""

from dataclasses import replace
from math import isnan, nan

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.control.preview import with_preview
from norton_bench.procedures.waves import Motion, hold, multisine_motion, velocity_steps
from norton_bench.sample import Target
from norton_bench.segments import PRESCRIBED_MOTION, ZERO_TORQUE, Admittance, LoadMode, Segment, Use
from tests.bench.control.plant import ACTUATOR, LOAD, PlantSettings
from tests.bench.control.runs import (
    TICK_S,
    at_rest,
    calibrated,
    driven,
    network_of,
    resized,
    slow_command,
    undriven_rms_nm,
    warmed_up,
    zero_torque_rms_nm,
)

REST = Target()


def decibels(larger: float, smaller: float) -> float:
    return 20 * np.log10(larger / smaller)


@pytest.mark.long
@pytest.mark.parametrize("stiffness", [50.0, 200.0, 1000.0])
def test_feedback_alone_holds_the_port_torque_20_db_below_the_undriven_load(stiffness: float) -> None:
    settings, command = PlantSettings(stiffness=stiffness), slow_command(3000)
    undriven, held = undriven_rms_nm(settings, command), zero_torque_rms_nm(settings, command)
    assert decibels(undriven, held) > 20.0


@pytest.mark.parametrize("stiffness", [50.0, 200.0, 1000.0])
def test_preview_of_a_nearly_true_network_holds_it_25_db_below(stiffness: float) -> None:
    settings, command = PlantSettings(stiffness=stiffness), slow_command(3000)
    segment = Segment("free", "multisine", Use.IDENTIFY, command, LoadMode.ADMITTANCE, ZERO_TORQUE)
    network = network_of(settings, 0.01)
    seen = with_preview(segment, network, calibrated(settings), settings.can_delay_s, TICK_S)
    motion = Motion(seen.position_rad, seen.velocity_rad_s, seen.acceleration_rad_s2)
    assert seen.preview
    assert decibels(undriven_rms_nm(settings, command), zero_torque_rms_nm(settings, command, motion)) > 25.0


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("heavier", ["actuator", "load"])
def test_quiet_at_rest_on_rigs_of_other_sizes(factor: float, heavier: str) -> None:
    """No cycle that feeds on the friction: the port torque stays below one reading's noise."""
    settings = resized(heavier, factor)
    assert zero_torque_rms_nm(settings, hold(0.0, 1.5, TICK_S)) < settings.torque_noise_nm


def test_a_contact_calibrated_far_too_stiff_does_not_make_the_observer_diverge() -> None:
    """Coarse encoders do not resolve a light load's contact: its damping alone would turn the shaft round each tick."""
    settings = PlantSettings(
        actuator=replace(ACTUATOR, inertia=1.5e-4, coulomb=5e-3),
        load=replace(LOAD, inertia=3.6e-5, coulomb=3.7e-3),
        stiffness=334.0,
        torque_noise_nm=0.45e-3,
        counts_per_turn=4096,
    )
    stiff = replace(calibrated(settings), presliding_stiffness_nm_rad=185.0, presliding_damping_nms_rad=0.4)
    plant, controller = warmed_up(settings, stiff)
    controller.begin(plant.sample(), ZERO_TORQUE, leads=True, mends_rad_s=0.4)
    for command in 3.0 * slow_command(3000):
        wish = controller.update(plant.sample(), Target(velocity_rad_s=plant.state[1]))
        controller.note_sent(wish)
        plant.step(command, wish)
        assert abs(wish) < 0.1


def test_prescribed_motion_is_followed_while_the_actuator_pushes() -> None:
    ticks = 3000
    settings = PlantSettings()
    motion = multisine_motion(ticks * TICK_S, TICK_S, low_hz=0.3, high_hz=10.0, seed=3).scaled(30.0)
    position, velocity, _ = driven(settings, calibrated(settings), slow_command(ticks), PRESCRIBED_MOTION, motion)
    error = velocity - motion.velocity_rad_s
    assert np.std(error[200:]) < 0.04 * np.std(motion.velocity_rad_s)
    assert np.max(np.abs(position - motion.position_rad)) < 0.05


def greatest_error_rad_s(settings: PlantSettings, motion: Motion, held_s: dict[int, float]) -> float:
    """Of the velocity, from just before the first tick from which readings are held back."""
    ticks = len(motion.velocity_rad_s)
    _, velocity, _ = driven(settings, calibrated(settings), np.zeros(ticks), PRESCRIBED_MOTION, motion, held_s)
    return float(np.max(np.abs(velocity - motion.velocity_rad_s)[min(held_s) - 10 :]))


@pytest.mark.parametrize("held_s", [5.3e-3, 12.1e-3, 12.7e-3, 20.1e-3, 33.4e-3])
def test_readings_that_a_bus_holds_back_do_not_upset_a_turning_shaft(held_s: float) -> None:
    """All of them come, only late: nothing is lost but the time in which the motion is not mended."""
    motion = velocity_steps(np.array([40.0]), 0.2, 0.8, TICK_S)
    assert greatest_error_rad_s(PlantSettings(), motion, {500: held_s}) < 3.0


@pytest.mark.parametrize("held_ticks", [3, 8])
@pytest.mark.parametrize("seed", [1, 2])
def test_readings_that_come_in_bursts_again_and_again_keep_the_shaft_under_control(held_ticks: int, seed: int) -> None:
    """A gain for every tick would take the error of a whole pause for an acceleration, and the shaft would run away."""
    motion = multisine_motion(1.5, TICK_S, low_hz=0.3, high_hz=10.0, seed=3).scaled(30.0)
    bursts = dict.fromkeys(range(700, 1000, held_ticks + 2), (held_ticks + 0.3) * TICK_S)
    assert greatest_error_rad_s(PlantSettings(seed=seed), motion, bursts) < 4.0


def test_velocity_steps_settle_on_the_velocity() -> None:
    settings = PlantSettings()
    motion = velocity_steps(np.array([20.0, -40.0, 60.0]), 0.2, 0.3, TICK_S)
    command = np.zeros(len(motion.velocity_rad_s))
    _, velocity, _ = driven(settings, calibrated(settings), command, PRESCRIBED_MOTION, motion)
    for plateau, wanted in ((400, 20.0), (900, -40.0), (1400, 60.0)):
        assert np.mean(velocity[plateau : plateau + 80]) == pytest.approx(wanted, rel=0.01)


def test_a_finite_law_moves_as_its_closed_form_says() -> None:
    """M dv/dt + B v + K x = τ against scipy, pulled by the torque that the port really carried."""
    settings, law = PlantSettings(), Admittance(mass_kgm2=4e-4, damping_nms_rad=4e-3, stiffness_nm_rad=0.2)
    ticks = 2000
    command = 0.15 * np.sign(np.sin(2 * np.pi * 1.5 * np.arange(ticks) * TICK_S))
    position, _, _ = driven(settings, calibrated(settings), command, law, at_rest(ticks))
    torque_nm = _port_torque(settings, command, law)
    times = np.arange(ticks) * TICK_S

    def rates(t: float, state: np.ndarray) -> list[float]:
        pull = np.interp(t, times, torque_nm) - law.damping_nms_rad * state[1] - law.stiffness_nm_rad * state[0]
        return [state[1], pull / law.mass_kgm2]

    closed = solve_ivp(rates, (0.0, times[-1]), [0.0, 0.0], t_eval=times, max_step=TICK_S).y[0]
    assert np.std(position - closed) < 0.05 * np.std(closed)


def _port_torque(settings: PlantSettings, command: np.ndarray, law: Admittance) -> np.ndarray:
    plant, controller = warmed_up(settings, calibrated(settings))
    base = Target(plant.sample().load_position_rad)
    controller.begin(plant.sample(), law)
    torque = []
    for value in command:
        wish = controller.update(plant.sample(), base, base)
        controller.note_sent(wish)
        twist, slip = plant.state[0] - plant.state[4], plant.state[1] - plant.state[5]
        torque.append(settings.stiffness * twist + settings.damping * slip)
        plant.step(value, wish)
    return np.array(torque)


@pytest.mark.parametrize("admittance", [ZERO_TORQUE, PRESCRIBED_MOTION])
def test_taking_over_continues_from_what_was_sent(admittance: Admittance) -> None:
    settings = PlantSettings()
    plant, controller = warmed_up(settings, calibrated(settings))
    held_nm = 0.005  # within the friction: nothing moves
    for _ in range(200):
        controller.observe(plant.sample())
        controller.note_sent(held_nm)
        plant.step(0.0, held_nm)
    sample = plant.sample()
    controller.begin(sample, admittance)
    wish = controller.update(sample, Target(sample.load_position_rad), Target(sample.load_position_rad))
    assert wish == pytest.approx(held_nm, abs=0.003)


@pytest.mark.parametrize("signal", ["torque_nm", "position_rad", "load_position_rad"])
def test_nan_in_gives_nan_out_and_leaves_no_trace(signal: str) -> None:
    plant, controller = warmed_up(PlantSettings(), calibrated(PlantSettings()))
    controller.begin(plant.sample(), ZERO_TORQUE)
    assert isnan(controller.update(plant.sample()._replace(**{signal: nan}), REST, REST))
    controller.note_sent(0.0)
    plant.step(0.0, 0.0)
    assert abs(controller.update(plant.sample(), REST, REST)) < 0.02


def test_wishes_stay_within_the_limit() -> None:
    plant, controller = warmed_up(PlantSettings(), calibrated(PlantSettings()))
    controller.begin(plant.sample(), ZERO_TORQUE)
    sample = plant.sample()._replace(torque_nm=1e3)
    assert controller.update(sample, REST, REST) == controller.torque_limit_nm
