"""The Norton network against the paper's equations, integrated by scipy, and against its own closed forms."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.network_steps import VELOCITY_TOLERANCE, dahl_flow, mean_velocity
from norton_bench.models.parameters import DahlMotor, PredictionError
from norton_bench.models.terms import NetworkTerm

NETWORK = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, "N*m")
TICK_S = 1e-3


def by_scipy(network, command):
    """The paper's own first-order equations, tick by tick, by an implicit method of high order."""
    motor = DahlMotor(
        Ka=network.torque_gain,
        beta=network.amplifier_bandwidth_rad_s,
        Km=1.0,
        Im=network.inertia_kgm2,
        B=network.viscous_damping_nms_rad,
        sigma_0=network.presliding_stiffness_nm_rad,
        sigma_1=network.presliding_damping_nms_rad,
        tau_c=network.coulomb_torque_nm,
    )
    state, states = np.zeros(4), []
    for held in command:
        states.append(state)

        def rate(_, x, held=held):
            current, phi, omega, _theta = x
            return [
                motor.current_rate(current, held),
                motor.dahl_rate(omega, phi),
                motor.acceleration(current, omega, phi, 0.0),
                omega,
            ]

        state = solve_ivp(rate, (0, TICK_S), state, method="Radau", rtol=1e-8, atol=1e-11).y[:, -1]
    return np.array(states)


@pytest.mark.long
def test_free_motion_is_the_papers():
    command = 0.06 * np.sin(2 * np.pi * 7 * np.arange(150) * TICK_S)
    position, velocity, acceleration = NETWORK.free_motion(command, TICK_S)
    states = by_scipy(NETWORK, command)
    assert np.max(np.abs(velocity - states[:, 2])) < 1e-3 * np.max(np.abs(velocity))
    assert np.max(np.abs(position - states[:, 3])) < 1e-3 * np.max(np.abs(position))
    assert np.corrcoef(acceleration[1:-1], np.gradient(states[:, 2], TICK_S)[1:-1])[0, 1] > 0.99


@given(st.floats(-0.2, 0.2))
@settings(max_examples=25)
def test_free_motion_settles_on_the_static_source(level):
    velocity = NETWORK.free_motion(np.full(1500, level), TICK_S)[1]
    assert velocity[-1] == pytest.approx(float(NETWORK.source_velocity(level)), abs=2e-3)


def test_the_source_has_three_branches():
    low, high = NETWORK.thresholds
    assert (low, high) == pytest.approx((-0.02 / 0.9, 0.02 / 0.9))
    assert NETWORK.source_velocity([low, 0.0, high]) == pytest.approx([0, 0, 0], abs=1e-12)
    assert NETWORK.source_velocity([-0.06, 0.06]) == pytest.approx([-34.0, 34.0])


def test_the_source_is_the_zero_of_the_impedance():
    """Section III: Z(x_N, x_N) = 0."""
    time_s = np.arange(3000) * TICK_S
    command = 0.06 * np.sin(2 * np.pi * 3 * time_s)
    position, _, acceleration = NETWORK.free_motion(command, TICK_S)
    torque = NETWORK.torque(command, position, TICK_S)
    # What remains is the sampling of velocity and acceleration once a tick.
    assert np.std(torque) < 0.02 * np.std(NETWORK.inertia_kgm2 * acceleration)


def test_the_impedance_at_constant_velocity_is_viscous():
    """Section IV.D: τ_act = B (ω_N − ω) while sliding."""
    position = 5.0 * np.arange(500) * TICK_S
    torque = NETWORK.torque(np.full(500, 0.06), position, TICK_S)
    expected = NETWORK.viscous_damping_nms_rad * (NETWORK.source_velocity(0.06) - 5.0)
    assert torque[-10:-1] == pytest.approx(np.full(9, expected), rel=1e-6)


@given(
    st.floats(1e-3, 5.0),
    st.lists(st.floats(-0.02, 0.02), min_size=1, max_size=40),
    st.floats(5.0, 5e4),
)
@settings(deadline=None)
def test_friction_is_bounded_and_minds_the_path_alone(fraction, displacements, s):
    phi = halves = min(fraction, 1.0) / s
    for displacement in displacements:
        phi = dahl_flow(phi, displacement, s)
        halves = dahl_flow(dahl_flow(halves, displacement / 2, s), displacement / 2, s)
        assert abs(phi) * s <= 1 + 1e-12
    assert phi == pytest.approx(halves, abs=1e-9 / s)


@given(
    torque=st.floats(-0.2, 0.2),
    velocity=st.floats(-100.0, 100.0),
    share=st.floats(-1.0, 1.0),
    step_s=st.sampled_from([1e-5, 1e-4, 1e-3]),
    sigma_1=st.sampled_from([0.0, 0.01]),
)
def test_the_mean_velocity_of_a_step_balances_its_momentum(torque, velocity, share, step_s, sigma_1):
    """From any state: a search that has come upon the root itself does not leave it again."""
    inertia, viscous, s, sigma_0 = 5e-5, 1e-3, 500.0, 10.0
    phi = share / s
    mean = mean_velocity(torque, velocity, phi, step_s, inertia, viscous, s, sigma_0, sigma_1)
    after = dahl_flow(phi, mean * step_s, s)
    friction = 0.5 * sigma_0 * (phi + after) + sigma_1 * (after - phi) / step_s
    inertial = 2.0 * inertia / step_s
    left = inertial * (mean - velocity) + viscous * mean + friction - torque
    # What rounding leaves of the largest of its terms, besides.
    assert abs(left) <= (inertial + viscous) * VELOCITY_TOLERANCE + 1e-14 * inertial * (abs(mean) + abs(velocity) + 1.0)


@given(st.floats(1e-5, 1e-3), st.floats(0.001, 0.2), st.floats(1.0, 1000.0), st.floats(0.0, 0.05))
@settings(max_examples=25)
def test_a_moving_rotor_only_loses_energy(inertia, coulomb, stiffness, damping):
    network = NortonNetwork(1.0, 600.0, inertia, 1e-4, coulomb, stiffness, damping, "N*m")
    velocity = network.free_motion(np.zeros(300), TICK_S, velocity_rad_s=30.0)[1]
    # Kinetic energy may come back from the contact's spring, but no more than the spring can hold.
    stored = coulomb**2 / (2 * stiffness)
    assert np.all(np.diff(0.5 * inertia * velocity**2) <= stored + 1e-12)
    assert abs(velocity[-1]) <= 30.0


positive = st.floats(1e-9, 1e9)


@given(st.lists(positive, min_size=7, max_size=7), st.none() | positive)
def test_a_file_gives_back_what_was_saved(tmp_path_factory, values, constant):
    path = tmp_path_factory.mktemp("network") / "n.json"
    network = NortonNetwork(
        *values, "A", torque_constant=constant, covariance_names=("inertia",), covariance=((1e-9,),)
    ).with_provenance({"recording": "x.mcap"})
    network.save(path)
    assert NortonNetwork.load(path) == network
    assert json.loads(path.read_text())["parameters"]["inertia"]["unit"] == "kg*m^2"


def damaged(change):
    content = {
        "format": "norton-network",
        "version": 1,
        "command_unit": "N*m",
        "parameters": {name: {"value": 1.0} for name in (
            "torque_gain", "amplifier_bandwidth", "inertia", "viscous_damping", "coulomb_torque",
            "presliding_stiffness", "presliding_damping",
        )},
        "covariance": {"names": [], "matrix": []},
    }  # fmt: skip
    change(content)
    return json.dumps(content)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not valid JSON"),
        ("[1, 2]", "not a network file"),
        ('{"format": "norton-network"', "line 1: not valid JSON"),
        (damaged(lambda c: c.update(version=9)), "version 9"),
        (damaged(lambda c: c.pop("command_unit")), '"command_unit" is missing'),
        (damaged(lambda c: c["parameters"].pop("inertia")), "parameters.inertia needs a finite number"),
        (damaged(lambda c: c["parameters"]["inertia"].update(value="heavy")), "not 'heavy'"),
        (damaged(lambda c: c["parameters"]["inertia"].update(value=-1)), "must be positive"),
        (damaged(lambda c: c["covariance"].update(names=["inertia"])), "covariance.matrix must be 1 rows"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence(tmp_path, text, says):
    path = tmp_path / "n.json"
    path.write_text(text)
    with pytest.raises(UsageError) as refused:
        NortonNetwork.load(path)
    assert says in str(refused.value)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_missing_or_binary_file_is_refused(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        NortonNetwork.load(tmp_path / "none.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="is not text"):
        NortonNetwork.load(tmp_path / "b.json")
    with pytest.raises(UsageError, match="cannot write"):
        NETWORK.save(tmp_path / "no" / "such" / "folder.json")


def test_what_the_port_exerts_slows_the_shaft_down():
    """Constant in sliding: the steady velocity less by the torque over the damping; and the impedance agrees."""
    command = np.full(1500, 0.08)
    free, held_back = (NETWORK.free_motion(command, TICK_S, port_torque_nm=torque) for torque in (0.0, 0.01))
    assert free[1][-1] - held_back[1][-1] == pytest.approx(0.01 / NETWORK.viscous_damping_nms_rad, rel=1e-6)
    wave = 0.01 * np.sin(2 * np.pi * 3 * np.arange(1500) * TICK_S)
    position, _, acceleration = NETWORK.free_motion(command, TICK_S, port_torque_nm=wave)
    torque = NETWORK.torque(command, position, TICK_S)
    assert torque[50:-5] == pytest.approx(wave[50:-5], abs=2e-4)
    assert acceleration[0] == 0.0


def test_other_values_are_those_of_the_network_and_of_its_terms():
    drag = NetworkTerm("drag", (3e-6,))
    network = replace(NETWORK, terms=(drag,))
    other = network.with_values({"inertia": 6e-5, "quadratic_drag": 4e-6, "unknown": 1.0})
    assert other == replace(network, inertia_kgm2=6e-5, terms=(NetworkTerm("drag", (4e-6,)),))


PREDICTION = PredictionError(3e-4, 0.1, 0.95, {"velocity": (-50.0, 51.0), "command": (-0.08, 0.08)})


@pytest.mark.parametrize("prediction", [None, PREDICTION])
def test_a_file_keeps_how_far_the_network_is_off(tmp_path, prediction):
    path = tmp_path / "network.json"
    replace(NETWORK, prediction=prediction).save(path)
    assert ("prediction" in json.loads(path.read_text(encoding="utf-8"))) == (prediction is not None)
    assert NortonNetwork.load(path).prediction == prediction


def test_what_was_not_seen_is_null_in_a_file(tmp_path):
    path = tmp_path / "network.json"
    replace(NETWORK, prediction=PredictionError(torque_nm=3e-4, level=0.9)).save(path)
    told = json.loads(path.read_text(encoding="utf-8"))["prediction"]
    assert told["free_velocity"] == {"value": None, "unit": "rad/s"}
    assert np.isnan(NortonNetwork.load(path).prediction.velocity_rad_s)


@pytest.mark.parametrize("wrong", [{}, [1], {"torque": 1, "free_velocity": 2, "level": 0.9, "ranges": {}}])
def test_a_wrong_prediction_is_refused_in_one_sentence(tmp_path, wrong):
    path = tmp_path / "network.json"
    NETWORK.save(path)
    content = json.loads(path.read_text(encoding="utf-8")) | {"prediction": wrong}
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(UsageError, match="prediction"):
        NortonNetwork.load(path)
