"""The emulated loop of an actuator in MIT mode whose command is a velocity, against the arithmetic of foc.c."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from norton_bench.rig.load import load_rig
from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.mit import Special
from norton_drivers.codecs.ranges import Ranges
from norton_drivers.registry import load_backend
from norton_drivers.spoken_to.goals import Goals
from tests.sim_backend.can_host import CanHost

RIG = Path(__file__).parents[2] / "rigs" / "sim-mit-velocity.toml"
RANGES = Ranges(3.2, 50.0, 2.0)
KD = 33 * 5 / 4095  # what a frame makes of 0.04 N m s/rad
AMPERES_PER_NM = 0.725 / KD
LIMIT_A = 8.0


class Host(CanHost):
    extended = False

    def __init__(self, backend, rig) -> None:
        super().__init__(backend, rig.wiring)
        self.goals = Goals(RANGES, rig.servo, protocol.goal_value)

    def send(self, data: bytes) -> None:
        self.put(1, data)

    def turn(self, velocity_rad_s: float, ms: int) -> float:
        """For so long; returns what was sent."""
        for _ in range(ms // 10):
            frame, sent_rad_s = self.goals.frame(velocity_rad_s, self.world.now_ns)
            self.send(frame)
            self.wait(10)
        return sent_rad_s


@pytest.fixture
def host() -> Iterator[Host]:
    rig = load_rig(RIG)
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=1, place=rig.place)
    yield Host(backend, rig)
    backend.close()


def test_a_jammed_shaft_feels_the_gain(host):
    host.plant.jam("actuator")
    host.turn(5.0, 10)
    host.send(Special.ENABLE.encode())
    sent_rad_s = host.turn(5.0, 50)
    assert host.current_a == pytest.approx(AMPERES_PER_NM * KD * sent_rad_s, abs=2e-3)


def test_the_current_has_a_limit(host):
    host.plant.jam("actuator")
    host.send(Special.ENABLE.encode())
    host.turn(-20.0, 50)
    assert host.current_a == pytest.approx(-LIMIT_A, rel=1e-6)


@pytest.mark.parametrize("velocity_rad_s", [8.0, -8.0])
def test_a_free_shaft_turns_as_fast_as_friction_lets_it(host, velocity_rad_s):
    host.send(Special.ENABLE.encode())
    sent_rad_s = host.turn(velocity_rad_s, 500)
    start_rad = host.plant.true_position_rad("actuator")
    host.turn(velocity_rad_s, 500)
    found_rad_s = (host.plant.true_position_rad("actuator") - start_rad) / 0.5
    gain = 0.05 * 0.725
    # Both machines' friction and damping, and the loop's: K·(c − ω) = τc + B·ω.
    friction_nm = 0.028 * (1 if velocity_rad_s > 0 else -1)
    assert found_rad_s == pytest.approx((gain * sent_rad_s - friction_nm) / (gain + 1.3e-3), rel=0.003)


def test_a_shaft_that_is_turned_is_held_back(host):
    """At a command of zero its torque is that of a damper, from the encoder's counts."""
    host.send(Special.ENABLE.encode())
    host.turn(10.0, 300)
    sent_rad_s = host.turn(0.0, 10)
    assert host.current_a < 0.0
    host.turn(0.0, 500)
    assert abs(sent_rad_s) < 0.02
    before_rad = host.plant.true_position_rad("actuator")
    host.turn(0.0, 200)
    assert host.plant.true_position_rad("actuator") == pytest.approx(before_rad, abs=1e-3)


def test_a_timeout_lets_go_of_the_shaft(host):
    host.plant.jam("actuator")
    host.send(Special.ENABLE.encode())
    host.turn(5.0, 20)
    assert host.current_a > 1.0
    host.wait(400)
    assert host.current_a == pytest.approx(0.0, abs=1e-3)


def test_without_an_enable_nothing_turns(host):
    host.turn(10.0, 50)
    assert host.current_a == 0.0
