"""The host's process is killed, or stopped, while the shaft moves: real processes, sockets and a pseudo-terminal."""

import socket
from pathlib import Path

import pytest

from bench.faults import host_loss
from bench.faults.case import Verdict
from bench.faults.host_loss import lose_host
from bench.faults.matrix import host_losses
from bench.faults.rehearse import longest_watchdog_s
from bench.rig.load import load_rig
from bench.rig.rig import Rig

ROOT = Path(__file__).parents[3]
KILLED, STOPPED = host_losses()
# A host that is no real-time machine may stand still for tens of milliseconds.
PATIENT = {
    'stale_after = "60 ms"': 'stale_after = "250 ms"',
    'stall_after = "100 ms"': 'stall_after = "200 ms"',
    'watchdog = "300 ms"': 'watchdog = "400 ms"',
}


def unused_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


def rig_of_its_own(folder: Path, **changes: str) -> Rig:
    """On a group, a port and a pseudo-terminal that nobody else has."""
    text = (ROOT / "rigs" / "sim-odrive.toml").read_text()
    own = {
        "239.74.163.2": "239.74.163.63",
        "/tmp/norton-bench/bota": str(folder / "bota"),
        'bitrate = "1 Mbit/s"': f'bitrate = "1 Mbit/s"\noptions = {{ port = {unused_port()} }}',
    }
    for right, other in {**PATIENT, **own, **changes}.items():
        assert right in text
        text = text.replace(right, other)
    (folder / "rig.toml").write_text(text)
    return load_rig(folder / "rig.toml")


@pytest.mark.wall_time
@pytest.mark.parametrize("case", [KILLED, STOPPED], ids=lambda case: case.table["kind"])
def test_the_drives_watchdogs_stop_the_shaft(case: object, tmp_path: Path) -> None:
    rig = rig_of_its_own(tmp_path)
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
    outcome = lose_host(rig_of_its_own(tmp_path), KILLED, 0.4)
    assert outcome.verdict is Verdict.FAILED
    assert outcome.guard.startswith("the host ended before it was lost: ")
    assert "is not TOML" in outcome.guard


@pytest.mark.wall_time
def test_what_this_machine_cannot_serve_is_skipped_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "bota").write_text("in the way")
    outcome = lose_host(rig_of_its_own(tmp_path), KILLED, 0.4)
    assert outcome.verdict is Verdict.SKIPPED
    assert "something stands there that is not a simulated port" in outcome.guard
