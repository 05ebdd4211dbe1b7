"""An in-situ session and its recording say the same: what is told in the end is concluded from the recording alone."""

import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode
from norton_bench.recording.reader import read_recording
from norton_bench.session.resume import finished_in_all
from tests.bench.half_rate import half_rate_text

pytestmark = pytest.mark.long

SESSION = """\
rig = "rig.toml"
seed = 1
[[step]]
do = "tare"
duration = "500 ms"
[[step]]
do = "in_situ"
trials = 5
duration = "2 s"
shake = "8 s"
viscous_damping = "3.16e-4 N*m*s/rad"
"""
# What is said of the session as it ran, and not of what it measured.
OF_THE_SESSION = {"events", "recording", "report"}


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the session printed; its report lies beside its recording."""
    folder = tmp_path_factory.mktemp("in-situ")
    (folder / "session.toml").write_text(SESSION)
    (folder / "rig.toml").write_text(half_rate_text("sim-in-situ"))
    arguments = ["run", str(folder / "session.toml"), "--out", str(folder / "run"), "--quiet", "--json"]
    with redirect_stdout(StringIO()) as printed:
        assert app.main(arguments) == ExitCode.OK
    found: dict[str, Any] = json.loads(printed.getvalue())
    return found


def in_situ_section(report: Path) -> str:
    page = report.read_text()
    begin = page.index('id="in-situ"')
    return page[begin : page.index("</section>", begin)]


def test_recording_and_session_say_the_same(
    told: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.main(["fit", told["recording"], "--out", str(tmp_path), "--json", "--quiet"]) == ExitCode.OK
    again = json.loads(capsys.readouterr().out)
    assert told["in_situ"]["driven"][:3] == [False, True, True]
    then, now = (Path(each["in_situ"].pop("source")).read_text() for each in (told, again))
    assert then == now
    assert then.startswith("time_s,command,position_rad,velocity_rad_s\n0,")
    for name in set(again) - OF_THE_SESSION:
        assert again[name] == told[name], name
    sections = [in_situ_section(Path(each["report"])) for each in (told, again)]
    assert sections[0] == sections[1]
    assert "by the twist between the encoders" in sections[0]


def test_the_report_alone_has_the_section_too(told: dict[str, Any], tmp_path: Path) -> None:
    assert app.main(["report", told["recording"], "--out", str(tmp_path), "--quiet"]) == ExitCode.OK
    assert in_situ_section(tmp_path / "sim-in-situ.report.html") == in_situ_section(Path(told["report"]))


def test_a_session_that_goes_on_from_it_finds_the_shaking_and_every_trial(told: dict[str, Any]) -> None:
    path = Path(told["recording"])
    names = [name for name, _ in finished_in_all(path, read_recording(path, raw_frames=False))]
    assert names == ["tare", "in_situ", *["in_situ"] * len(told["in_situ"]["driven"])]


def test_what_is_for_programs_is_in_the_recording_and_in_no_list(
    told: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert [event.kind for event in read_recording(Path(told["recording"])).measured.events].count("load") == 1
    assert "load" not in [event["kind"] for event in told["events"]]
    assert app.main(["info", told["recording"]]) == ExitCode.OK
    assert "torque_gain" not in capsys.readouterr().out
