"""Tables and lines, at every width: what they say, without a colour."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import ExitCode
from norton_bench.events import Ended, PartMeasured, SessionState, StateChanged
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameter_result import ExpectationResult
from norton_bench.models.parameters import Estimate, Status
from norton_bench.records import TICK, Measured
from norton_bench.report.words import number
from norton_bench.rig.rig import Rig
from norton_bench.screen.experiment import Experiment, badge_of
from norton_bench.screen.panels import result
from norton_bench.screen.panels.health import health_rows
from norton_bench.screen.panels.progress import clock, log_rows, step_rows, title_row, view_row
from norton_bench.screen.panels.result import SIGNS, parameter_rows, result_rows, sparkline
from norton_bench.screen.picture.parts import EstimateHistory
from norton_bench.screen.picture.picture import LogLine, Picture
from norton_bench.screen.styles import Row, apart, fitted, heading, length

PHONE = 45
WIDTHS = (20, 34, 36, 46, 60, 70, 88, 100, 196)


def texts(rows: list[Row]) -> list[str]:
    return ["".join(text for text, _ in row) for row in rows]


@pytest.fixture
def at_end(replayed: Experiment) -> Experiment:
    assert replayed.replay is not None
    replayed.seek(replayed.replay.replay.duration_s)
    replayed.update()
    return replayed


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_wider_than_its_place(at_end: Experiment, width: int) -> None:
    picture = at_end.picture
    tables = [
        parameter_rows(picture.known, width, 12),
        step_rows(picture.steps, width, 8),
        health_rows(picture, width, 12),
        log_rows(picture.log, width, 8),
        [title_row(picture, at_end.what, "replay", width, badge_of(at_end))],
        [view_row(picture, ["Overview", "Loops"], 0, width)],
    ]
    for rows in tables:
        assert rows
        assert all(length(fitted(row, width)) == width for row in rows)
    assert all(length(row) <= width for rows in tables for row in rows[:1])


def test_parameters_are_told_without_colour(at_end: Experiment) -> None:
    wide = texts(parameter_rows(at_end.picture.known, 100, 12))
    assert wide[0].endswith("7 of 7 known")
    assert wide[1].startswith("Km·Ka torque gain")
    assert "…" in wide[1]
    assert "●" in wide[1]
    assert "valid" in wide[1]
    narrow = texts(parameter_rows(at_end.picture.known, 36, 12))
    assert narrow[1].split()[0] == "Km·Ka"
    assert "±" in narrow[1]
    assert "● valid" in narrow[1]


def test_every_status_has_a_sign_of_its_own() -> None:
    signs = [SIGNS[status][0] for status in Status]
    assert len(set(signs)) == len(list(Status))
    estimates = tuple(Estimate("inertia", 1e-5, 1e-7, "kg*m^2", status) for status in Status)
    for status, row in zip(Status, texts(parameter_rows(EstimateHistory(estimates), 60, 20))[1:], strict=True):
        assert f"{SIGNS[status][0]} {status.value}" in row


def test_no_word_of_a_status_is_cut_where_the_panel_is_shown() -> None:
    """At every width that the style sheet gives the parameters: .-narrow, .-medium, .-wide, .-widest."""
    css = (Path(result.__file__).parents[1] / "screen.tcss").read_text(encoding="utf-8")
    widths = [int(width) for width in re.findall(r"\.-\w+ #tables \{ width: (\d+); \}", css)]
    assert len(widths) == 4
    estimates = tuple(Estimate("viscous_damping", -9.9994e-4, 1e-8, "N*m*s/rad", status) for status in Status)
    for width in widths:
        rows = texts([fitted(row, width) for row in parameter_rows(EstimateHistory(estimates), width, 20)])
        for status, row in zip(Status, rows[1:], strict=True):
            assert status.value in row
            assert "−9.999" in row
            assert "±" in row


def test_the_final_fit_takes_the_place_of_live_values_and_says_so(at_end: Experiment) -> None:
    picture = at_end.picture
    assert "live" in texts(parameter_rows(picture.known, 40, 12))[0]
    final = tuple(replace(each, value=2 * each.value) for each in picture.known.estimates)
    picture.take(Ended(ExitCode.OK, estimates=final))
    picture.known.take(LiveEstimate(2**62, at_end.picture.known.estimates[:1]))
    rows = texts(parameter_rows(picture.known, 40, 12))
    assert rows[0].startswith("Parameters final fit")
    assert rows[0].endswith("7 of 7 known")
    assert number(final[0].value, 4) in rows[1]
    network = picture.known.network()
    assert network is not None
    assert network[final[0].name] == final[0].value


def test_without_a_final_fit_the_live_values_stay_and_are_named_so(at_end: Experiment) -> None:
    before = at_end.picture.known.estimates
    at_end.picture.take(Ended(ExitCode.EXPERIMENT_FAILED, "stopped"))
    assert at_end.picture.known.estimates == before
    assert "live" in texts(parameter_rows(at_end.picture.known, 40, 12))[0]


def test_a_sparkline_falls_as_intervals_narrow() -> None:
    line = sparkline([1.0, 0.1, 0.01, 0.001, 0.0001], 5)
    assert line == "".join(sorted(line, reverse=True))
    assert line[0] == "█"
    assert line[-1] == "▁"
    assert len(sparkline([0.1] * 50, 12)) == 12
    assert sparkline([float("nan"), 0.1], 3).startswith("  ")


def test_steps_that_do_not_fit_are_those_far_from_now(at_end: Experiment) -> None:
    rows = texts(step_rows(at_end.picture.steps, 40, 4))
    assert [row.split()[1] for row in rows[1:]] == ["free", "imposed", "validate"]
    assert clock(67.2) == "1:07"


def test_the_log_scrolls(at_end: Experiment) -> None:
    last, earlier = log_rows(at_end.picture.log, 80, 3), log_rows(at_end.picture.log, 80, 3, back=2)
    assert texts(last)[1:] != texts(earlier)[1:]
    assert "2 newer below" in texts(earlier)[0]


def test_the_bar_says_where_it_is(at_end: Experiment, live: Experiment) -> None:
    assert "‖ REPLAY" in texts([title_row(at_end.picture, "x", "", 80, badge_of(at_end))])[0]
    assert "○ READY" in texts([title_row(live.picture, "x", "", 80, badge_of(live))])[0]
    signs = set()
    for state in SessionState:
        live.picture.take(StateChanged(state))
        signs.add(badge_of(live)[0])
    assert len(signs) == len(list(SessionState))


def test_a_loop_that_is_late_says_how_much(rig: Rig) -> None:
    picture = Picture(rig)
    ticks = np.zeros(500, TICK)
    ticks["tick_ns"] = np.arange(500) * 1_000_000
    ticks["tick_ns"][400:] += 2_000_000
    ticks["lateness_ns"], ticks["work_ns"], ticks["receive_ns"] = 40_000, 120_000, 30_000
    picture.take(PartMeasured(Measured(ticks=ticks), LiveEstimate(0)))
    rows = texts(health_rows(picture, 60, 20))
    loop = next(row for row in rows if "loop" in row)
    assert loop.startswith("▲ loop")
    assert "2 of 502 skipped" in loop
    said = {row.split()[0]: row.split()[1] for row in rows if row.startswith("    ") and row.split()[-1].isdigit()}
    assert (said["late"], said["work"], said["receive"]) == ("40", "120", "30")


def test_a_result_is_a_page(at_end: Experiment) -> None:
    estimates = at_end.picture.known.estimates
    judged = (ExpectationResult("a", True, "τc is within 1 %"), ExpectationResult("b", False, "β is not within 1 %"))
    verdict = ("The bandwidth is known badly: nothing above 20 Hz was excited, so raise the multisine's end.",)
    summary = Ended(ExitCode.OK, "", None, None, None, estimates, verdict, 0.024, 0.017, judged)
    for width in (60, 76, 116, 156, 196):
        page = texts(result_rows(summary, width))
        assert all(len(row) <= width for row in page)
        assert "✓ 7 of 7 parameters are known." in page
        assert any("2.4 % of it" in row for row in page)
        assert any(row.startswith("✗ β is not") for row in page)
        assert re.sub(r"\s+", " ", " ".join(page)).count("raise the multisine's") == 1
    assert max(len(row.rstrip()) for row in texts(result_rows(summary, 156))) > 140
    failed = texts(result_rows(Ended(ExitCode.SAFETY_STOP, "the port torque was 1.2 N*m"), 76))
    assert failed[0] == "■ the port torque was 1.2 N*m"


def test_on_a_phone_nothing_of_the_result_is_cut() -> None:
    """Value, status and interval of every parameter, every word of an expectation."""
    longest = tuple(Estimate("viscous_damping", -9.8765e-4, 1e-8, "N*m*s/rad", status) for status in Status)
    judged = (ExpectationResult("b", False, "the amplifier bandwidth is not within 1 % of what was expected: 600.5"),)
    summary = Ended(ExitCode.OK, estimates=longest, torque_relative=0.024, expectations=judged)
    page = texts(result_rows(summary, PHONE - 1))  # a column is the scroll bar's
    assert all(len(row) < PHONE for row in page)
    for status in Status:
        place = next(place for place, row in enumerate(page) if row.endswith(f"{SIGNS[status][0]} {status.value}"))
        assert "−9.8765·10⁻⁴ N·m·s/rad" in page[place]
        assert page[place + 1].strip() == "(−9.87670 … −9.87630)·10⁻⁴"
    words = " ".join(" ".join(page).split())
    assert judged[0].sentence in words
    assert "2.4 % of it rms error on motion kept apart from the fit" in words


def test_on_a_phone_a_long_event_is_folded(at_end: Experiment) -> None:
    text = "the torque at the port was 1.2 N*m, which is more than the limit of the rig file allows"
    at_end.picture.log.add(LogLine(12.3, "stop", text))
    rows = texts(log_rows(at_end.picture.log, PHONE, 6))
    assert len(rows) <= 6
    assert all(len(row) <= PHONE for row in rows)
    assert " ".join(" ".join(rows).split()).endswith(f"12.3 s stop {text}")


def test_on_a_phone_the_chosen_view_alone_has_its_name(at_end: Experiment) -> None:
    row = texts([view_row(at_end.picture, ["Overview", "Loops", "Source", "Bench"], 1, PHONE)])[0]
    assert row.startswith(" 1  2 Loops  3  4 ")
    assert row.split()[-1] == clock(at_end.picture.now_s)


def test_pieces_fit_together() -> None:
    assert texts([apart([("left", "text")], [("right", "text")], 12)]) == ["left   right"]
    assert texts([apart([("long left", "text")], [("right", "text")], 9)]) == ["lon right"]
    assert texts([heading("Torque", "mN·m", "12 mN·m", 30)]) == ["Torque mN·m ────────── 12 mN·m"]
    assert texts([heading("Velocity", "rad/s", "1 rad/s", 20, "╌ asked for")]) == ["Velocity rad/s ─────"]
