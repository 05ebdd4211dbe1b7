"""Laws that a bench can render: the linear controller beside the one that runs, certificates beside the plant."""

import re
from dataclasses import replace
from functools import lru_cache
from math import inf
from operator import attrgetter

import numpy as np
import pytest

from norton_bench.arrays import FloatArray
from norton_bench.control.admittance import AdmittanceController
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.design import design_tracking, nominal_bench
from norton_bench.control.rendering import body_control, port_impedance, rendering, require_rendered
from norton_bench.control.robustness import control_response
from norton_bench.errors import ExperimentError
from norton_bench.procedures.waves import multisine
from norton_bench.sample import Sample, Target
from norton_bench.segments import ZERO_TORQUE, Admittance
from tests.bench.control.plant import ACTUATOR, Plant, PlantSettings, Side
from tests.bench.control.runs import LIMIT_NM, TICK_S, WARM_TICKS, calibrated, warmed_up

REST = Target()
in_words = attrgetter("words")
KEYS = {"mass": "mass_kgm2", "damping": "damping_nms_rad", "stiffness": "stiffness_nm_rad"}
# A body in something viscous, and two on springs.
RENDERED = (Admittance(5e-4, 2e-2), Admittance(1e-3, 3e-2, 1.0), Admittance(1e-3, 5e-2, 2.0))
# They oscillate where the actuator's friction sticks; and the last one lets the load run into its own delay.
REFUSED = (Admittance(5e-4), Admittance(5e-3), Admittance(damping_nms_rad=1e-2))


def without_friction(settings: PlantSettings) -> PlantSettings:
    """As good as none: the bench is linear."""

    def smooth(side: Side) -> Side:
        return replace(side, damping=1e-12, coulomb=1e-9, sigma_0=1e-9, sigma_1=1e-12)

    return replace(settings, actuator=smooth(settings.actuator), load=smooth(settings.load), cogging_nm=0.0)


@pytest.mark.parametrize("sticks", [False, True])
@pytest.mark.parametrize("law", RENDERED, ids=in_words)
def test_the_linear_controller_is_the_one_that_runs(law: Admittance, sticks: bool) -> None:
    """Any readings give the same commands: the observer, the body, the feed-forward and the regulator in one matrix."""
    # Delays between which the observer need not interpolate: sixteenths of a tick.
    settings = PlantSettings(serial_delay_s=0.5e-3)
    calibration = without_friction(settings).calibration()
    if sticks:  # whatever happens
        calibration = replace(settings.calibration(), coulomb_torque_nm=1e4)
    controller = AdmittanceController(calibration, TICK_S, LIMIT_NM)
    linear = body_control(calibration, design_tracking(calibration, TICK_S), law, TICK_S, sticks=sticks)
    readings = np.concatenate([np.zeros((5, 3)), 1e-6 * np.random.default_rng(1).standard_normal((60, 3))])
    state, expected, wished = np.zeros(len(linear.wish)), [], []
    for tick, (torque_nm, load_rad, actuator_rad) in enumerate(readings):
        sample = nominal_sample(tick, torque_nm, load_rad, actuator_rad)
        if tick == 0:
            controller.begin(sample, law)
        wished.append(controller.update(sample, REST, REST))
        controller.note_sent(wished[-1])
        expected.append(linear.wish @ state + linear.direct @ readings[tick])
        state = linear.step @ state + linear.entry @ readings[tick]
    assert np.ptp(expected) > 1e-6
    np.testing.assert_allclose(wished, expected, rtol=0.0, atol=(2e-3 if sticks else 1e-6) * np.ptp(expected))


def nominal_sample(tick: int, torque_nm: float, load_rad: float, actuator_rad: float) -> Sample:
    """Every reading half a tick old."""
    age_ns = round(0.5e9 * TICK_S)
    return Sample(
        round(tick * 1e9 * TICK_S),
        torque_nm=torque_nm,
        torque_age_ns=age_ns,
        torque_count=1,
        position_rad=actuator_rad,
        motion_age_ns=age_ns,
        motion_count=1,
        load_position_rad=load_rad,
        load_motion_age_ns=age_ns,
        load_motion_count=1,
    )


@pytest.mark.parametrize("law", RENDERED, ids=in_words)
def test_the_port_has_the_impedance_that_is_computed(law: Admittance) -> None:
    """An actuator so heavy that nothing stops it turns to and fro: its port's torque over its velocity is Z."""
    settings = without_friction(PlantSettings(torque_noise_nm=0.0, counts_per_turn=2**30))
    calibration = settings.calibration()
    linear = body_control(calibration, design_tracking(calibration, TICK_S), law, TICK_S)
    rates = 2 * np.pi * np.array([4.0, 12.0, 40.0]) * TICK_S
    bench = nominal_bench(calibration, TICK_S)
    expected = port_impedance(bench, control_response(linear, rates), rates, TICK_S)
    found = [shaken(settings, calibration, law, rate / (2 * np.pi * TICK_S)) for rate in rates]
    assert found == pytest.approx(list(expected), rel=0.02)


def shaken(settings: PlantSettings, calibration: LoadCalibration, law: Admittance, hertz: float) -> complex:
    """τ/ω of the plant at one frequency [a whole number], over the last second of three."""
    heavy_kgm2, omega, velocity_rad_s = 10.0, 2 * np.pi * hertz, 0.02
    actuator = replace(settings.actuator, inertia=heavy_kgm2, gain=1.0, beta=1e5)
    plant = Plant(replace(settings, actuator=actuator, can_jitter_s=0.0, serial_jitter_s=0.0))
    plant.state[1] = velocity_rad_s
    # Every reading comes in the middle of a tick, as old as the calibration has it on average.
    plant._period[:] = TICK_S
    plant._next[:] = (0.5 * TICK_S - np.array([settings.serial_delay_s, *2 * [settings.can_delay_s]])) % TICK_S
    controller, rows = AdmittanceController(calibration, TICK_S, 100.0), []
    for tick in range(3000):
        wish = 0.0
        if tick < WARM_TICKS:
            controller.observe(plant.sample())
        else:
            if tick == WARM_TICKS:
                controller.begin(plant.sample(), law)
            wish = controller.update(plant.sample(), REST, REST)
        controller.note_sent(wish)
        rows.append((port_torque(plant), plant.state[1]))
        # From its velocity at the end of a tick to that at the end of the next, whatever a delay makes of the phase.
        plant.step(-heavy_kgm2 * velocity_rad_s * omega * np.sin(omega * (tick + 0.5) * TICK_S), wish)
    torque, turning = np.array(rows)[2000:].T
    wave = np.exp(-1j * omega * np.arange(1000) * TICK_S)
    return complex((wave @ torque) / (wave @ turning))


def port_torque(plant: Plant) -> float:
    settings, x = plant.settings, plant.state
    return float(settings.stiffness * (x[0] - x[4]) + settings.damping * (x[1] - x[5]))


@lru_cache(maxsize=32)
def pushed(law: Admittance, kicked: bool = True, heavier: float = 1.0) -> FloatArray:
    """Port torque, and velocities of actuator and load, at the ticks, (ticks, 3): kicked once, or pushed all along."""
    settings, ticks = PlantSettings(), 6000
    calibration = calibrated(settings)
    settings = replace(settings, actuator=replace(ACTUATOR, inertia=heavier * ACTUATOR.inertia))
    plant, controller = warmed_up(settings, calibration)
    base = Target(plant.sample().load_position_rad)
    controller.begin(plant.sample(), law)
    command = np.where((np.arange(ticks) > 100) & (np.arange(ticks) < 300), 0.1, 0.0)
    if not kicked:
        command = 0.12 * multisine(ticks * TICK_S, TICK_S, low_hz=0.2, high_hz=40.0, seed=3, slope=-0.25)
    rows = []
    for value in command:
        wish = controller.update(plant.sample(), base, base)
        controller.note_sent(wish)
        rows.append((port_torque(plant), plant.state[1], plant.state[5]))
        plant.step(value, wish)
    return np.array(rows)


def left_at_rest_nm(law: Admittance, heavier: float = 1.0) -> float:
    """The alternating port torque, rms, some seconds after a kick."""
    return float(np.std(pushed(law, True, heavier)[-1500:, 0]))


@pytest.mark.parametrize("heavier", [1.0, 10.0, 1000.0])
@pytest.mark.parametrize("law", RENDERED, ids=in_words)
def test_a_law_with_a_certificate_comes_to_rest(law: Admittance, heavier: float) -> None:
    """Also with an actuator that is heavier than the calibration has it, or as good as held."""
    assert rendering(calibrated(PlantSettings()), TICK_S, law).heaviest_kgm2 == inf
    # The heaviest goes on turning to and fro on the spring, slowly.
    assert left_at_rest_nm(law, heavier) < (1e-3 if heavier < 1000.0 or law.stiffness_nm_rad == 0.0 else 3e-3)


@pytest.mark.parametrize("law", [Admittance(1e-4, 0.1), Admittance(1e-4, 5e-2)], ids=in_words)
def test_a_law_says_with_which_actuators_it_is_stable(law: Admittance) -> None:
    """Much damping and little mass: the load follows too late where the sensor's spring holds it to a heavy shaft."""
    calibration = calibrated(PlantSettings())
    result = rendering(calibration, TICK_S, law)
    assert result.lightest_kgm2 < ACTUATOR.inertia < result.heaviest_kgm2 < 50 * ACTUATOR.inertia
    assert np.isnan(result.needed_damping_nms_rad)
    assert left_at_rest_nm(law, result.heaviest_kgm2 / ACTUATOR.inertia) < 1e-3
    assert left_at_rest_nm(law, 1000.0) > 0.1


@pytest.mark.parametrize("law", REFUSED, ids=in_words)
def test_a_law_that_is_refused_oscillates(law: Admittance) -> None:
    assert rendering(calibrated(PlantSettings()), TICK_S, law).unstable
    assert left_at_rest_nm(law) > 3e-3


@pytest.mark.parametrize("law", REFUSED, ids=in_words)
def test_a_refusal_names_laws_that_come_to_rest(law: Admittance) -> None:
    with pytest.raises(ExperimentError, match=r"^this bench cannot render") as refused:
        require_rendered(calibrated(PlantSettings()), TICK_S, law)
    offers = offered(law, str(refused.value).partition("come to rest; ")[2])
    assert offers
    for offer in offers:
        assert offer != law
        assert left_at_rest_nm(offer) < 1e-3


def offered(law: Admittance, text: str) -> list[Admittance]:
    """Either values that each make the rest of the law one that can be rendered, or another law altogether."""
    single = {name: float(value) for name, value in re.findall(r"a (mass|damping|stiffness) of (\S+) ", text)}
    both = {name: float(value) for value, name in re.findall(r"(\S+) \S+ of (mass|damping|stiffness)", text)}
    if single:
        return [replace(law, **{KEYS[name]: value}) for name, value in single.items()]
    return [replace(law, **{KEYS[name]: value for name, value in both.items()})] if both else []


@pytest.mark.parametrize("law", RENDERED, ids=in_words)
def test_the_port_gives_back_no_more_energy_than_its_certificate_allows(law: Admittance) -> None:
    """Shaken where it gives back the most, it does; and less than the damping that it lacks would take."""
    settings = without_friction(PlantSettings(torque_noise_nm=0.0, counts_per_turn=2**30))
    calibration = settings.calibration()
    certificate = rendering(calibrated(PlantSettings()), TICK_S, law)
    linear = body_control(calibration, design_tracking(calibration, TICK_S), law, TICK_S)
    rates = 2 * np.pi * np.arange(20.0, 300.0) * TICK_S
    shown = port_impedance(nominal_bench(calibration, TICK_S), control_response(linear, rates), rates, TICK_S).real
    worst = int(np.argmin(shown))
    given_back = -shaken(settings, calibration, law, 20.0 + worst).real
    assert given_back == pytest.approx(-shown[worst], rel=0.1)
    assert 0.0 < given_back < certificate.needed_damping_nms_rad


def test_energy_that_came_back_is_what_body_and_spring_had_stored() -> None:
    """In the band in which the law is rendered nothing but them gives any back."""
    law = RENDERED[1]
    torque, _, turning = pushed(law, False).T
    turned = np.cumsum(turning) * TICK_S
    taken_j = np.cumsum(torque * turning) * TICK_S
    stored_j = 0.5 * law.mass_kgm2 * turning**2 + 0.5 * law.stiffness_nm_rad * turned**2
    lost_j = taken_j - stored_j
    by_damper_j = law.damping_nms_rad * np.cumsum(turning**2) * TICK_S
    assert lost_j[-1] == pytest.approx(by_damper_j[-1], rel=0.15)


WALL = Admittance(5e-4, 2e-2, 2.0, wall_rad=0.1)


def test_before_a_wall_the_body_is_free_and_in_it_the_spring_holds() -> None:
    """Pushed into it, the port's torque is that of the spring beyond its angle; pushed away, that of the damper."""
    settings = PlantSettings()
    plant, controller = warmed_up(settings, calibrated(settings))
    base = Target(plant.sample().load_position_rad)
    controller.begin(plant.sample(), WALL)
    rows = []
    for value in np.where(np.arange(4000) < 2000, 0.08, -0.05):
        wish = controller.update(plant.sample(), base, base)
        controller.note_sent(wish)
        rows.append((port_torque(plant), plant.state[4] - base.position_rad, plant.state[5]))
        plant.step(value, wish)
    torque, place, velocity = np.array(rows).T
    still, gone = slice(1700, 2000), slice(3700, 4000)
    assert np.std(torque[still]) < 1e-3
    assert np.mean(place[still]) == pytest.approx(0.1 + np.mean(torque[still]) / WALL.stiffness_nm_rad, abs=1e-3)
    assert np.mean(place[still]) > 0.12
    assert np.mean(place[gone]) < 0.0
    assert np.mean(velocity[gone]) == pytest.approx(np.mean(torque[gone]) / WALL.damping_nms_rad, rel=0.02)


def test_a_wall_is_rendered_where_the_laws_on_both_sides_are() -> None:
    calibration = calibrated(PlantSettings())
    before, behind = replace(WALL, stiffness_nm_rad=0.0, wall_rad=None), replace(WALL, wall_rad=None)
    sides = [rendering(calibration, TICK_S, each) for each in (before, behind)]
    both = rendering(calibration, TICK_S, WALL)
    assert both.law == WALL
    assert not both.unstable
    assert both.heaviest_kgm2 == min(each.heaviest_kgm2 for each in sides)
    # What goes over from one law into the other is not computed: nothing is said of other actuators.
    assert np.isnan(both.needed_damping_nms_rad)
    assert both.words.startswith("before the wall and behind it 0.0005 kg*m^2 of mass")
    assert both.words.endswith("and with one that is held")
    refused = replace(WALL, mass_kgm2=1e-3, damping_nms_rad=3e-2, stiffness_nm_rad=5.0)
    assert rendering(calibration, TICK_S, replace(refused, stiffness_nm_rad=0.0, wall_rad=None)).unstable
    assert rendering(calibration, TICK_S, refused).unstable
    with pytest.raises(ExperimentError, match=r"beyond 0\.1 rad: before the wall there is no mass and no damping"):
        rendering(calibration, TICK_S, Admittance(stiffness_nm_rad=2.0, wall_rad=0.1))


def test_a_law_is_in_words_without_what_is_zero() -> None:
    assert Admittance(5e-4, 0.0, 2.0).words == "0.0005 kg*m^2 of mass, 2 N*m/rad of stiffness"
    assert ZERO_TORQUE.words == "zero torque"
    assert WALL.words.endswith("2 N*m/rad of stiffness beyond 0.1 rad")
