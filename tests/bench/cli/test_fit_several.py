"""``fit RECORDING RECORDING...``: sessions of one rig, recorded and fitted together from the command line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli.app import main
from norton_bench.errors import ExitCode
from norton_bench.identification.judged_fit import fit
from norton_bench.models.network import NortonNetwork
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.report import render
from norton_bench.result import Result
from norton_bench.session import conclusion, several
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Truth

SAME_RIG = {"rig": "bench", "command_unit": "N*m", "tick_s": repr(TICK_S), "started": "2026-11-21T10:00:00+00:00"}


def record(path: Path, seed: int, truth: Truth | None = None, **other: str) -> None:
    rng = np.random.default_rng([seed, 11])
    plan = synthetic.imposed_parts(synthetic.Plan(), truth or Truth(), rng, multisine_s=5.0)
    with Recorder(path, rig_text="", metadata={**SAME_RIG, **other}, patience_s=10.0) as recorder:
        recorder.put(synthetic.run(plan, truth or Truth(), synthetic.Bench(), seed))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions")
    for seed in (1, 2):
        (folder / f"day {seed}").mkdir()
        record(folder / f"day {seed}" / "bench.mcap", seed)
    record(folder / "worn.mcap", 3, replace(Truth(), viscous_damping=1.1e-3))
    return folder


@pytest.fixture
def fit_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each recording is fitted, and nothing else made of it: what takes the time is tested elsewhere."""

    def conclude(path: Path, out: Path | None) -> Result:
        recorded = read_recording(path)
        fitted = fit(recorded.measured, command_unit="N*m", tick_s=TICK_S, draws=0)
        return Result("sim", metadata=recorded.metadata, recording=path, measured=recorded.measured, fit=fitted)

    monkeypatch.setattr("norton_bench.session.several.conclude_recording", conclude)


def fitted(folder: Path, *names: str, options: tuple[str, ...] = ("--json",)) -> int:
    return main(["fit", *(str(folder / name) for name in names), *options])


@pytest.mark.long
def test_sessions_of_one_rig_are_fitted_together(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of each session its fit: other laws of friction, and what its own page shows, are tested elsewhere."""
    monkeypatch.setattr(conclusion, "bench_ladder", lambda *_: ())
    monkeypatch.setattr(render, "sections", lambda _: [])
    names = ("day 1/bench.mcap", "day 2/bench.mcap", "worn.mcap")
    assert fitted(folder, *names, options=("--json", "--quiet", "--out", str(tmp_path / "out"))) == ExitCode.OK
    streams = capsys.readouterr()
    found = json.loads(streams.out)
    assert streams.err == ""
    assert [one["recording"] for one in found["sessions"]] == [str(folder / name) for name in names]
    (said,) = (said for said in found["verdict"] if "differ" in said)
    assert "viscous damping" in said
    assert not any(name.replace("_", " ") in said for name in found["between_sessions"] if name != "viscous_damping")
    spread = found["between_sessions"]["viscous_damping"]
    assert spread["between_std"] == pytest.approx(1e-4 / np.sqrt(3), rel=0.05)  # of 1, 1 and 1.1e-3
    assert spread["within_std"] < 0.1 * spread["between_std"] < 0.1 * spread["between_std_upper"]
    assert spread["p"] < 1e-6
    damping = found["parameters"]["viscous_damping"]
    own = [one["parameters"]["viscous_damping"]["value"] for one in found["sessions"]]
    assert damping["value"] == pytest.approx(np.mean(own), rel=1e-3)
    assert damping["std"] == pytest.approx(4.3027 / 1.96 * np.std(own, ddof=1) / np.sqrt(3), rel=0.01)  # t(2)
    assert found["sessions"][0]["network"] == str(tmp_path / "out" / "1-bench" / "bench.network.json")
    files = sorted(str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*"))
    assert files == [
        "1-bench/bench.network.json", "1-bench/bench.report.html", "2-bench/bench.network.json",
        "2-bench/bench.report.html", "3-worn/worn.network.json", "3-worn/worn.report.html",
        "bench-3-sessions.network.json", "bench-3-sessions.report.html",
    ]  # fmt: skip
    network = NortonNetwork.load(found["network"])
    assert network.viscous_damping_nms_rad == damping["value"]
    assert network.provenance["recordings"].count(".mcap") == 3
    page = Path(found["report"]).read_text()
    assert all(part in page for part in ("worn.mcap", "Between sessions", "<svg", "3 sessions", "2026-11-21 10:00:00"))


@pytest.mark.long
@pytest.mark.usefixtures("fit_alone")
def test_for_people_there_is_a_table_of_spreads(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fitted(folder, "day 1/bench.mcap", "day 2/bench.mcap", options=()) == ExitCode.OK
    streams = capsys.readouterr()
    assert all(word in streams.out for word in ("inertia", "spread of", "within", "between", "at most", "Two sessions"))
    assert "No parameter differs" in streams.out
    assert streams.err.count("fitting ") == 2
    assert (folder / "day 1" / "bench-2-sessions.network.json").is_file()
    assert (folder / "day 1" / "bench-2-sessions.report.html").is_file()


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"rig": "elsewhere"}, "its rig is elsewhere, that of"),
        ({"command_unit": "A"}, "its command unit is A, that of"),
        ({"tick_s": "0.002"}, "its tick [s] is 0.002, that of"),
    ],
)
def test_what_does_not_belong_together_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], other: dict[str, str], said: str
) -> None:
    record(tmp_path / "other.mcap", 4, **other)
    assert main(["fit", str(folder / "worn.mcap"), str(tmp_path / "other.mcap"), "--json"]) == ExitCode.USAGE
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.startswith(f"{tmp_path / 'other.mcap'}: {said}")
    assert "only sessions of one rig can be combined" in streams.err
    assert len(streams.err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["other.mcap"]


@pytest.fixture
def nothing_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit takes half a minute: what is refused is refused before."""
    monkeypatch.setattr(several, "conclude_recording", lambda *_: pytest.fail("fitted something"))


@pytest.mark.long
@pytest.mark.usefixtures("nothing_is_fitted")
def test_what_cannot_be_combined_is_refused_before_anything_is_fitted(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "tables.mcap", 4, model="none")
    for name, said in (("tables.mcap", "holds tables without a model"), ("none.mcap", "there is no recording")):
        assert fitted(folder, "worn.mcap", "day 1/bench.mcap", str(tmp_path / name)) == ExitCode.USAGE
        assert said in capsys.readouterr().err


@pytest.mark.usefixtures("nothing_is_fitted")
def test_a_session_counts_once(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fitted(folder, "worn.mcap", "day 1/../worn.mcap") == ExitCode.USAGE
    assert "is given twice" in capsys.readouterr().err
    copy = tmp_path / "copy.mcap"
    copy.write_bytes((folder / "worn.mcap").read_bytes())
    options = ("--quiet", "--out", str(tmp_path))
    assert main(["fit", str(folder / "worn.mcap"), str(copy), *options]) == ExitCode.USAGE
    assert "copy.mcap: holds the same measurements as" in capsys.readouterr().err


def test_every_file_must_be_a_recording(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.csv").write_text("t,x\n")
    assert fitted(folder, "worn.mcap", str(tmp_path / "log.csv")) == ExitCode.USAGE
    assert "log.csv is not an MCAP recording" in capsys.readouterr().err
    assert fitted(folder, "worn.mcap", "none.mcap") == ExitCode.USAGE
    assert "there is no recording" in capsys.readouterr().err
