"""Zero torque by an observer that knows the actuator's friction, on a bench that nobody told it about."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from norton_bench.control import admittance, core, torque_loop
from norton_bench.control.admittance import AdmittanceController
from norton_bench.control.calibration import ActuatorFriction, LoadCalibration
from norton_bench.control.design import TorqueGains, design_torque_loop, design_tracking
from norton_bench.control.torque_loop import design_anticipation
from norton_bench.procedures.waves import hold
from norton_bench.sample import Target
from norton_bench.segments import ZERO_TORQUE
from tests.bench.control.plant import ACTUATOR, LOAD, Plant, PlantSettings, Side
from tests.bench.control.runs import (
    LIMIT_NM,
    TICK_S,
    calibrated,
    resized,
    slow_command,
    undriven_rms_nm,
    warmed_up,
    zero_torque_rms_nm,
)

FRICTION = ActuatorFriction(ACTUATOR.damping, ACTUATOR.coulomb, ACTUATOR.sigma_0, ACTUATOR.sigma_1)


def knowing(settings: PlantSettings, error: float = 1.05) -> LoadCalibration:
    """The calibration of all tests, which knows inertia and friction of the actuator with an ``error``, too."""
    side = settings.actuator
    friction = ActuatorFriction(side.damping, side.coulomb / error, error * side.sigma_0, side.sigma_1)
    return replace(calibrated(settings), actuator_inertia_kgm2=error * side.inertia, actuator_friction=friction)


def gains_of(calibration: LoadCalibration) -> TorqueGains:
    return design_torque_loop(calibration, design_tracking(calibration, TICK_S).observer, TICK_S)


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        PlantSettings(stiffness=50.0),
        PlantSettings(),
        PlantSettings(stiffness=1000.0),
        resized("actuator", 0.5),
        resized("load", 2.0),
        PlantSettings(counts_per_turn=8192),
    ],
    ids=["soft sensor", "demonstration", "stiff sensor", "light actuator", "heavy load", "coarse encoders"],
)
def test_feedback_that_knows_the_friction_holds_the_port_25_db_below_the_undriven_load(settings: PlantSettings) -> None:
    command = slow_command(3000)
    held_nm = zero_torque_rms_nm(settings, command, calibration=knowing(settings))
    assert 20 * np.log10(undriven_rms_nm(settings, command) / held_nm) > 25.0


@pytest.mark.long
@pytest.mark.parametrize("error", [0.8, 1.25])
def test_a_friction_and_an_inertia_that_are_far_off_leave_it_as_good_as_it_was(error: float) -> None:
    settings, command = PlantSettings(), slow_command(3000)
    held_nm = zero_torque_rms_nm(settings, command, calibration=knowing(settings, error))
    assert held_nm < 1.05 * zero_torque_rms_nm(settings, command)


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("heavier", ["actuator", "load"])
def test_quiet_at_rest_on_rigs_of_other_sizes(factor: float, heavier: str) -> None:
    settings = resized(heavier, factor)
    held_nm = zero_torque_rms_nm(settings, hold(0.0, 1.5, TICK_S), calibration=knowing(settings))
    assert held_nm < settings.torque_noise_nm


def test_against_a_stop_that_nobody_knows_of_it_stays_quiet() -> None:
    """The shaft was free when it was calibrated, and does not move now."""
    stopped = Side(0.0, 600.0, 1.0, 10.0, 10.0, 1e4, 10.0)
    calibration, still = knowing(PlantSettings()), hold(0.0, 1.5, TICK_S)
    assert zero_torque_rms_nm(PlantSettings(actuator=stopped), still, calibration=calibration) < 2e-3


def test_from_a_turning_shaft_it_takes_over_without_a_bump() -> None:
    """Until then the other observer watched, to which friction was a part of the free acceleration.

    The median, for a single overshoot is as great as the noise of the last readings has it.
    """
    assert np.median([_overshoot(PlantSettings(seed=seed)) for seed in range(1, 6)]) < 1.25


def _overshoot(settings: PlantSettings) -> float:
    """The greatest wish after the takeover, of what takes the load along at this acceleration."""
    plant, controller = warmed_up(settings, knowing(settings))
    wishes = []
    for tick in range(400):
        sample = plant.sample()
        if tick == 300:
            controller.begin(sample, ZERO_TORQUE)
        if tick < 300:
            controller.observe(sample)
        wishes.append(controller.update(sample, Target(), Target()) if tick >= 300 else 0.0)
        controller.note_sent(wishes[-1])
        plant.step(0.06, wishes[-1])
    return float(np.max(np.abs(wishes[300:])) / np.mean(wishes[-50:]))


@pytest.mark.long
def test_margins_tell_which_law_shakes_the_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    """With far too much feedback beside it no observer has margins; made to run all the same, it does shake."""
    settings = PlantSettings()
    calibration, command = knowing(settings), slow_command(1500)
    monkeypatch.setattr(torque_loop, "FEEDBACK_SHARE", 8.0)
    assert design_anticipation(calibration, gains_of(calibration), TICK_S) is None
    monkeypatch.setattr(torque_loop._Laws, "hold", lambda self, observer: True)
    monkeypatch.setattr(admittance, "_designed", admittance._designed.__wrapped__)  # one that nobody keeps
    assert zero_torque_rms_nm(settings, command, calibration=calibration) > undriven_rms_nm(settings, command)


@pytest.mark.parametrize("unknown", ["actuator_friction", "actuator_inertia_kgm2"])
def test_nothing_is_anticipated_of_an_actuator_that_is_not_known(unknown: str) -> None:
    calibration = replace(knowing(PlantSettings()), **{unknown: None})
    assert design_anticipation(calibration, gains_of(calibration), TICK_S) is None


@given(
    velocity=st.floats(-3.0, 3.0),
    free=st.floats(-1500.0, 1500.0),
    rate=st.floats(-3e4, 3e4),
    start=st.floats(-0.99, 0.99),
)
def test_the_torque_foreseen_is_that_of_the_differential_equations(
    velocity: float, free: float, rate: float, start: float
) -> None:
    lead_s = 1.2e-3
    laws = np.array([[LOAD.damping, LOAD.coulomb, LOAD.sigma_0, LOAD.sigma_1], list(vars(FRICTION).values())])
    contacts = np.array([[start * LOAD.coulomb, 0.0], [start * ACTUATOR.coulomb, 0.0]])
    inertias = np.array([LOAD.inertia, ACTUATOR.inertia])

    def acceleration(t: float, state: np.ndarray) -> float:
        return float(free + rate * t - core.friction(state[2], state[0], laws[1]) / ACTUATOR.inertia)

    def rates(t: float, state: np.ndarray) -> list[float]:
        v = state[0]
        slides = [law[2] * (v - abs(v) * force / law[1]) for law, force in zip(laws, state[1:], strict=True)]
        return [acceleration(t, state), *slides]

    end = solve_ivp(rates, (0.0, lead_s), [velocity, *contacts[:, 0]], rtol=1e-8, atol=1e-10).y[:, -1]
    needed_nm = LOAD.inertia * acceleration(lead_s, end) + core.friction(end[1], end[0], laws[0])
    found_nm = core.foreseen(velocity, free, rate, contacts, laws, inertias, lead_s)
    assert found_nm == pytest.approx(needed_nm, abs=1e-3)


def test_another_observer_goes_on_where_the_last_one_was() -> None:
    settings = PlantSettings()
    plant = Plant(settings)
    controller = AdmittanceController(knowing(settings), TICK_S, LIMIT_NM)
    for _ in range(300):
        controller.observe(plant.sample())
        controller.note_sent(0.0)
        plant.step(0.06, 0.0)
    before = controller._estimator.states.copy()
    controller.begin(plant.sample(), ZERO_TORQUE)
    assert not np.allclose(controller._estimator.states, before)  # friction is no part of the free acceleration now
    controller.begin(plant.sample(), ZERO_TORQUE, leads=True)
    np.testing.assert_allclose(controller._estimator.states, before)


@pytest.mark.parametrize("leads_before", [True, False])
def test_what_is_fed_forward_jumps_with_the_actuator_s_command(leads_before: bool) -> None:
    """It does where the second segment begins, whether the load was led along a motion until then or found its way."""
    settings = PlantSettings()
    plant = Plant(settings)
    calibration = calibrated(settings)
    controller = AdmittanceController(calibration, TICK_S, LIMIT_NM)
    for _ in range(20):
        controller.observe(plant.sample())
        controller.note_sent(0.0)
        plant.step(0.0, 0.0)
    controller.begin(plant.sample(), ZERO_TORQUE, leads=leads_before)
    wishes = []
    for acceleration in (0.0, 100.0):
        target = Target(0.0, 10.0, acceleration)
        for _ in range(5):
            wishes.append(controller.update(plant.sample(), target, target))
            controller.note_sent(wishes[-1])
        controller.begin(plant.sample(), ZERO_TORQUE, leads=True)
    needed_nm = 100.0 * calibration.inertia_kgm2 / calibration.torque_gain
    rise_nm = wishes[7] - wishes[4]  # a command arrives within a tick, and then acts along the reference
    assert rise_nm > 0.8 * needed_nm
