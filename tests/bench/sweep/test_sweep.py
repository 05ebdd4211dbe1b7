"""Sweeps over threads, processes and a Dask cluster; interrupted, and gone on with."""

import json
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from norton_bench.cli import app
from norton_bench.errors import ExperimentError, UsageError
from norton_bench.sweep.run import Store, executor_of, sweep
from norton_bench.sweep.task import TaskResult
from tests.bench.half_rate import half_rate_text

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
RIG = str(ROOT / "rigs" / "sim-odrive.toml")
SHORT = """
[[step]]
do = "tare"
duration = "0.5 s"
[[step]]
do = "calibrate"
duration = "2 s"
[[step]]
do = "imposed"
velocities = ["-15 rad/s", "15 rad/s"]
commands = 1
amplitude = "30 %"
duration = "1 s"
"""


@dataclass(frozen=True)
class Noted:
    """Leaves a file behind each time that it is carried out."""

    name: str
    folder: Path
    fails: bool = False

    def fitted(self) -> TaskResult:
        (self.folder / f"{self.name}-{len(list(self.folder.glob(self.name + '-*')))}").touch()
        if self.fails:
            raise ExperimentError("nothing moved")
        return TaskResult(self.name, converged=True)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Two seeds of a short session in two processes, from the command line; what it printed, and where it lies."""
    folder = tmp_path_factory.mktemp("sweep")
    rig, session = folder / "rig.toml", folder / "short.toml"
    rig.write_text(half_rate_text("sim-odrive"))
    session.write_text(SHORT)
    return folder, [
        "sweep",
        str(rig),
        "--session",
        str(session),
        "--seeds",
        "1-2",
        "--out",
        str(folder / "out"),
        "--keep",
    ]


def run(arguments, capsys):
    code = app.main([*arguments, "--json", "--quiet"])
    return code, json.loads(capsys.readouterr().out)


def test_an_interrupted_sweep_goes_on_where_it_was(tmp_path):
    ran, out = tmp_path / "ran", tmp_path / "out"
    ran.mkdir()
    tasks, heard = [Noted(f"t{k}", ran) for k in range(6)], []

    def interrupt(outcome):
        heard.append(outcome.name)
        if len(heard) == 2:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        sweep(tasks, pool, Store.opened(out, {}), interrupt)
    done = set(Store.opened(out, {}).done)
    assert set(heard) == done
    assert len(done) == 2
    with ThreadPoolExecutor(1) as pool:
        outcomes = sweep(tasks, pool, Store.opened(out, {}), lambda outcome: heard.append(outcome.name))
    assert [outcome.name for outcome in outcomes] == [f"t{k}" for k in range(6)]
    assert sorted(heard) == [f"t{k}" for k in range(6)]
    assert all(not (ran / f"{name}-1").exists() for name in done)


def test_what_failed_does_not_end_the_sweep_and_is_tried_again(tmp_path):
    with ThreadPoolExecutor(2) as pool:
        bad, good = sweep(
            [Noted("a", tmp_path, fails=True), Noted("b", tmp_path)], pool, Store.opened(tmp_path, {}), lambda _: None
        )
    assert (bad.failure, good.failure) == ("nothing moved", "")
    with ThreadPoolExecutor(2) as pool:
        again = sweep([Noted("a", tmp_path), Noted("b", tmp_path)], pool, Store.opened(tmp_path, {}), lambda _: None)
    assert [outcome.failure for outcome in again] == ["", ""]
    assert not (tmp_path / "b-1").exists()


def test_what_is_named_twice_is_refused(tmp_path):
    with ThreadPoolExecutor(1) as pool, pytest.raises(UsageError, match="a: is named twice"):
        sweep([Noted("a", tmp_path)] * 2, pool, Store.opened(tmp_path, {}), lambda _: None)


def test_two_seeds_in_processes_of_their_own(swept, capsys):
    folder, arguments = swept
    code, data = run([*arguments, "--jobs", "2"], capsys)
    assert code == 0
    assert [each["name"] for each in data["runs"]] == ["seed 1", "seed 2"]
    inertia = data["parameters"]["inertia"]
    assert inertia["runs"] == 2
    assert abs(inertia["bias"]) < 0.02 * 5e-5
    assert len(list(folder.glob("out/seed-*/*.mcap"))) == 2


def test_a_second_run_has_nothing_left_to_do(swept, capsys, monkeypatch):
    _, arguments = swept
    monkeypatch.setattr("norton_bench.sweep.run.carry_out", None)
    code, data = run(arguments, capsys)
    assert code == 0
    assert data["parameters"]["inertia"]["runs"] == 2


def test_another_session_wants_another_folder(swept, capsys):
    _, arguments = swept
    assert app.main([word for word in arguments if word != "--session" and "short.toml" not in word]) == 2
    assert "holds a sweep with another session" in capsys.readouterr().err


def test_a_fleet_of_recordings_on_a_dask_cluster(swept, capsys, tmp_path):
    """Each finds there what its session found."""
    folder, arguments = swept
    recordings = sorted(map(str, folder.glob("out/seed-*/*.mcap")))
    _, when_recorded = run(arguments, capsys)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own
        from distributed import LocalCluster

        with LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
        ) as cluster:
            address = ["--cluster", cluster.scheduler_address]
            code, data = run(["sweep", *recordings, *address, "--out", str(tmp_path)], capsys)
    assert code == 0
    assert data["failed"] == 0
    assert [each["name"] for each in data["runs"]] == [str(Path(each).resolve()) for each in recordings]
    assert [each["estimates"] for each in data["runs"]] == [each["estimates"] for each in when_recorded["runs"]]
    assert data["parameters"]["inertia"]["rms_error"] is None


def test_a_recording_that_cannot_be_read_is_told_beside_the_others(swept, capsys, tmp_path):
    folder, _ = swept
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"nothing of the kind")
    whole = str(next(folder.glob("out/seed-1/*.mcap")))
    code, data = run(["sweep", whole, str(broken), "--out", str(tmp_path / "out"), "--jobs", "1"], capsys)
    assert code == 1
    assert data["failed"] == 1
    assert str(broken) in data["runs"][1]["failure"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([RIG], "--seeds is missing"),
        ([RIG, "a.mcap", "--seeds", "1"], "is not a recording"),
        ([RIG, RIG, "--seeds", "1"], "a sweep is of one rig"),
        (["a.mcap", "--seeds", "1"], "leave them out with recordings"),
        ([RIG, "--seeds", "1", "--jobs", "0"], 'Invalid value "0" for --jobs. Give at least one.'),
    ],
)
def test_what_cannot_be_swept_is_refused_in_a_sentence(arguments, sentence, capsys, tmp_path):
    assert app.main(["sweep", *arguments, "--out", str(tmp_path)]) == 2
    assert sentence in capsys.readouterr().err


def test_without_dask_the_mend_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(UsageError, match=r"--cluster needs distributed.*norton-bench\[cluster\]"),
        executor_of(1, "tcp://nowhere:1"),
    ):
        pass
