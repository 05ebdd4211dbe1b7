"""The motor with its terms as equations, against its own compiled steps: torque under a motion, motion under a load."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.models.terms import TERM_BY_NAME, NetworkTerm
from norton_bench.networks import nonlinear
from norton_bench.networks.checks import check
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Motion
from norton_bench.networks.left_out import term_sentences
from norton_bench.networks.motor import as_equations
from norton_bench.networks.plots import plot
from tests.bench.networks.some import ALL_TERMS, JOINTS, MOTOR, MOTORS, coarser

TICK_S = 1e-4
TIME_S = np.arange(600) * TICK_S
ALL = {"none": MOTOR, **MOTORS, "all": ALL_TERMS}
# A step of the port's torque moves the rates at once; free_motion holds the port's torque as it holds the command.
PORT_NM = 0.01


def wave(hz, size, rng):
    """A smooth signal of no symmetry, zero at the start."""
    parts = [size / k * np.sin(2 * np.pi * hz * k * TIME_S + rng.uniform(0, 6)) for k in (1, 2, 3)]
    return sum(parts) - sum(parts)[0]


def off(found, expected):
    return np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2))


def test_there_is_a_motor_for_every_term():
    assert set(MOTORS) | (set(JOINTS) & set(TERM_BY_NAME)) == {
        name for name, term in TERM_BY_NAME.items() if not term.in_time
    }


def test_a_drift_is_of_its_session_and_in_no_equation():
    drifting = replace(MOTOR, terms=(NetworkTerm("gain_drift", (1e-3, 1e-6)), NetworkTerm("friction_drift", (1e-3, 0))))
    for kind in Kind:
        for form in Form:
            assert as_equations(drifting, kind, form) == as_equations(MOTOR, kind, form)
    (sentence, _) = term_sentences(drifting, ["gain_drift", "friction_drift"])
    assert sentence.endswith("holds for the middle of it.")


@pytest.mark.parametrize("name", ALL)
def test_equations_and_compiled_steps_give_the_same_torque(name):
    """Within 0.1 % rms, the differences' own error at 0.1 ms.

    Friction that grows with the port's torque: within 1 %, for the equations leave σ1·φ̇ out of that torque.
    """
    rng = np.random.default_rng(1)
    command, position = wave(30, 0.1, rng), wave(8, 0.2, rng)
    motion = Motion.of_position(position, TICK_S)
    expected = ALL[name].torque(command, position, TICK_S)
    effect = off(expected, MOTOR.torque(command, position, TICK_S))
    port = dict(zip(("x", "v", "a"), motion.derivatives(), strict=True))
    for kind in Kind:
        equations = as_equations(ALL[name], kind, Form.IMPEDANCE)
        found = nonlinear.respond(coarser(equations), command[:, None], port, TICK_S)["f"]
        error = off(found[2:-2], expected[2:-2])
        assert error < (1e-2 if name in ("load", "all") else 1e-3)
        assert effect > 10 * error or name == "none"


@pytest.mark.long
@pytest.mark.parametrize("name", ALL)
def test_equations_and_compiled_steps_move_alike_under_a_load(name):
    command = wave(20, 0.12, np.random.default_rng(1))
    given = {"port_torque_nm": PORT_NM, "longest_step_s": 2e-6}
    position, velocity, _ = ALL[name].free_motion(command, TICK_S, **given)
    assert off(position, MOTOR.free_motion(command, TICK_S, **given)[0]) > 3e-3 or name == "none"
    for kind in Kind:
        equations = as_equations(ALL[name], kind, Form.ADMITTANCE)
        found = nonlinear.respond(coarser(equations), command[:, None], {"f": np.full(TIME_S.size, PORT_NM)}, TICK_S)
        assert off(found["x"], position) < 3e-4
        assert off(found["v"], velocity) < 3e-4


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("form", Form)
def test_equations_with_terms_come_back_from_their_file(kind, form, tmp_path):
    written = as_equations(ALL_TERMS, kind, form)
    save(written, tmp_path / "net.json")
    assert load(tmp_path / "net.json") == written


def test_a_thevenin_connection_is_linear_unless_a_term_multiplies_its_source():
    linear = {name for name, motor in ALL.items() if as_equations(motor, Kind.THEVENIN).joined_linearly}
    assert linear == set(ALL) - {"load", "ripple", "all"}


def test_weak_friction_is_followed_in_shorter_steps():
    """γ of 0.7 at the least: the contact relaxes that much quicker."""
    stiff = replace(MOTOR, presliding_stiffness_nm_rad=100.0)
    weak = replace(stiff, terms=(replace(MOTORS["asymmetry"].terms[0], values=(0.3,)),))
    assert as_equations(weak).step_s == pytest.approx(0.7 * as_equations(stiff).step_s)


@pytest.mark.parametrize("name", ALL)
def test_only_friction_that_falls_with_the_speed_makes_the_source_ambiguous(name):
    findings = {each.condition: each for each in check(ALL[name])}
    falls = name in ("stribeck", "all")
    assert findings["impedance form"].holds
    assert findings["source is a zero"].holds
    assert findings["unique zero"].holds is not falls
    assert findings["stable zero dynamics"].holds is not falls
    by_place = name in ("friction_by_position", "ripple", "cogging", "all")
    assert ("mean over a turn" in findings["unique zero"].why) is by_place
    assert ("draws a shaft at rest" in findings["unique zero"].why) is (name in ("cogging", "all"))


def test_sliding_that_the_check_calls_unstable_does_not_last():
    """A shaft that slides steadily there, pushed by a little to either side, leaves that velocity."""
    network = MOTORS["stribeck"]
    low, high = 0.3, 2.0
    speed = 0.5 * (low + high)
    command = (0.02 + 0.008 * np.exp(-((speed / 2.0) ** 2)) + 1e-3 * speed) / 0.9
    start = {"motor_torque_nm": 0.9 * command, "friction_torque_nm": 0.9 * command - 1e-3 * speed}
    for nudge in (-0.01, 0.01):
        held = np.full(3000, command)
        _, velocity, _ = network.free_motion(held, 1e-3, velocity_rad_s=speed + nudge, **start)
        assert abs(velocity[-1] - speed) > 10 * abs(nudge)


def test_the_picture_of_sliding_has_the_terms_in_it():
    curves = [plot(motor, span=0.1).axes[1].lines[0].get_ydata() for motor in (MOTOR, ALL_TERMS)]
    assert np.abs(curves[0] - curves[1]).max() > 0.005
