"""Networks with terms: against the plain equations integrated by scipy, their own closed forms, and their files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME
from norton_bench.models.terms import COLUMNS, PERIODS, TERM_PARAMETERS, TERMS, Factor, NetworkTerm

MOTOR = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, "N*m")
TICK_S = 1e-3
SINGLE = (
    NetworkTerm("stribeck", (0.006, 5.0)),
    NetworkTerm("asymmetry", (0.1,)),
    NetworkTerm("load", (0.08,)),
    NetworkTerm("friction_by_position", (0.1, -0.05), 3),
    NetworkTerm("saturation", (20.0,)),
    NetworkTerm("ripple", (0.05, 0.02), 14),
    NetworkTerm("drag", (1e-5,)),
    NetworkTerm("cogging", (1e-3, 5e-4), 7.5),
)


def with_terms(*terms):
    return replace(MOTOR, terms=terms)


def strength(term, omega, theta, port):
    """γ·τc [N m], as docs/networks.md writes it."""
    values = term.values
    match term.name:
        case "stribeck":
            return 0.02 + values[0] * np.exp(-((omega / values[1]) ** 2))
        case "asymmetry":
            return 0.02 * (1 + values[0] * np.sign(omega))
        case "load":
            return 0.02 + values[0] * abs(port)
        case "friction_by_position":
            return 0.02 * (1 + values[0] * np.cos(3 * theta) + values[1] * np.sin(3 * theta))
    return 0.02


def motor_torque(term, torque, theta):
    """g·Km·Ka·lag(c) + τ(θ) [N m]."""
    values = term.values
    match term.name:
        case "saturation":
            return torque / (1 + values[0] * (torque / 0.9) ** 2)
        case "ripple":
            return torque * (1 + values[0] * np.cos(14 * theta) + values[1] * np.sin(14 * theta))
        case "cogging":
            return torque + values[0] * np.cos(7.5 * theta) + values[1] * np.sin(7.5 * theta)
    return torque


def by_scipy(term, command, port):
    """Angle and velocity at every tick, by an implicit method of high order; ``port`` [N m] is constant."""
    drag = term.values[0] if term.name == "drag" else 0.0
    state, states = np.zeros(4), []
    for held in command:
        states.append(state)

        def rate(_, x, held=held):
            torque, phi, omega, theta = x
            phi_rate = omega - 10.0 / strength(term, omega, theta, port) * abs(omega) * phi
            friction = 10.0 * phi + 0.01 * phi_rate + (1e-3 + drag * abs(omega)) * omega
            return [
                600.0 * (0.9 * held - torque),
                phi_rate,
                (motor_torque(term, torque, theta) - port - friction) / 5e-5,
                omega,
            ]

        state = solve_ivp(rate, (0, TICK_S), state, method="Radau", rtol=1e-7, atol=1e-10).y[:, -1]
    return np.array(states)


def test_the_table_says_everything_once():
    names = list({each.name: each for term in TERMS for each in term.parameters})
    said = {each for term in TERMS for each in term.parameters}
    assert len(said) == len(names)  # the joints of the table share theirs, word for word
    assert len(set(names) | set(BY_NAME)) == len(names) + len(BY_NAME)
    factors = [term for term in TERMS if term.factor is not Factor.TORQUE]
    columns = {each.column for term in factors for each in term.parameters}
    assert sorted([*columns, *PERIODS.values()]) == list(range(COLUMNS))
    assert set(PERIODS) == {term.name for term in factors if term.periodic}
    assert {each.over for each in TERM_PARAMETERS.values()} <= {"", *BY_NAME}


@pytest.mark.long
@pytest.mark.parametrize("term", SINGLE, ids=lambda term: term.name)
def test_free_motion_is_that_of_the_equations(term):
    port = 4e-3
    command = 0.07 * np.sin(2 * np.pi * 7 * np.arange(150) * TICK_S)
    position, velocity, _ = with_terms(term).free_motion(command, TICK_S, port_torque_nm=port, longest_step_s=2e-5)
    states = by_scipy(term, command, port)
    assert np.max(np.abs(velocity - states[:, 2])) < 2e-3 * np.max(np.abs(velocity))
    assert np.max(np.abs(position - states[:, 3])) < 2e-3 * np.max(np.abs(position))
    plain = MOTOR.free_motion(command, TICK_S, port_torque_nm=port)[1]
    assert np.max(np.abs(velocity - plain)) > 0.01 * np.max(np.abs(plain))


@pytest.mark.parametrize("term", SINGLE, ids=lambda term: term.name)
def test_the_source_is_the_zero_of_the_impedance(term):
    """Section III: Z(x_N, x_N) = 0. What remains is the sampling of velocity and acceleration once a tick."""
    network, fine_s = with_terms(term), 1e-4
    command = 0.06 * np.sin(2 * np.pi * 3 * np.arange(10_000) * fine_s)
    position, _, acceleration = network.free_motion(command, fine_s)
    torque = network.torque(command, position, fine_s)
    assert np.std(torque) < 0.01 * np.std(network.inertia_kgm2 * acceleration)


def test_friction_that_grows_with_the_load_is_solved_for():
    """Sliding against a port torque: τ = motor − B ω − (τc + μ|τ|), so |τ| is known in closed form."""
    network = with_terms(NetworkTerm("load", (0.08,)))
    position = 5.0 * np.arange(2000) * 1e-4
    torque = network.torque(np.full(2000, 0.08), position, 1e-4)
    expected = (0.9 * 0.08 - 1e-3 * 5.0 - 0.02) / 1.08
    assert torque[-10:-1] == pytest.approx(np.full(9, expected), rel=1e-5)


@pytest.mark.parametrize("term", [each for each in SINGLE if not each.term.periodic], ids=lambda term: term.name)
@pytest.mark.parametrize("level", [-0.09, -0.03, 0.01, 0.03, 0.09])
def test_free_motion_settles_on_the_static_source(term, level):
    network = with_terms(term)
    velocity = network.free_motion(np.full(1500, level), TICK_S)[1]
    assert velocity[-1] == pytest.approx(float(network.source_velocity(level)), rel=1e-3, abs=5e-3)


@pytest.mark.parametrize("term", [each for each in SINGLE if not each.term.periodic], ids=lambda term: term.name)
def test_a_shaft_at_rest_moves_beyond_its_thresholds(term):
    network = with_terms(term)
    for side in network.thresholds:
        still, moving = (network.free_motion(np.full(2000, share * side), TICK_S)[1][-1] for share in (0.98, 1.02))
        assert abs(still) < 1e-3
        assert moving * side > 0.0
        assert abs(moving) > 0.1


def test_a_gain_that_saturates_may_never_move_the_shaft():
    assert with_terms(NetworkTerm("saturation", (600.0,))).thresholds == (-np.inf, np.inf)


@pytest.mark.parametrize("terms", [SINGLE, SINGLE[:1], (SINGLE[-1], replace(SINGLE[-1], periods_per_turn=42))])
def test_a_file_keeps_every_term(terms, tmp_path):
    path = tmp_path / "network.json"
    network = with_terms(*terms)
    network.save(path)
    assert NortonNetwork.load(path) == network
    assert json.loads(path.read_text())["version"] == 2


def test_a_network_without_terms_is_written_as_ever(tmp_path):
    MOTOR.save(tmp_path / "network.json")
    content = json.loads((tmp_path / "network.json").read_text())
    assert content["version"] == 1
    assert "terms" not in content


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "warp"}, "knows no term 'warp'; it knows stribeck"),
        ({"parameters": {}}, "ripple_cosine needs a finite number"),
        ({"parameters": {"ripple_cosine": {"value": True}}}, "not True"),
        ({"periods_per_turn": 0}, "needs periods_per_turn above zero"),
        ({"periods_per_turn": "six"}, "needs periods_per_turn above zero, not 'six'"),
    ],
)
def test_a_term_that_is_none_is_refused_in_a_sentence(change, said, tmp_path):
    path = tmp_path / "network.json"
    with_terms(NetworkTerm("ripple", (0.05, 0.02), 14)).save(path)
    content = json.loads(path.read_text())
    content["terms"][0] |= change
    path.write_text(json.dumps(content))
    with pytest.raises(UsageError, match=said):
        NortonNetwork.load(path)


def test_drag_without_damping_to_be_a_factor_of_is_none():
    """Viscous damping that came out below zero is none in a network that is to be simulated."""
    network = replace(with_terms(NetworkTerm("drag", (1e-5,))), viscous_damping_nms_rad=-1e-4).dissipative()
    assert np.isfinite(network.free_motion(np.full(100, 0.05), TICK_S)[1]).all()


def test_damping_that_falls_holds_the_shaft_only_so_far():
    """B ω + D ω² is 25 mN·m at most, at B/(−2D) = 50 rad/s."""
    network = with_terms(NetworkTerm("drag", (-1e-5,)))
    speeds = network.source_velocity([(0.02 + 0.0249) / 0.9, (0.02 + 0.0251) / 0.9])
    assert 40.0 < speeds[0] < 50.0
    assert speeds[1] == np.inf


def test_a_command_that_turns_backwards_meets_the_friction_of_that_direction():
    forwards, backwards = (replace(with_terms(SINGLE[1]), torque_gain=gain) for gain in (0.9, -0.9))
    assert backwards.thresholds == pytest.approx(tuple(-each for each in reversed(forwards.thresholds)))


def test_a_contact_may_hold_more_at_rest_than_in_sliding():
    """Held at 24 of 26 mN·m by its command, a shaft stays where it is; an empty command moves nothing."""
    network = with_terms(SINGLE[0])
    held = {"motor_torque_nm": 0.024, "friction_torque_nm": 0.024}
    assert np.max(np.abs(network.free_motion(np.full(200, 0.024 / 0.9), TICK_S, **held)[1])) < 1e-3
    assert network.free_motion([], TICK_S)[0].size == 0
