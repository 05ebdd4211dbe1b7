"""The emulated position loop of an actuator in MIT mode, against the arithmetic of its firmware (foc.c)."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.rig.load import load_rig
from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.mit import Special
from norton_drivers.codecs.ranges import GoalCodes, Ranges
from norton_drivers.registry import load_backend
from tests.sim_backend.can_host import CanHost

RIG = Path(__file__).parents[2] / "rigs" / "sim-servo.toml"
RANGES = Ranges(3.2, 50.0, 2.0)
KP, KD = 16 * 500 / 4095, 18 * 5 / 4095  # what a frame makes of 2 N m/rad and 0.022 N m s/rad
AMPERES_PER_NM = 35.16 / KP
LIMIT_A = 8.0


@pytest.fixture
def bench():
    rig = load_rig(RIG)
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=1, place=rig.place)
    yield backend
    backend.close()


class Host(CanHost):
    extended = False

    def __init__(self, backend) -> None:
        super().__init__(backend, load_rig(RIG).wiring)

    def send(self, data: bytes) -> None:
        self.put(1, data)

    def goal(self, position_rad: float, ms: int) -> None:
        codes = GoalCodes(RANGES.goal_code(position_rad), RANGES.slowest_code, 16, 18, RANGES.command_code(0.0))
        for _ in range(ms // 10):
            self.send(protocol.goal_value(codes))
            self.wait(10)


def test_at_rest_the_current_is_that_of_kp_times_the_error(bench):
    host = Host(bench)
    host.plant.jam("actuator")
    host.goal(0.1, 10)
    host.send(Special.ENABLE.encode())
    host.goal(0.1, 50)
    # The codes of torque and velocity cannot be exactly zero: half a step of each stays.
    held_nm = KP * RANGES.commanded_rad(RANGES.goal_code(0.1)) + RANGES.commanded_nm(RANGES.command_code(0.0))
    held_nm -= KD * 0.5 * RANGES.velocity_step_rad_s
    assert host.current_a == pytest.approx(AMPERES_PER_NM * held_nm, abs=2e-3)


def test_the_current_has_a_limit(bench):
    host = Host(bench)
    host.plant.jam("actuator")
    host.send(Special.ENABLE.encode())
    host.goal(-1.0, 50)
    assert host.current_a == pytest.approx(-LIMIT_A, rel=1e-6)


def test_a_free_shaft_goes_to_its_goal_and_rests_within_friction(bench):
    host = Host(bench)
    host.send(Special.ENABLE.encode())
    for goal in np.linspace(0.0, 0.5, 20):
        host.goal(float(goal), 20)
    host.goal(0.5, 300)
    # Both machines' friction, over the stiffness of the loop.
    assert host.plant.true_position_rad("actuator") == pytest.approx(0.5, abs=(0.02 + 0.008) / (0.05 * 35.16))


def test_a_timeout_lets_go_of_the_shaft(bench):
    host = Host(bench)
    host.plant.jam("actuator")
    host.send(Special.ENABLE.encode())
    host.goal(0.1, 20)
    assert host.current_a > 1.0
    host.wait(400)
    assert host.current_a == pytest.approx(0.0, abs=1e-3)


def test_without_an_enable_nothing_is_held(bench):
    host = Host(bench)
    host.goal(0.2, 50)
    assert host.current_a == 0.0
