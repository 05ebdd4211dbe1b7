"""When faults begin and end, and who is told."""

from collections.abc import Callable

import pytest

from norton_drivers.errors import WiringError
from norton_drivers.rehearsal import Rehearsal
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.faults.schema import Dropout, EncoderJump, Stuck
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
