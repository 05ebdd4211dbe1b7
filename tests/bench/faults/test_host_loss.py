"""The host's process is killed, or stopped, while the shaft moves: real processes, sockets and a pseudo-terminal."""

from pathlib import Path

import pytest

from norton_bench.faults import host_loss
from norton_bench.faults.campaign import host_losses
from norton_bench.faults.case import Verdict
from norton_bench.faults.host_loss import lose_host
from norton_bench.faults.rehearse import longest_watchdog_s
from tests.bench.served import rig_of_its_own

KILLED, STOPPED = host_losses()
GROUP = "239.74.163.63"


@pytest.mark.wall_time
@pytest.mark.parametrize("case", [KILLED, STOPPED], ids=lambda case: case.table["kind"])
def test_the_drives_watchdogs_stop_the_shaft(case: object, tmp_path: Path) -> None:
    rig = rig_of_its_own(tmp_path, GROUP, backend="simulated")
    watchdog_s = longest_watchdog_s(rig)
    assert watchdog_s == 0.4
    outcome = lose_host(rig, case, watchdog_s, seed=1)
    assert outcome.verdict is Verdict.STOPPED, outcome
    # They were fed until the very end: not much sooner than their period, and not later than two ticks after it.
    assert 0.3 < outcome.off_s <= 0.402
    assert outcome.guard == "the drives' own watchdogs"
    assert outcome.drives == {"actuator": "idle", "load": "idle"}
    assert outcome.peak.velocity_rad_s > 1.0
    assert not (tmp_path / "bota").is_symlink()


@pytest.mark.wall_time
def test_a_host_that_ends_by_itself_is_no_lost_host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_loss, "SESSION", "no session")
    monkeypatch.setattr(host_loss, "TRIES", 1)
    outcome = lose_host(rig_of_its_own(tmp_path, GROUP, backend="simulated"), KILLED, 0.4)
    assert outcome.verdict is Verdict.FAILED
    assert outcome.guard.startswith("the host ended before it was lost: ")
    assert "is not TOML" in outcome.guard


@pytest.mark.wall_time
def test_what_this_machine_cannot_serve_is_skipped_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "bota").write_text("in the way")
    outcome = lose_host(rig_of_its_own(tmp_path, GROUP, backend="simulated"), KILLED, 0.4)
    assert outcome.verdict is Verdict.SKIPPED
    assert "something stands there that is not a simulated port" in outcome.guard
