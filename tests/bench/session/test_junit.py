"""The report for a CI server: steps, fit and expectations as cases, what failed in words, parameters as properties."""

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from norton_bench.errors import ExitCode, UsageError
from norton_bench.events import (
    Ended,
    Note,
    Planned,
    PlannedStep,
    SessionState,
    StateChanged,
    StepBegun,
)
from norton_bench.models.parameter_result import ExpectationResult
from norton_bench.models.parameters import Estimate, Status
from norton_bench.session.junit import JUnitReport

PLAN = (PlannedStep("tare", 1.0), PlannedStep("imposed", 2.0, "v = 3"), PlannedStep("free", 1.0, certain=False))
FOUND = Estimate("inertia", 5e-5, 1e-7, "kg*m^2", Status.VALID)
UNKNOWN = Estimate("coulomb_torque", float("nan"), float("inf"), "N*m", Status.UNEXCITED)


def reported(path: Path, steps: tuple[int, ...], summary: Ended) -> ET.Element:
    report = JUnitReport(path, "norton-bench.rig", {"seed": "1"})
    report.prepare()
    report(Planned(PLAN))
    for index in steps:
        report(StepBegun(index, PLAN[index].name))
    report(Note("round 1\x1b[0m"))
    if not summary.failure:
        report(StateChanged(SessionState.CONCLUDING))
    report(summary)
    (suite,) = ET.parse(path).getroot()
    return suite


def verdicts(suite: ET.Element) -> dict[str, str]:
    """Each case, and its message where it did not pass."""
    told = {}
    for case in suite.iter("testcase"):
        said = [each.get("message", "") for each in case if each.tag in ("failure", "skipped")]
        told[case.get("name", "")] = said[0] if said else ""
    return told


def test_a_session_that_came_through(tmp_path: Path) -> None:
    expected = (ExpectationResult("inertia", True, "as it was"), ExpectationResult("inertia", False, "too wide"))
    summary = Ended(ExitCode.EXPERIMENT_FAILED, estimates=(FOUND, UNKNOWN), expectations=expected)
    suite = reported(tmp_path / "new" / "j.xml", (0, 1), summary)
    assert verdicts(suite) == {
        "1 tare": "",
        "2 imposed (v = 3)": "",
        "3 free": "left out by its condition, or by the operator",
        "final fit": "",
        "1 inertia": "",
        "2 inertia": "too wide",
    }
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("6", "1", "1")
    properties = {each.get("name"): each.get("value") for each in suite.iter("property")}
    assert properties["inertia"] == "5e-05"
    assert properties["inertia.plus_minus"] == "1.96e-07"
    assert (properties["coulomb_torque"], properties["coulomb_torque.status"]) == ("", "unexcited")
    assert properties["seed"] == "1"
    assert suite.findtext("system-out") == "round 1�[0m"


def test_a_fit_that_is_no_result_fails(tmp_path: Path) -> None:
    summary = Ended(ExitCode.EXPERIMENT_FAILED, verdict=("nothing moved",))
    assert verdicts(reported(tmp_path / "j.xml", (0, 1, 2), summary))["final fit"] == "nothing moved"


def test_the_step_that_failed_says_why(tmp_path: Path) -> None:
    suite = reported(tmp_path / "j.xml", (0, 1), Ended(ExitCode.SAFETY_STOP, "port torque: <2 N*m>"))
    assert list(verdicts(suite).values()) == ["", "port torque: <2 N*m>", "not reached", "not reached"]
    (failure,) = suite.iter("failure")
    assert failure.get("type") == "SAFETY_STOP"


def test_what_fails_before_the_first_step_is_a_case_too(tmp_path: Path) -> None:
    suite = reported(tmp_path / "j.xml", (), Ended(ExitCode.CONNECTION, "can0 is not there"))
    assert verdicts(suite)["session"] == "can0 is not there"


def test_a_file_that_cannot_be_written_is_told_before_anything_moves(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cannot be written .*; name another file"):
        JUnitReport(tmp_path / "file" / "j.xml", "x").prepare()
