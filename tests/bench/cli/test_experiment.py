"""``identify`` and ``run`` around the engine: what it is given, and what is done with what it returns or raises."""

import json
import os
import signal
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from norton_bench.cli import app
from norton_bench.cli.arguments import run_folder
from norton_bench.cli.output import Output
from norton_bench.cli.progress import LineProgress, showing_progress
from norton_bench.errors import ExitCode, SafetyStopError
from norton_bench.events import Note, PartMeasured, Planned, PlannedStep, StepBegun
from norton_bench.identification.results import FitResult, LiveEstimate, Trace
from norton_bench.loop.stop_word import operator_stop
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.refinement import Refinement
from norton_bench.records import Measured
from norton_bench.result import Result

ROOT = Path(__file__).parents[3]
RIG = ROOT / "rigs" / "sim-odrive.toml"


class Engine:
    """Stands where the engine would: notes what it was asked, does what it was told."""

    def __init__(self, fit: FitResult) -> None:
        self.fit = fit
        self.error: Exception | None = None
        self.refinement: Refinement | None = None
        self.asked: dict[str, Any] = {}

    def run_session(self, rig: Any, session: Any, **asked: Any) -> Result:
        self.asked = {"rig": rig, "session": session, **asked}
        recording = asked["out"] / "r.mcap"
        recording.write_text("")
        for event in (
            Planned((PlannedStep("tare", 2.0),)),
            StepBegun(0, "tare"),
            PartMeasured(Measured(), LiveEstimate(0)),
            Note("a remark"),
        ):
            asked["on_event"](event)
        if self.error is not None:
            raise self.error
        ticks = np.zeros(3000, Measured().ticks.dtype)
        known = Knowledge(rig, refinement=self.refinement)
        return Result("sim", recording=recording, measured=Measured(ticks=ticks), knowledge=known, fit=self.fit)


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    trace = Trace(np.zeros(1), np.zeros(1), np.zeros(1), "N*m")
    estimate = Estimate("inertia", 5e-5, 1e-7, "kg*m^2", Status.VALID)
    network = object.__new__(NortonNetwork)  # not looked into
    engine = Engine(FitResult((estimate,), network, True, 0.0, 0.0, 1, 0.0, 0.0, 0.0, 0.0, trace))
    module = types.ModuleType("norton_bench.session.engine")
    module.run_session = engine.run_session  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "norton_bench.session.engine", module)
    return engine


def test_identify_runs_the_standard_session_and_prints_json(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = app.main(["identify", str(RIG), "--seed", "7", "--out", str(tmp_path / "new"), "--json"])
    streams = capsys.readouterr()
    assert code == ExitCode.OK
    assert json.loads(streams.out)["parameters"]["inertia"]["std"] == 1e-7
    asked = [step.do for step in engine.asked["session"].steps]
    assert asked == ["tare", "calibrate", "free", "blocked", "imposed", "validate"]
    assert "until" not in json.loads(streams.out)
    assert (engine.asked["seed"], engine.asked["rig"].backend) == (7, "simulated")
    assert engine.asked["out"] == tmp_path / "new"
    assert "[1/1] tare" in streams.err
    assert "a remark" in streams.err


def test_identify_until_refines_and_says_how_far_it_came(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reason = "time is up; still wide: inertia ±0.39 %"
    engine.refinement = Refinement(0.001, rounds=4).ended(reached=False, reasons=[reason])
    arguments = ["identify", str(RIG), "--until", "0.1%", "--at-most", "3 min", "--out", str(tmp_path)]
    assert app.main([*arguments, "--json"]) == ExitCode.OK
    until = json.loads(capsys.readouterr().out)["until"]
    assert until.pop("widest") == {"parameter": "inertia", "half_width": pytest.approx(1.96 * 1e-7 / 5e-5)}
    sentence = f"{reason[0].upper()}{reason[1:]}."
    assert until == {"asked": 0.001, "reached": False, "rounds": 4, "bench_time_s": 3.0, "reasons": [sentence]}
    (refine,) = [step.options for step in engine.asked["session"].steps if step.do == "refine"]
    assert refine.until == 0.001
    assert refine.at_most_s < 180
    assert app.main(arguments) == ExitCode.OK
    said = " ".join(capsys.readouterr().out.split())
    assert "Did not reach ±0.1 % after 4 rounds, 3 s of bench time" in said
    assert sentence in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--until", "1 Hz"], "--until 1 Hz: is a percentage of each value"),
        (["--until", "100%"], "--until 100%: is a percentage of each value, greater than 0 % and less than 100 %"),
        (["--until", "tight"], "--until tight: is a percentage of each value"),
        (["--until", "1%", "--at-most", "60"], '--at-most: "60" has no unit'),
        (["--until", "1%", "--at-most", "20 s"], "--at-most 20 s: the steps around the refinement take about"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_a_sentence(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.main(["identify", str(RIG), "--out", str(tmp_path), *options]) == ExitCode.USAGE
    (sentence,) = capsys.readouterr().err.splitlines()
    assert sentence.startswith(said)


def test_quiet_is_quiet(engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["identify", str(RIG), "--out", str(tmp_path), "--quiet"]) == ExitCode.OK
    streams = capsys.readouterr()
    assert streams.err == ""
    assert "inertia" in streams.out


def test_why_a_result_is_none_is_said_also_where_it_is_quiet(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.fit = replace(engine.fit, converged=False)
    assert app.main(["identify", str(RIG), "--out", str(tmp_path), "--quiet"]) == ExitCode.EXPERIMENT_FAILED
    assert capsys.readouterr().err.strip() == engine.fit.shortcoming


def test_run_takes_rig_and_seed_from_the_session_unless_told(engine: Engine, tmp_path: Path) -> None:
    session = tmp_path / "s.toml"
    session.write_text(f'rig = "{RIG}"\nseed = 3\n[[step]]\ndo = "tare"\n')
    assert app.main(["run", str(session), "--out", str(tmp_path)]) == ExitCode.OK
    assert (engine.asked["rig"].name, engine.asked["seed"]) == ("sim-odrive", 3)
    other = ROOT / "rigs" / "sim-dbc.toml"
    arguments = [
        "run",
        str(session),
        "--rig",
        str(other),
        "--seed",
        "0",
        "--backend",
        "hardware",
        "--out",
        str(tmp_path),
    ]
    assert app.main(arguments) == ExitCode.OK
    assert (engine.asked["rig"].name, engine.asked["seed"]) == ("sim-dbc", 0)
    assert engine.asked["rig"].backend == "hardware"


@pytest.mark.parametrize(("option", "live"), [([], True), (["--no-live"], False)])
def test_identifying_while_it_runs_can_be_left_out(
    engine: Engine, tmp_path: Path, option: list[str], live: bool
) -> None:
    session = tmp_path / "s.toml"
    session.write_text('[[step]]\ndo = "tare"\n')
    for arguments in (["identify", str(RIG)], ["run", str(session), "--rig", str(RIG)]):
        assert app.main([*arguments, "--out", str(tmp_path), "--quiet", *option]) == ExitCode.OK
        assert engine.asked["live"] is live


def test_a_safety_stop_keeps_its_code_and_says_where_the_data_are(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "older.mcap").write_text("")
    engine.error = SafetyStopError("torque beyond its limit")
    code = app.main(["identify", str(RIG), "--out", str(tmp_path), "--json"])
    streams = capsys.readouterr()
    assert (code, streams.out) == (ExitCode.SAFETY_STOP, "")
    assert "torque beyond its limit" in streams.err
    assert str(tmp_path / "r.mcap") in streams.err
    assert "older.mcap" not in streams.err


def test_a_fit_that_did_not_converge_is_a_failure(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.fit = replace(engine.fit, converged=False)
    code = app.main(["identify", str(RIG), "--out", str(tmp_path), "--json"])
    streams = capsys.readouterr()
    assert code == ExitCode.EXPERIMENT_FAILED
    assert json.loads(streams.out)["converged"] is False
    assert "did not converge" in streams.err


@pytest.mark.parametrize(
    ("status", "said"), [(Status.DOUBTFUL, "contradict themselves"), (Status.INADEQUATE, "the model does not have")]
)
def test_a_value_that_is_no_result_is_a_failure(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str], status: Status, said: str
) -> None:
    (estimate,) = engine.fit.estimates
    engine.fit = replace(engine.fit, estimates=(replace(estimate, status=status),))
    code = app.main(["identify", str(RIG), "--out", str(tmp_path), "--json"])
    streams = capsys.readouterr()
    assert code == ExitCode.EXPERIMENT_FAILED
    assert json.loads(streams.out)["parameters"]["inertia"]["status"] == status.value
    assert said in streams.err


def test_runs_go_to_a_folder_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = run_folder(None, "bench-3")
    assert folder.parent == Path("runs")
    assert folder.name.endswith("-bench-3")
    assert folder.is_dir()


def test_the_first_interrupt_asks_and_the_second_ends() -> None:
    before = signal.getsignal(signal.SIGINT)
    with operator_stop() as stop_word:
        assert stop_word.heard() is None
        os.kill(os.getpid(), signal.SIGINT)
        assert stop_word.heard() == "Ctrl-C"
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_progress_says_how_long_it_takes(capsys: pytest.CaptureFixture[str]) -> None:
    lines = LineProgress(Output())
    lines(Planned((PlannedStep("tare", 2.0), PlannedStep("free", 10.0))))
    lines(StepBegun(1, "free"))
    assert capsys.readouterr().err.splitlines() == ["2 steps, about 12 s of bench time", "[2/2] free"]


def test_progress_on_a_terminal_draws_a_bar(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with showing_progress(Output(), tick_s=1e-3) as on_event:
        on_event(Planned((PlannedStep("free", 1.0),)))
        on_event(StepBegun(0, "free"))
        live = LiveEstimate(1, (Estimate("inertia", 1.0, 0.1, "kg*m^2", Status.VALID),))
        on_event(PartMeasured(Measured(), live))
        on_event(Note("a remark"))
    assert "a remark" in capsys.readouterr().err
