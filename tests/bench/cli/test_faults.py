"""``faults``: what is tried, what is printed, and with which code it ends."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode
from norton_bench.faults import campaign
from norton_bench.faults.campaign import FaultTrial
from norton_bench.faults.case import CaseResult, Expected, Peak, Verdict

ROOT = Path(__file__).parents[3]
RIG = ROOT / "rigs" / "sim-odrive.toml"
STOPPED = CaseResult(
    "silent",
    "torque_sensor",
    "odrive",
    "sim-odrive",
    Expected.STOP,
    Verdict.STOPPED,
    guard="torque sensor: silent for 61.0 ms",
    detected_s=0.062,
    off_s=0.0623,
    allowed_s=0.302,
    drives={"actuator": "idle", "load": "idle"},
    peak=Peak(0.21, 17.6),
    peak_after=Peak(0.05, 3.0),
)


class Tried:
    """Stands where the campaign would: notes what it was asked, and gives every case the same verdict."""

    def __init__(self) -> None:
        self.verdict = Verdict.STOPPED
        self.asked: list[FaultTrial] = []
        self.jobs = 0

    def run(
        self, trials: Sequence[FaultTrial], jobs: int, seed: int | None, on_outcome: Callable[[CaseResult], None]
    ) -> list[CaseResult]:
        self.asked, self.jobs = list(trials), jobs
        outcomes = [
            CaseResult(
                **{**vars(STOPPED), "fault": case.name, "on": case.on, "rig": trial.rig.name, "verdict": self.verdict}
            )
            for trial in trials
            for case in (*trial.cases, *trial.losses)
        ]
        for outcome in outcomes:
            on_outcome(outcome)
        return outcomes


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> Tried:
    tried = Tried()
    monkeypatch.setattr(campaign, "run_campaign", tried.run)
    return tried


def test_all_faults_of_the_rig_are_tried_and_told(tried: Tried, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["faults", str(RIG), "--jobs", "3"]) == ExitCode.OK
    streams = capsys.readouterr()
    (trial,) = tried.asked
    assert (trial.rig.backend, tried.jobs) == ("simulated", 3)
    assert trial.count >= 40
    assert [case.table["kind"] for case in trial.losses] == ["host-killed", "host-stopped"]
    assert f"{trial.count} of {trial.count} faults end safely." in streams.out
    assert "odrive (sim-odrive): a drive may run on for 302 ms" in streams.out
    (row,) = [line for line in streams.out.splitlines() if line.startswith(f"  {'silent':<34}torque_sensor")]
    assert " ".join(row.split()) == "silent torque_sensor stopped 62 ms 62 ms 0.21 N*m 18 rad/s idle"
    assert "      torque sensor: silent for 61.0 ms" in streams.out
    assert f"[1/{trial.count}] odrive: one frame lost (actuator): stopped" in streams.err


def test_json_and_nothing_else(tried: Tried, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["faults", str(RIG), "--only", "false-reading", "--json", "--quiet"]) == ExitCode.OK
    streams = capsys.readouterr()
    told = json.loads(streams.out)
    assert streams.err == ""
    assert (told["passed"], told["safe"], told["no_watchdog"], told["skipped"]) == (True, True, 0, 0)
    assert [case["fault"] for case in told["cases"]] == ["reads beyond the limit", "reads no number"]
    case = told["cases"][0]
    assert (case["verdict"], case["expected"], case["safe"], case["detected_s"]) == ("stopped", "stop", True, 0.062)
    assert case["peak"] == {"torque_nm": 0.21, "velocity_rad_s": 17.6}
    assert case["drives"] == {"actuator": "idle", "load": "idle"}


@pytest.mark.parametrize(
    ("verdict", "code"),
    [
        (Verdict.RIDDEN_THROUGH, ExitCode.OK),
        (Verdict.SKIPPED, ExitCode.OK),
        (Verdict.NO_WATCHDOG, ExitCode.OK),
        (Verdict.NOT_DETECTED, ExitCode.EXPERIMENT_FAILED),
        (Verdict.TOO_LATE, ExitCode.EXPERIMENT_FAILED),
        (Verdict.BEYOND_LIMITS, ExitCode.EXPERIMENT_FAILED),
        (Verdict.FAILED, ExitCode.EXPERIMENT_FAILED),
    ],
)
def test_one_case_that_does_not_end_safely_is_a_failure(
    tried: Tried, verdict: Verdict, code: ExitCode, capsys: pytest.CaptureFixture[str]
) -> None:
    tried.verdict = verdict
    assert app.main(["faults", str(RIG), "--only", "undervoltage"]) == code
    assert verdict.value in capsys.readouterr().out


@pytest.mark.parametrize(
    ("verdict", "passed", "safe", "counts"),
    [
        (Verdict.RIDDEN_THROUGH, True, True, (0, 0)),
        (Verdict.NO_WATCHDOG, True, False, (1, 0)),
        (Verdict.SKIPPED, True, None, (0, 1)),
        (Verdict.TOO_LATE, False, False, (0, 0)),
    ],
)
def test_all_together_are_no_safer_than_each(
    tried: Tried,
    verdict: Verdict,
    passed: bool,
    safe: bool | None,
    counts: tuple[int, int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    tried.verdict = verdict
    app.main(["faults", str(RIG), "--only", "one frame lost", "--json"])
    told = json.loads(capsys.readouterr().out)
    count = len(told["cases"])
    assert (told["passed"], told["safe"]) == (passed, safe)
    assert (told["no_watchdog"], told["skipped"]) == tuple(each * count for each in counts)
    assert {case["safe"] for case in told["cases"]} == {safe}


def test_without_a_rig_those_of_the_families_are_tried(
    tried: Tried, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)  # wherever one is
    assert app.main(["faults", "--quick"]) == ExitCode.OK
    assert tried.asked[0].rig.name == "sim-odrive"
    assert all(case.quick for trial in tried.asked for case in trial.cases)
    # Wall time is spent on the first alone.
    assert [len(trial.losses) for trial in tried.asked] == [1, *[0] * (len(tried.asked) - 1)]


def test_what_no_fault_is_called_is_refused(tried: Tried, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["faults", str(RIG), "--only", "earthquake"]) == ExitCode.USAGE
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith('--only "earthquake": no fault has this text')
