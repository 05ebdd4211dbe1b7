"""A motor behind a joint as equations, against its own compiled steps."""

import numpy as np
import pytest

from norton_bench.networks import nonlinear
from norton_bench.networks.checks import check
from norton_bench.networks.family import converted, coupled
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.motor import as_equations
from tests.bench.networks.some import JOINTS, MOTOR

TICK_S = 1e-4
TIME_S = np.arange(800) * TICK_S
COMMAND = 0.1 * np.sin(2 * np.pi * 20 * TIME_S)


def off(found, expected):
    return np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2))


@pytest.mark.parametrize("name", JOINTS)
def test_equations_and_compiled_steps_give_the_same_torque(name):
    """Within 0.5 % rms; with all terms 2 %, for the equations take the torque that loads the friction without σ1·φ̇."""
    position = 0.02 * (1 - np.cos(2 * np.pi * 15 * TIME_S))
    expected = JOINTS[name].torque(COMMAND, position, TICK_S)
    port = dict(zip(("x", "v", "a"), Motion.of_position(position, TICK_S).derivatives(), strict=True))
    equations = as_equations(JOINTS[name], form=Form.IMPEDANCE)
    assert equations.kind is Kind.THEVENIN
    found = nonlinear.respond(equations, COMMAND[:, None], port, TICK_S)["f"]
    assert off(found[2:-2], expected[2:-2]) < (2e-2 if "all" in name else 5e-3)
    assert off(expected, JOINTS[name].rigid.torque(COMMAND, position, TICK_S)) > 0.05


@pytest.mark.parametrize("name", JOINTS)
def test_equations_and_compiled_steps_move_alike(name):
    expected = JOINTS[name].free_motion(COMMAND, TICK_S)
    equations = converted(JOINTS[name], Kind.THEVENIN, Form.ADMITTANCE)
    found = nonlinear.respond(equations, COMMAND[:, None], {"f": np.zeros(TIME_S.size)}, TICK_S)
    assert off(found["x"], expected[0]) < 2e-3
    assert off(found["v"], expected[1]) < 2e-3


@pytest.mark.long
def test_a_load_on_a_joint_swings_as_two_bodies_do():
    """Beyond a stiff joint it moves as on the rigid motor; the joint of the test lets it swing."""
    body = Load(inertia_kgm2=4e-5)
    soft, rigid = (coupled(each, COMMAND, body, TICK_S) for each in (JOINTS["compliance"], MOTOR))
    assert off(soft.position_rad, rigid.position_rad) > 0.02
    acceleration = np.gradient(np.gradient(soft.position_rad, TICK_S), TICK_S)
    assert off(4e-5 * acceleration[5:-5], soft.exertion_nm[5:-5]) < 0.02


@pytest.mark.parametrize("name", JOINTS)
def test_there_is_no_norton_network_of_equations(name):
    with pytest.raises(NoConversionError, match="fourth derivative"):
        converted(JOINTS[name], Kind.NORTON, Form.ADMITTANCE)


@pytest.mark.parametrize("name", JOINTS)
def test_the_equations_come_back_from_their_file(name, tmp_path):
    written = as_equations(JOINTS[name], Kind.THEVENIN, Form.ADMITTANCE)
    save(written, tmp_path / "net.json")
    assert load(tmp_path / "net.json") == written


def test_play_leaves_the_port_without_torque_at_more_than_one_place():
    (unique,) = [each for each in check(JOINTS["backlash"]) if each.condition == "unique zero"]
    assert not unique.holds
    assert unique.interval_rad == pytest.approx(2e-3)
