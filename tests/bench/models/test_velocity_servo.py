"""The network of a servo that holds a velocity: motion and torque against scipy and by hand, its source, its file."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import port_torque_nm
from norton_bench.models.terms import TERM_BY_NAME, NetworkTerm
from norton_bench.networks.checks import check
from norton_bench.networks.export.mjcf import export_mjcf
from norton_bench.networks.export.robots import export_isaac_lab, export_urdf
from norton_bench.networks.family import converted
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.settled import static_source
from norton_drivers.servo import Servo

TICK_S = 1e-3
K, B, TAU_C = 0.03626, 1e-3, 0.02
SERVO = Servo(0.0, 0.04029, delay_s=62.5e-6, window_s=500e-6)
NETWORK = NortonNetwork(K, 2000.0, 1e-4, B, TAU_C, 10.0, 0.01, "rad/s", torque_limit_nm=0.4, servo=SERVO)
TIME_S = np.arange(1200) * TICK_S
ASKED = 6.0 * np.sin(2 * np.pi * 0.7 * TIME_S) + 2.0 * np.sin(2 * np.pi * 3.0 * TIME_S)


def by_scipy(network: NortonNetwork, asked_rad_s: np.ndarray) -> np.ndarray:
    """The free velocity with a loop that acts at once, by Radau's method."""
    limit, sigma_0, sigma_1 = network.torque_limit_nm / K, 10.0, 0.01

    def rate(_t: float, y: np.ndarray, asked: float) -> list[float]:
        velocity, motor, phi = y
        error = min(max(asked - velocity, -limit), limit)
        slip = velocity - sigma_0 / TAU_C * abs(velocity) * phi
        torque = motor - B * velocity - sigma_0 * phi - sigma_1 * slip
        return [torque / 1e-4, 2000.0 * (K * error - motor), slip]

    state, velocities = np.zeros(3), []
    for asked in asked_rad_s:
        velocities.append(state[0])
        state = solve_ivp(rate, (0.0, TICK_S), state, method="Radau", rtol=1e-7, atol=1e-10, args=(float(asked),)).y[
            :, -1
        ]
    return np.array(velocities)


@pytest.mark.long
def test_the_free_motion_is_scipys():
    at_once = replace(NETWORK, servo=Servo(0.0, 0.04029))
    # A step that the limit holds is in it.
    asked = np.where(TIME_S[:300] > 0.1, ASKED[:300] + 14.0, ASKED[:300])
    expected = by_scipy(at_once, asked)
    assert at_once.free_motion(asked, TICK_S)[1] == pytest.approx(expected, abs=5e-3 * np.ptp(expected))


def test_the_source_is_the_zero_of_the_impedance():
    place = NETWORK.free_motion(ASKED, TICK_S)[0]
    left_nm = NETWORK.torque(ASKED, place, TICK_S)[20:]
    assert np.sqrt(np.mean(left_nm**2)) < 0.02 * K * np.sqrt(np.mean(ASKED**2))


def test_held_it_pushes_up_to_its_limit_wherever_it_stands():
    still = np.full(400, 7.0)
    assert NETWORK.torque(np.full(400, 5.0), still, TICK_S)[-1] == pytest.approx(K * 5.0, rel=1e-6)
    assert NETWORK.torque(np.full(400, 50.0), still, TICK_S)[-1] == pytest.approx(0.4, rel=1e-6)


def test_turned_it_is_a_damper():
    """From its delay on: at an even speed the delays do nothing."""
    place = 3.0 * TIME_S
    expected = K * (5.0 - 3.0) - B * 3.0 - TAU_C
    assert NETWORK.torque(np.full(TIME_S.size, 5.0), place, TICK_S)[-50] == pytest.approx(expected, rel=1e-3)
    assert port_torque_nm(NETWORK, 5.0, 3.0) == pytest.approx(expected)


def test_delays_are_inertia_less():
    """At low frequencies s·e^(−Ds) is s − D·s²: that takes K·D off the inertia, D being delay and half the window."""
    angle = 0.2 * np.sin(2 * np.pi * 2.0 * TIME_S)
    acceleration = np.gradient(np.gradient(angle, TICK_S), TICK_S)
    later = replace(NETWORK, servo=replace(SERVO, delay_s=SERVO.delay_s + 0.5e-3, window_s=SERVO.window_s + 1e-3))
    change = later.torque(0.0 * angle, angle, TICK_S) - NETWORK.torque(0.0 * angle, angle, TICK_S)
    inner = slice(100, -100)
    slope = float(change[inner] @ acceleration[inner] / (acceleration[inner] @ acceleration[inner]))
    assert slope == pytest.approx(K * 1e-3, rel=0.02)


def test_its_source_has_the_three_branches_of_a_motor():
    commands = np.array([-8.0, 0.5, 8.0])
    expected = [-(K * 8.0 - TAU_C) / (K + B), 0.0, (K * 8.0 - TAU_C) / (K + B)]
    assert NETWORK.source_velocity(commands) == pytest.approx(expected)
    assert NETWORK.thresholds == pytest.approx((-TAU_C / K, TAU_C / K))
    source = static_source(NETWORK, commands)
    assert (source.quantity, source.unit) == ("v_N", "rad/s")
    for command, velocity in zip(commands, expected, strict=True):
        assert NETWORK.free_motion(np.full(600, command), TICK_S)[1][-1] == pytest.approx(velocity, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "values"),
    [("stribeck", (0.01, 0.8)), ("drag", (2e-4,)), ("saturation", (0.002,))],
)
def test_a_source_with_a_term_is_where_the_free_motion_ends(name, values):
    term = NetworkTerm(TERM_BY_NAME[name].name, values)
    network = replace(NETWORK, terms=(term,), torque_limit_nm=None)
    for command in (-9.0, 6.0):
        settled = network.free_motion(np.full(800, command), TICK_S)[1][-1]
        assert float(network.source_velocity(command)) == pytest.approx(settled, rel=2e-3)
        assert port_torque_nm(network, command, settled) == pytest.approx(0.0, abs=2e-4)


def test_its_file_is_read_back(tmp_path):
    NETWORK.save(tmp_path / "servo.json")
    assert NortonNetwork.load(tmp_path / "servo.json") == NETWORK
    written = json.loads((tmp_path / "servo.json").read_text())
    assert written["servo"]["stiffness"] == {"value": 0.0, "unit": "N*m/rad"}
    assert written["parameters"]["torque_gain"]["unit"] == "N*m/(rad/s)"


def test_its_conditions_hold_and_a_late_loop_does_not_settle():
    assert [finding.holds for finding in check(NETWORK)] == [True, True, True, True, False]
    late = replace(NETWORK, servo=replace(SERVO, delay_s=8e-3))
    (settles,) = (each for each in check(late) if each.condition == "stable zero dynamics")
    assert not settles.holds


def test_what_cannot_be_written_says_so():
    with pytest.raises(NoConversionError, match="a servo's loop acts on where the shaft was before"):
        converted(NETWORK, Kind.THEVENIN, Form.IMPEDANCE)
    for export in (export_urdf, export_isaac_lab):
        with pytest.raises(UsageError, match="takes an effort, and a servo none; export it --to mujoco"):
            export(NETWORK, "servo")
    with pytest.raises(UsageError, match="MuJoCo's dcmotor takes no goals"):
        export_mjcf(NETWORK, "servo", dcmotor=True)
    with pytest.raises(UsageError, match="the servo's loop acts so late that MuJoCo's actuators"):
        export_mjcf(replace(NETWORK, servo=replace(SERVO, delay_s=5e-3)), "servo")


def test_mujocos_servo_turns_as_the_network_does():
    mujoco = pytest.importorskip("mujoco")
    exported = export_mjcf(NETWORK, "servo")
    model = mujoco.MjModel.from_xml_string(exported.text)
    data, velocities = mujoco.MjData(model), []
    for asked in ASKED:
        velocities.append(data.qvel[0])
        data.ctrl[0] = asked
        for _ in range(round(TICK_S / model.opt.timestep)):
            mujoco.mj_step(model, data)
    velocity = NETWORK.free_motion(ASKED, TICK_S)[1]
    assert np.sqrt(np.mean((velocity - velocities) ** 2)) < 0.01 * np.sqrt(np.mean(velocity**2))
    assert 'forcerange="-0.4 0.4"' in exported.text
    assert "of the velocity's rms" in exported.left_out[0]
