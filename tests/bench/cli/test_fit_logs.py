"""``norton-bench fit LOG --columns MAP``: one JSON document, a table, and sentences for what is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter

from norton_bench.cli.app import main
from tests.bench.logs.bags import TRUE, robot, write_bag, write_json_mcap
from tests.bench.logs.machines import FREE, Machine, write_csv

STATE = """
[log]
motion = "rotation"
[columns]
position = { name = "/state/elbow/angle", unit = "rad" }
exertion = { name = "/state/elbow/torque", unit = "N*m" }
[model]
candidates = ["coulomb-viscous"]
"""
MACHINE = Machine(duration_s=8.0, rate_hz=200.0)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "map.toml").write_text(FREE)
    return write_csv(tmp_path / "log.csv", MACHINE.log())


def fitted(log: Path, *options: str) -> int:
    return main(["fit", str(log), "--columns", str(log.parent / "map.toml"), *options])


@pytest.mark.long
def test_json_is_that_of_identify_with_errors_and_ladder(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fitted(log, "--json", "--quiet", "--test", "6:8 s") == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert printed.err == ""
    assert found["parameters"]["inertia"]["value"] == pytest.approx(MACHINE.inertia, rel=0.02)
    assert set(found["parameters"]["inertia"]) == {"value", "std", "unit", "status"}
    assert found["converged"] is True
    for side in ("train", "test"):
        for quantity, unit in (("exertion", "N*m"), ("motion", "rad")):
            figures = found["errors"][side][quantity]
            assert set(figures) == {"rms", "relative", "mean_absolute", "unit"}
            assert figures["unit"] == unit
            assert figures["relative"] > 0
    (step,) = found["ladder"]
    assert step["selected"] is True
    assert step["parameters"]["inertia"]["unit"] == "kg*m^2"
    assert found["recording"] is found["network"] is None


def test_a_table_for_people(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fitted(log) == 0
    printed = capsys.readouterr()
    assert "inertia" in printed.out
    assert "held out" in printed.out
    assert f"fitting {log}" in printed.err


def test_a_report_where_a_folder_is_given(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fitted(log, "--json", "--out", str(log.parent / "out")) == 0
    report = Path(json.loads(capsys.readouterr().out)["report"])
    page = report.read_text()
    assert report == log.parent / "out" / "log.report.html"
    for said in ("coulomb-viscous", "5 of 5", "--columns", "<svg", "held out"):
        assert said in page


def test_a_doubtful_log_fails_and_says_why(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = FREE.replace('unit = "A" }', 'unit = "A", sign = -1 }')
    (log.parent / "map.toml").write_text(text)
    assert fitted(log, "--json") == 1
    found = json.loads(capsys.readouterr().out)
    assert {each["status"] for each in found["parameters"].values()} == {"doubtful"}
    assert any("sign = -1" in said for said in found["verdict"])


@pytest.mark.long
def test_a_log_without_a_map_gets_one_that_serves_from_then_on(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log.write_text(log.read_text().replace("t,q,w,u,u2,tau", "t [s],q [rad],w [rad/s],x1,u2,tau [Nm]", 1))
    proposed = log.parent / "log.map.toml"
    assert main(["fit", str(log), "--json", "--model", "coulomb-viscous"]) == 0
    printed = capsys.readouterr()
    assert f"proposed in {proposed}" in printed.err
    first = json.loads(printed.out)
    assert first["parameters"]["torque_gain"]["value"] == pytest.approx(MACHINE.gain, rel=0.01)
    assert first["totals"]["total_coulomb"]["value"] == pytest.approx(MACHINE.coulomb, rel=0.02)
    assert main(["fit", str(log), "--json", "--columns", str(proposed), "--model", "coulomb-viscous"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"] == first["parameters"]
    # What somebody may have mended is not written over.
    assert main(["fit", str(log)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_predictions_are_a_table_with_units_in_its_header(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = log.parent / "predicted.csv"
    assert fitted(log, "--quiet", "--test", "6:8 s", "--predict", str(table)) == 0
    header, *rows = table.read_text().splitlines()
    assert header == "log,time [s],part,measured [N*m],predicted [N*m],deviation [N*m]"
    cells = [row.split(",") for row in rows]
    assert {cell[2] for cell in cells} == {"train", "test"}
    test = np.array([[float(cell[k]) for k in (1, 3, 4, 5)] for cell in cells if cell[2] == "test"])
    assert test[0, 0] >= 6.0
    within = np.abs(test[:, 1] - test[:, 2]) < 2 * test[:, 3]
    # 95 % of normal errors; those at reversals are larger.
    assert np.mean(within) > 0.9
    assert main(["fit", str(log), "--columns", str(log.parent / "map.toml"), "--predict", str(log.parent)]) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.long
def test_a_bag_of_several_joints_asks_for_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(write_bag(tmp_path / "arm", robot(wrench_hz=200.0)))
    assert main(["fit", folder]) == 2
    assert f"{folder}: holds several joints (shoulder, elbow); choose one: --joint NAME" in capsys.readouterr().err
    options = ["--json", "--model", "coulomb-viscous", "--out", str(tmp_path / "out")]
    assert main(["fit", folder, "--joint", "elbow", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"]["inertia"]["value"] == pytest.approx(TRUE["elbow"].inertia, rel=0.02)
    assert found["joint"] == "elbow"
    assert found["report"] == str(tmp_path / "out" / "arm.elbow.report.html")
    assert "--joint &#34;elbow&#34;" in Path(found["report"]).read_text()


def test_an_mcap_file_of_another_program_is_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_json_mcap(tmp_path / "elbow.mcap")
    (tmp_path / "map.toml").write_text(STATE)
    assert fitted(path, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"]["inertia"]["value"] == pytest.approx(TRUE["elbow"].inertia, rel=0.02)
    recording = tmp_path / "recording.mcap"
    with recording.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="norton-bench")
        writer.finish()
    assert main(["fit", str(recording), str(path)]) == 2
    assert "fit recordings and logs of other programs apart" in capsys.readouterr().err


@pytest.mark.parametrize("options", [["--train", "0:1 s"], ["--model", "dahl"], ["other.mcap", "--test", "x"]])
def test_what_only_logs_have_is_refused_for_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    assert main(["fit", str(tmp_path / "x.mcap"), *options]) == 2
    assert "are for logs of other programs" in capsys.readouterr().err


def test_mistakes_in_a_map_are_told_with_their_place(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (log.parent / "map.toml").write_text(FREE.replace("motion", "motoin"))
    assert fitted(log) == 2
    said = capsys.readouterr().err
    assert f'{log.parent / "map.toml"}: [log] motoin: unknown key; did you mean "motion"?' in said
    assert "Traceback" not in said
