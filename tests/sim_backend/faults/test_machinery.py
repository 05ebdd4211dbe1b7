"""Drives, mechanics and the host."""

from collections.abc import Callable

import pytest

from norton_drivers.readings import DriveState
from norton_sim.faults.schema import (
    BrokenCoupling,
    DriveError,
    Fault,
    HostStall,
    OverTemperature,
    Runaway,
    Stuck,
    Undervoltage,
)
from tests.sim_backend.faults.conftest import Host

MakeHost = Callable[..., Host]


@pytest.mark.parametrize("role", ["actuator", "load"])
@pytest.mark.parametrize(
    ("kind", "words"), [(DriveError, "fault"), (Undervoltage, "voltage too low"), (OverTemperature, "too hot")]
)
def test_a_drive_breaks_down_and_says_why(make_host: MakeHost, role: str, kind: type[Fault], words: str) -> None:
    host = make_host()
    host.enable()
    host.drive((0.1, 0.1), 20)
    host.backend.inject(kind(on=role, at_s=5e-3))
    host.drive((0.1, 0.1), 4)
    assert host.backend.world.plant.drives(role)
    host.drive((0.1, 0.1), 200)
    assert not host.backend.world.plant.drives(role)
    status = getattr(host, role).status()
    assert status.state is DriveState.FAULT
    assert any(words in error for error in status.errors)


def test_a_runaway_drive_obeys_no_command_but_does_stop(make_host: MakeHost) -> None:
    host = make_host()
    host.enable()
    plant = host.backend.world.plant
    host.backend.inject(Runaway(on="actuator", torque_nm=0.1, lasts_s=0.2))
    host.drive((-0.05, 0.0), 30)
    assert plant.true_current_a("actuator") == pytest.approx(0.1 / 0.05, rel=1e-3)
    host.actuator.stop()
    host.listen(20)
    assert not plant.drives("actuator")
    assert plant.true_current_a("actuator") == pytest.approx(0, abs=1e-6)
    host.listen(200)
    host.actuator.enable()
    host.drive((-0.05, 0.0), 30)
    assert plant.true_current_a("actuator") == pytest.approx(-0.05 * 18, rel=1e-3)


def test_a_drive_that_is_idle_does_not_run_away(make_host: MakeHost) -> None:
    host = make_host(Runaway(on="load", torque_nm=0.3))
    host.listen(50)
    assert not host.backend.world.plant.drives("load")


def test_a_stuck_load_stands_and_the_actuator_pulls_at_it(make_host: MakeHost) -> None:
    host = make_host()
    host.enable()
    host.drive((0.15, 0.0), 200)
    plant = host.backend.world.plant
    assert plant.true_velocity_rad_s("load") > 10
    host.backend.inject(Stuck(on="load", lasts_s=0.5))
    stands_at_rad = plant.true_position_rad("load")
    host.drive((0.15, 0.0), 400)
    assert plant.true_position_rad("load") == pytest.approx(stands_at_rad, abs=1e-9)
    # What the motor gives and its friction leaves is what the port carries, in the end.
    assert plant.true_port_torque_nm() == pytest.approx(0.9 * 0.15, abs=0.021)
    host.drive((0.15, 0.0), 300)
    assert plant.true_velocity_rad_s("load") > 10


def test_a_broken_coupling_carries_nothing(make_host: MakeHost) -> None:
    host = make_host()
    host.enable()
    host.drive((0.15, 0.0), 200)
    host.backend.inject(BrokenCoupling())
    host.drive((0.15, 0.0), 500)
    plant = host.backend.world.plant
    assert plant.true_port_torque_nm() == 0
    # The motor alone: (0.9 · 0.15 − 0.02) / 1e-3; the load's own friction stops it.
    assert plant.true_velocity_rad_s("actuator") == pytest.approx(115, rel=0.01)
    assert abs(plant.true_velocity_rad_s("load")) < 5


def test_the_world_goes_on_while_the_host_stands_still(make_host: MakeHost) -> None:
    host = make_host(HostStall(at_s=0.1005, lasts_s=0.15))
    host.listen(100)
    host.sensor.take_torque()
    host.listen(1)
    assert host.backend.clock.now_ns() == 250_500_000
    missed = host.sensor.take_torque()
    assert len(missed) == pytest.approx(150, abs=1)
    assert missed[-1].arrival_ns <= 250_500_000
    host.listen(1)
    assert host.backend.clock.now_ns() == 251_500_000
