"""``law``: which virtual bodies a bench can render, by the calibration in a recording."""

import json
import re
from pathlib import Path

import pytest

from norton_bench.cli.app import main
from norton_bench.control import renderable
from norton_bench.errors import ExitCode
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.rig.load import load_rig
from norton_bench.session.calibrated import calibrated_bench
from norton_bench.session.engine import RecordedSession, record_procedures
from norton_bench.session.schema import standard_session

RIG_FILE = Path(__file__).parents[3] / "rigs" / "sim-odrive.toml"
TARE = TareProcedure(TareOptions(duration_s=0.5))
CALIBRATE = CalibrateProcedure(CalibrateOptions(duration_s=4.0))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> RecordedSession:
    rig = load_rig(RIG_FILE, backend="simulated")
    folder = tmp_path_factory.mktemp("calibrated")
    return record_procedures(rig, standard_session(rig), (TARE, CALIBRATE), out=folder, seed=3, live=False)


def test_the_calibration_is_the_one_that_the_session_had(session: RecordedSession) -> None:
    """But for the one reading that arrived just before its first segment."""
    had, found = session.knowledge.calibration, calibrated_bench(session.recording).calibration
    assert had is not None
    for name in ("torque_gain", "inertia_kgm2", "coulomb_torque_nm", "sensor_stiffness_nm_rad"):
        assert getattr(found, name) == pytest.approx(getattr(had, name), rel=1e-4)


def test_a_law_gets_its_certificate(session: RecordedSession, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["law", str(session.recording), "--mass", "0.5 g*m^2", "--damping", "0.03"]
    assert main([*asked, "--json"]) == ExitCode.OK
    data = json.loads(capsys.readouterr().out)
    assert data["law"] == {"mass_kgm2": 5e-4, "damping_nms_rad": 0.03, "stiffness_nm_rad": 0.0}
    assert data["lightest_actuator_kgm2"] < 3e-4 < data["heaviest_actuator_kgm2"]
    assert not data["stable_when_held"]
    assert main(asked) == ExitCode.OK
    assert "0.03 N*m*s/rad of damping is stable with an actuator of" in capsys.readouterr().out


def test_one_that_cannot_be_rendered_is_refused_with_the_nearest(
    session: RecordedSession, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["law", str(session.recording), "--mass", "5e-4"]) == ExitCode.EXPERIMENT_FAILED
    refusal = capsys.readouterr().err
    assert "this bench cannot render 0.0005 kg*m^2 of mass" in refusal
    assert "it can with" in refusal


def test_without_a_law_there_is_a_table(
    session: RecordedSession, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(renderable, "MASSES", (1.0, 4.0))
    monkeypatch.setattr(renderable, "STIFFNESSES", (0.0, 1e-2))
    assert main(["law", str(session.recording), "--json"]) == ExitCode.OK
    data = json.loads(capsys.readouterr().out)
    assert data["masses_kgm2"] == [1.2e-4, 4.8e-4]
    assert data["stiffnesses_nm_rad"] == [0.0, 1.0]
    assert main(["law", str(session.recording)]) == ExitCode.OK
    heading, *lines = capsys.readouterr().out.splitlines()
    assert re.split(r"  +", heading.strip()) == ["kg m²", "0 N m/rad", "1 N m/rad"]
    shown = [[float(each) for each in line.split()] for line in lines[:2]]
    assert [row[0] for row in shown] == data["masses_kgm2"]
    assert [row[1:] for row in shown] == data["least_damping_nms_rad"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--mass", "-1"], "a law must have finite numbers, and no negative mass, damping or stiffness"),
        (["--mass", "1e-3", "--wall", "0.1"], "a wall needs a stiffness"),
        (["--mass", "1e-3 N*m"], "--mass: "),
        (["--damping", "nan"], "--damping nan: must be finite"),
    ],
)
def test_what_is_no_law_is_refused_in_a_sentence(
    session: RecordedSession, options: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["law", str(session.recording), *options]) == ExitCode.USAGE
    assert sentence in capsys.readouterr().err


def test_a_recording_without_a_calibration_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = load_rig(RIG_FILE, backend="simulated")
    tared = record_procedures(rig, standard_session(rig), (TARE,), out=tmp_path, seed=3, live=False)
    assert main(["law", str(tared.recording), "--mass", "1e-3"]) == ExitCode.USAGE
    assert "no step 'calibrate' was finished in it" in capsys.readouterr().err


def test_a_rig_without_a_load_has_nothing_that_acts_a_body(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = load_rig(RIG_FILE.with_name("sim-free-shaft.toml"), backend="simulated")
    tared = record_procedures(rig, standard_session(rig), (TARE,), out=tmp_path, seed=3, live=False)
    assert main(["law", str(tared.recording)]) == ExitCode.USAGE
    assert "step 'render' needs a load drive to act the virtual body" in capsys.readouterr().err


def test_a_wall_is_judged_on_both_of_its_sides(session: RecordedSession, capsys: pytest.CaptureFixture[str]) -> None:
    law = ["--mass", "5e-4", "--damping", "0.03", "--stiffness", "1", "--wall", "0.1"]
    assert main(["law", str(session.recording), *law]) == ExitCode.OK
    assert "before the wall and behind it" in capsys.readouterr().out
