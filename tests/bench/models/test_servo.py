"""A servo's network: its motion and torque against scipy, its source as the zero of its impedance, its file."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.checks import check
from norton_bench.networks.export.mjcf import export_mjcf
from norton_bench.networks.family import converted
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.settled import static_source
from norton_drivers.servo import Servo

TICK_S = 1e-3
SERVO = Servo(1.9536, 0.02198, delay_s=62.5e-6, window_s=500e-6)
NETWORK = NortonNetwork(1.758, 2000.0, 1e-4, 1e-3, 0.02, 10.0, 0.01, "rad", torque_limit_nm=0.4, servo=SERVO)
TIME_S = np.arange(1200) * TICK_S
GOAL = 0.3 * np.sin(2 * np.pi * 0.7 * TIME_S) + 0.1 * np.sin(2 * np.pi * 3.0 * TIME_S)


def by_scipy(network: NortonNetwork, goal: np.ndarray) -> np.ndarray:
    """The free motion with a loop that acts at once, by Radau's method."""
    limit, lead_s = network.torque_limit_nm / network.torque_gain, network.servo.of_velocity
    sigma_0, sigma_1, tau_c = 10.0, 0.01, 0.02

    def rate(_t: float, y: np.ndarray, asked: float) -> list[float]:
        angle, velocity, motor, phi = y
        error = min(max(asked - angle - lead_s * velocity, -limit), limit)
        slip = velocity - sigma_0 / tau_c * abs(velocity) * phi
        torque = motor - 1e-3 * velocity - sigma_0 * phi - sigma_1 * slip
        return [velocity, torque / 1e-4, 2000.0 * (network.torque_gain * error - motor), slip]

    state, places = np.zeros(4), []
    for asked in goal:
        places.append(state[0])
        state = solve_ivp(rate, (0.0, TICK_S), state, method="Radau", rtol=1e-7, atol=1e-10, args=(float(asked),)).y[
            :, -1
        ]
    return np.array(places)


@pytest.mark.long
def test_the_free_motion_is_scipys():
    at_once = replace(NETWORK, servo=Servo(1.9536, 0.02198))
    # A step that the limit holds is in it.
    goal = np.where(TIME_S[:300] > 0.1, GOAL[:300] + 0.4, GOAL[:300])
    expected = by_scipy(at_once, goal)
    assert at_once.free_motion(goal, TICK_S)[0] == pytest.approx(expected, abs=2e-3 * np.ptp(expected))


def test_the_source_is_the_zero_of_the_impedance():
    place = NETWORK.free_motion(GOAL, TICK_S)[0]
    left_nm = NETWORK.torque(GOAL, place, TICK_S)[20:]
    moving_nm = NETWORK.torque_gain * (GOAL - place)[20:]
    assert np.sqrt(np.mean(left_nm**2)) < 0.02 * np.sqrt(np.mean(moving_nm**2))


def test_held_away_from_its_goal_it_pulls_up_to_its_limit():
    held = np.full(400, 0.05)
    assert NETWORK.torque(held, np.zeros(400), TICK_S)[-1] == pytest.approx(1.758 * 0.05, rel=1e-6)
    assert NETWORK.torque(held + 1.0, np.zeros(400), TICK_S)[-1] == pytest.approx(0.4, rel=1e-6)


def test_delays_take_damping_off():
    """At low frequencies e^(−δs)/(1 + s/β) is 1 − (δ + 1/β)·s: what it takes off is K·(δ + 1/β)·ω."""
    angle = 0.02 * np.sin(2 * np.pi * 1.0 * TIME_S)
    velocity = np.gradient(angle, TICK_S)
    later = replace(NETWORK, servo=replace(SERVO, delay_s=SERVO.delay_s + 1e-3))
    change = later.torque(0.0 * angle, angle, TICK_S) - NETWORK.torque(0.0 * angle, angle, TICK_S)
    slope = float(change[100:] @ velocity[100:] / (velocity[100:] @ velocity[100:]))
    assert slope == pytest.approx(1.758 * 1e-3, rel=0.02)


def test_its_file_is_read_back(tmp_path):
    NETWORK.save(tmp_path / "servo.json")
    again = NortonNetwork.load(tmp_path / "servo.json")
    assert again == NETWORK
    assert json.loads((tmp_path / "servo.json").read_text())["servo"]["delay"] == {"value": 62.5e-6, "unit": "s"}


WITHOUT_GAIN = {key: {"value": 0} for key in ("stiffness", "damping", "delay")} | {"window": {"value": 1e-3}}


@pytest.mark.parametrize(
    "broken", [{}, WITHOUT_GAIN, {"stiffness": {"value": -1}}, 7, {"stiffness": {"value": "soft"}}]
)
def test_a_broken_servo_is_told_in_a_sentence(tmp_path, broken):
    NETWORK.save(tmp_path / "servo.json")
    content = json.loads((tmp_path / "servo.json").read_text())
    (tmp_path / "servo.json").write_text(json.dumps({**content, "servo": broken}))
    with pytest.raises(UsageError, match=r"servo.stiffness needs a positive number"):
        NortonNetwork.load(tmp_path / "servo.json")


def test_its_source_is_its_goal():
    source = static_source(NETWORK, [-0.5, 0.0, 0.3])
    assert (source.quantity, source.unit) == ("x_N", "rad")
    assert source.value == pytest.approx([-0.5, 0.0, 0.3])
    assert [finding.holds for finding in check(NETWORK)] == [True, True, True, True, None]


def test_what_cannot_be_written_as_equations_says_so():
    with pytest.raises(NoConversionError, match="a servo's loop acts on where the shaft was before"):
        converted(NETWORK, Kind.THEVENIN, Form.IMPEDANCE)
    with pytest.raises(UsageError, match="dcmotor takes no goals"):
        export_mjcf(NETWORK, "servo", dcmotor=True)
    with pytest.raises(UsageError, match="acts so late"):
        export_mjcf(replace(NETWORK, amplifier_bandwidth_rad_s=60.0), "servo")


def test_mujocos_position_actuator_follows_as_the_network_does():
    mujoco = pytest.importorskip("mujoco")
    exported = export_mjcf(NETWORK, "servo")
    model = mujoco.MjModel.from_xml_string(exported.text)
    data, places = mujoco.MjData(model), []
    for goal in GOAL:
        places.append(data.qpos[0])
        data.ctrl[0] = goal
        for _ in range(round(TICK_S / model.opt.timestep)):
            mujoco.mj_step(model, data)
    place = NETWORK.free_motion(GOAL, TICK_S)[0]
    assert np.sqrt(np.mean((place - places) ** 2)) < 0.01 * np.sqrt(np.mean(place**2))
    assert 'forcerange="-0.4 0.4"' in exported.text
    assert "Together that costs" in exported.left_out[0]
