import json
from pathlib import Path

import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode
from tests.bench.session.test_catalogue import left_by_a_run


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for month in range(3):
        left_by_a_run(tmp_path / str(month), days=30.0 * month, coulomb_torque=0.02 + 0.002 * month)
    return tmp_path


def test_the_list(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["runs", str(folder)]) == ExitCode.OK
    out = capsys.readouterr().out
    assert out.count("6 valid, 1 inadequate") == 3 or out.count("6 valid") == 3
    assert app.main(["runs", str(folder), "--rig", "another"]) == ExitCode.OK
    assert "holds no recording" in capsys.readouterr().out


def test_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["runs", str(folder), "--json"]) == ExitCode.OK
    found = json.loads(capsys.readouterr().out)
    assert len(found) == 3
    assert found[0]["estimates"]["coulomb_torque"]["value"] == pytest.approx(0.02)
    assert found[0]["started"].startswith("2026-01-01")


def test_two_beside_each_other(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["runs", "--compare", str(folder / "0"), str(folder / "2")]) == ExitCode.OK
    out = capsys.readouterr().out
    (line,) = [line for line in out.splitlines() if line.rstrip().endswith("differs")]
    assert line.startswith("coulomb_torque")
    assert "corrected for 7 parameters" in " ".join(out.split())


def test_another_unit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left_by_a_run(folder / "in amperes", unit="A")
    pair = ["--compare", str(folder / "0"), str(folder / "in amperes")]
    assert app.main(["runs", *pair]) == ExitCode.OK
    words = " ".join(capsys.readouterr().out.split())
    assert "corrected for 6 parameters. Left out, because the units differ: torque_gain (N*m/(N*m), N*m/(A))." in words
    assert app.main(["runs", *pair, "--json"]) == ExitCode.OK
    last = json.loads(capsys.readouterr().out)[-1]
    assert (last["parameter"], last["second_unit"], last["difference"]) == ("torque_gain", "N*m/(A)", None)


def test_over_time(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["runs", str(folder), "--trend", "coulomb_torque"]) == ExitCode.OK
    words = " ".join(capsys.readouterr().out.split())
    assert "Runs differ by more than their own errors" in words
    assert "In 30 days 0.0020" in words
    assert app.main(["runs", str(folder), "--trend", "coulomb"]) == ExitCode.USAGE
    assert "there are: amplifier_bandwidth, coulomb_torque" in capsys.readouterr().err
