"""When faults begin and end, and who is told; faults of drives, mechanics and the host."""

from collections.abc import Callable

import pytest

from norton_drivers.errors import WiringError
from norton_drivers.ports import Rehearsal
from norton_drivers.readings import DriveState
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.faults.schema import (
    BrokenCoupling,
    DriveError,
    Dropout,
    EncoderJump,
    Fault,
    HostStall,
    OverTemperature,
    Runaway,
    Stuck,
    Undervoltage,
)
from tests.sim_backend.faults.conftest import MS, Host

MakeHost = Callable[..., Host]
Bench = Callable[..., SimulatedBackend]


def test_times_count_from_the_injection(make_host: MakeHost) -> None:
    host = make_host()
    host.listen(100)
    (injected,) = host.backend.inject(Dropout(on="load", at_s=0.05, lasts_s=0.02))
    assert (injected.begun_ns, injected.ended_ns) == (None, None)
    host.listen(200)
    assert (injected.begun_ns, injected.ended_ns) == (150 * MS, 170 * MS)
    assert injected.said == "dropout on load (lasts_s = 0.02)"


def test_or_from_when_every_drive_is_armed(make_host: MakeHost) -> None:
    host = make_host(Stuck(on="load", after="armed", at_s=0.03))
    (injected,) = host.backend.injected
    host.listen(100)
    host.actuator.enable()
    host.link.keep_alive = lambda: host.actuator.command(0.0)
    host.listen(100)
    assert injected.begun_ns is None
    asked_ns = host.backend.clock.now_ns()
    host.load.enable()
    host.drive((0.0, 0.0), 50)
    assert injected.begun_ns is not None
    # Arming the watchdog comes first, for some milliseconds; that it is armed the drive says a heartbeat later.
    assert 30 * MS < injected.begun_ns - asked_ns < 40 * MS


def test_a_rig_file_holds_faults_and_a_wrong_one_is_refused(wiring: Wiring, open_bench: Bench) -> None:
    table = {"kind": "encoder-jump", "on": "load", "at": "10 ms", "by": "90 deg"}
    backend = open_bench(wiring, fault=[table])
    backend.clock.wait_until_ns(20 * MS)
    assert [injected.fault for injected in backend.injected] == [
        EncoderJump(on="load", at_s=0.01, by_rad=1.5707963267948966)
    ]
    assert backend.injected[0].begun_ns == 10 * MS
    with pytest.raises(WiringError, match=r"rig.toml: \[simulated.fault 1, encoder-jump\] by: \"90\" has no unit"):
        open_bench(wiring, fault=[{**table, "by": 90}])


def test_a_fault_that_has_no_place_is_refused(make_host: MakeHost) -> None:
    with pytest.raises(WiringError, match='"can1" is no place for dropout'):
        make_host().backend.inject(Dropout(on="can1"))


def test_the_simulated_backend_can_rehearse(make_host: MakeHost) -> None:
    assert isinstance(make_host().backend, Rehearsal)


def test_a_fault_of_a_drive_that_comes_and_goes_leaves_nothing_behind(make_host: MakeHost) -> None:
    host = make_host(Dropout(on="actuator", at_s=0.01, lasts_s=0.01), Dropout(on="actuator", at_s=0.05, lasts_s=0.01))
    host.listen(100)
    assert all(injected.ended_ns is not None for injected in host.backend.injected)
    assert len(host.actuator.take_motion()) == pytest.approx(80, abs=2)


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
