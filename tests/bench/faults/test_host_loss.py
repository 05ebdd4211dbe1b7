"""The host's process is killed, or stopped, while the shaft moves: real processes, sockets and a pseudo-terminal."""

from pathlib import Path

import pytest

from norton_bench.faults import host_loss
from norton_bench.faults.campaign import host_losses
from norton_bench.faults.case import Allowed, Verdict
from norton_bench.faults.host_loss import lose_host
from norton_bench.faults.rehearse import allowed_on
from norton_bench.rig.load import load_rig
from tests.bench.half_rate import HALF_RATE
from tests.bench.served import rig_of_its_own

pytestmark = pytest.mark.long

KILLED, STOPPED = host_losses()
RIGS = Path(__file__).parents[3] / "rigs"
ALLOWED = Allowed(404_000_000)  # the watchdog's period, and two ticks
GROUP = "239.74.163.63"


@pytest.mark.wall_time
@pytest.mark.parametrize("case", [KILLED, STOPPED], ids=lambda case: case.table["kind"])
def test_the_drives_watchdogs_stop_the_shaft(case: object, tmp_path: Path) -> None:
    rig = rig_of_its_own(tmp_path, GROUP, backend="simulated", **HALF_RATE)
    allowed = allowed_on(rig)
    assert allowed == ALLOWED
    outcome = lose_host(rig, case, allowed, seed=1)
    assert outcome.verdict is Verdict.STOPPED, outcome
    # They were fed until the very end: not much sooner than their period, and not later than two ticks after it; a busy
    # computer may take some milliseconds to send the signal.
    assert 0.3 < outcome.off_s <= outcome.allowed_s
    assert 0.404 <= outcome.allowed_s < 0.5
    assert outcome.guard == "the drives' own watchdogs"
    assert outcome.drives == {"actuator": "idle", "load": "idle"}
    assert outcome.peak.velocity_rad_s > 1.0
    assert not (tmp_path / "bota").is_symlink()


@pytest.mark.wall_time
def test_servos_without_a_watchdog_go_on(tmp_path: Path) -> None:
    text = (RIGS / "sim-feetech.toml").read_text(encoding="utf-8")
    for port in ("socket://localhost:7714", "socket://localhost:7715"):
        text = text.replace(port, str(tmp_path / port[-4:]))
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    rig = load_rig(tmp_path / "rig.toml", backend="simulated")
    outcome = lose_host(rig, KILLED, allowed_on(rig), seed=1)
    assert outcome.verdict is Verdict.NO_WATCHDOG, outcome
    assert outcome.drives == {"actuator": "drives", "load": "drives"}
    assert outcome.guard == "nothing stopped the drives"


@pytest.mark.wall_time
def test_a_host_that_ends_by_itself_is_no_lost_host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_loss, "SESSION", "no session")
    monkeypatch.setattr(host_loss, "TRIES", 1)
    outcome = lose_host(rig_of_its_own(tmp_path, GROUP, backend="simulated", **HALF_RATE), KILLED, ALLOWED)
    assert outcome.verdict is Verdict.FAILED
    assert outcome.guard.startswith("the host ended before it was lost: ")
    assert "is not TOML" in outcome.guard


@pytest.mark.wall_time
def test_what_this_machine_cannot_serve_is_skipped_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "bota").write_text("in the way")
    outcome = lose_host(rig_of_its_own(tmp_path, GROUP, backend="simulated", **HALF_RATE), KILLED, ALLOWED)
    assert outcome.verdict is Verdict.SKIPPED
    assert "something stands there that is not a simulated port" in outcome.guard
