"""Source and impedance of an actuator without a model, as they fill in while the session runs."""

from dataclasses import replace
from math import isnan, nan
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import ExitCode
from norton_bench.events import Ended, PartMeasured, StepBegun
from norton_bench.identification.results import LiveEstimate
from norton_bench.records import TICK, Measured, SegmentInfo
from norton_bench.report.words import Facts
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.screen import figures
from norton_bench.screen.panels.progress import table_rows
from norton_bench.screen.panels.result import result_rows
from norton_bench.screen.picture.picture import STEP, Picture
from norton_bench.screen.styles import Row, length
from norton_bench.segments import Use

RIGS = Path(__file__).parents[3] / "rigs"
TICK_NS, PART_TICKS = 1_000_000, 100
# Procedure, segment, command, position and torque: what the bench does in turn, a part of ticks each.
SOURCE = (
    ("tabulate_source", "move", 0.1, 0.05, 0.02),
    ("tabulate_source", "read actuator", -0.2, -0.21, 0.0),
    ("tabulate_source", "read actuator", 0.2, 0.19, 0.001),
    ("tabulate_source", "read actuator", -0.1, -0.09, 0.0),
)
EXTERNAL = (("tabulate_source", "read external", 0.2, 0.15, 0.02),)
HELD = (
    ("tabulate_impedance", "read", 0.1, 0.1, 0.0),
    ("tabulate_impedance", "hold falling", 0.1, 0.05, 0.14),
    ("tabulate_impedance", "shake", 0.1, 0.05, 0.14),
    ("tabulate_impedance", "hold rising", 0.1, 0.15, -0.14),
)


def parts(*rows: tuple[str, str, float, float, float]) -> list[Measured]:
    """One part for each row."""
    made = []
    for index, (procedure, name, command, position_rad, torque_nm) in enumerate(rows):
        ticks = np.zeros(PART_TICKS, TICK)
        first_ns = 10**9 + index * PART_TICKS * TICK_NS
        ticks["tick_ns"] = first_ns + np.arange(PART_TICKS) * TICK_NS
        ticks["segment"], ticks["command"], ticks["torque_nm"] = index, command, torque_nm
        ticks["position_rad"] = position_rad
        end_ns = first_ns + PART_TICKS * TICK_NS
        segment = SegmentInfo(index, procedure, name, Use.IDENTIFY, "admittance", first_ns, end_ns)
        made.append(Measured(ticks=ticks, segments=(segment,)))
    return made


def shown(rig: Rig, *rows: tuple[str, str, float, float, float]) -> Picture:
    picture = Picture(replace(rig, model="none", command=replace(rig.command, unit="rad")))
    for part in parts(*rows):
        picture.take(PartMeasured(part, LiveEstimate(0, ())))
    return picture


def texts(rows: list[Row]) -> list[str]:
    return ["".join(text for text, _ in row) for row in rows]


def test_every_reading_is_a_row_and_says_from_which_side_it_was_come_to(rig: Rig) -> None:
    picture = shown(rig, *SOURCE, *EXTERNAL, *HELD)
    found = [(each.what, each.rising) for each in picture.tabulated.readings.values()]
    assert found == [
        *(("source", False), ("source", True), ("source", False)),
        ("external", True),
        *(("source", False), ("held", False), ("held", True)),
    ]
    rows = texts(table_rows(picture.tabulated, "rad", 60, 20))
    assert rows[0].endswith("7 readings")
    assert rows[1].split() == ["command", "position", "torque"]
    assert rows[2].split() == ["[rad]", "[rad]", "[N·m]"]
    assert rows[3].split() == ["▾", "source", "−0.200", "−0.210", "0"]
    assert rows[-1].split() == ["▴", "held", "0.100", "0.150", "−0.140"]


def test_a_reading_under_way_follows_its_newest_ticks(rig: Rig) -> None:
    first, second = parts(SOURCE[1], SOURCE[1])
    second.ticks["segment"], second.ticks["position_rad"] = 0, -0.2
    picture = shown(rig)
    for part in (first, replace(second, segments=first.segments)):
        picture.take(PartMeasured(part, LiveEstimate(0, ())))
    (reading,) = picture.tabulated.readings.values()
    assert reading.position_rad == pytest.approx(-0.2)


def test_the_newest_readings_stay_where_there_is_no_room_for_all(rig: Rig) -> None:
    picture = shown(rig, *SOURCE, *HELD)
    rows = table_rows(picture.tabulated, "rad", 46, 5)
    assert [text.split()[1] for text in texts(rows)[3:]] == ["held", "held"]
    assert all(length(row) <= 46 for row in rows)


def test_without_a_torque_sensor_a_place_is_a_place_all_the_same(rig: Rig) -> None:
    picture = shown(rig, ("tabulate_source", "read actuator", 0.2, 0.19, nan))
    (reading,) = picture.tabulated.readings.values()
    assert isnan(reading.torque_nm)
    assert texts(table_rows(picture.tabulated, "rad", 60, 20))[-1].split() == ["▴", "source", "0.200", "0.190", "–"]


def test_before_anything_was_read_the_panels_say_what_will_be(rig: Rig) -> None:
    picture = shown(rig)
    assert "source and torques are tabulated" in " ".join(texts(table_rows(picture.tabulated, "rad", 46, 9))[1:])
    assert figures.source(picture).empty == "fills in while 'tabulate_source' runs"


def test_the_source_is_drawn_as_places_of_one_port(rig: Rig) -> None:
    figure = figures.source(shown(rig, *SOURCE))
    assert (figure.title, figure.y.unit, figure.latest) == ("Motion source", "rad", "▴▾ 3 levels")
    rising, falling = figure.markers
    assert (list(rising.x), list(rising.y)) == ([pytest.approx(0.2)], [pytest.approx(0.19)])
    assert list(falling.x) == [pytest.approx(-0.2), pytest.approx(-0.1)]
    external = figures.source(shown(rig, *SOURCE, *EXTERNAL))
    assert (external.title, external.latest) == ("Motion source, external port", "▴▾ 1 levels")


def test_a_motor_with_gravity_is_drawn_as_places_once_it_is_tabulated(rig: Rig) -> None:
    picture = Picture(rig)
    assert figures.source(picture).y.unit == "rad/s"
    for part in parts(*SOURCE):
        picture.take(PartMeasured(part, LiveEstimate(0, ())))
    assert figures.source(picture).y.unit == "rad"


def test_the_result_shows_the_tables() -> None:
    facts = Facts(("port", "command [rad]", "rests at [rad]"), (("actuator", "0.1333", "0.1333 ± 0.0003"),))
    rows = texts(result_rows(Ended(ExitCode.OK, tables=(facts, facts)), 80))
    assert rows[0] == "✓ Done; the results are below."
    assert [row.split("─")[0].strip() for row in rows if row.startswith("Tables")] == ["Tables with 95 % intervals"]
    told = [row for row in rows if "0.1333 ± 0.0003" in row]
    assert len(told) == 2
    assert told[0].index("0.1333") > told[0].index("actuator")


def test_a_narrow_panel_still_has_the_torque(rig: Rig) -> None:
    small = ("tabulate_impedance", "hold rising", 0.1, 0.15, -4e-4)
    rows = table_rows(shown(rig, HELD[0], small).tabulated, "rad", 36, 20)
    assert all(length(row) <= 36 for row in rows)
    assert texts(rows)[-1].split() == ["▴", "held", "0.100", "0.150", "−0.0004"]


def test_a_table_that_is_wider_than_the_screen_goes_on_below() -> None:
    head = ("command [rad]", "modulation [N·m/rad]", "source [rad]", "stiffness [N·m/rad]", "friction [mN·m]")
    facts = Facts(head, (("0.2", "1", "0.19", "7.5", "16"), ("0.2", "4", "0.18", "9.5", "17")))
    rows = texts(result_rows(Ended(ExitCode.OK, tables=(facts,)), 80))
    heads = [row.split("  ") for row in rows if "command" in row]
    assert [[word.strip() for word in words if word.strip()] for words in heads] == [
        [*head[:2], *head[2:4]],
        [*head[:2], head[4]],
    ]
    assert [row.split() for row in rows if row.split()[:2] == ["0.2", "4"]] == [
        ["0.2", "4", "0.18", "9.5"],
        ["0.2", "4", "17"],
    ]
    wide = texts(result_rows(Ended(ExitCode.OK, tables=(facts,)), 120))
    assert sum("command" in row for row in wide) == 1


def test_the_result_says_whether_the_port_tells() -> None:
    said = (
        "Unique zero: does not hold; backlash: between -10 mrad and 10 mrad from its place of rest nothing is exerted."
    )
    rows = texts(result_rows(Ended(ExitCode.OK, conditions=(said,)), 60))
    place = next(index for index, row in enumerate(rows) if row.startswith("Conditions"))
    assert " ".join(row.strip(" ·") for row in rows[place + 1 :]).strip() == said


def test_the_result_says_what_trials_came_to() -> None:
    said = "In situ, 9 trials: the actuator exerted 0.11 mN·m at last, at least 39 dB below the first."
    rows = texts(result_rows(Ended(ExitCode.OK, trials=(said,)), 60))
    assert rows[0] == "✓ Done; the results are below."
    assert " ".join(rows[rows.index(next(row for row in rows if row.startswith("Trials"))) + 1 :]).strip() == said


def test_a_step_that_comes_twice_is_logged_twice(rig: Rig) -> None:
    picture = Picture(rig)
    for index in range(2):
        picture.take(StepBegun(index, "tabulate_source"))
    assert [line.kind for line in picture.log.lines] == [STEP, STEP]


def test_a_bench_without_a_torque_sensor_promises_nothing_that_needs_one() -> None:
    picture = Picture(load_rig(RIGS / "sim-in-situ.toml"))
    for part in parts(("in_situ", "trial 1", 0.1, 0.2, nan)):
        picture.take(PartMeasured(part, LiveEstimate(0, ())))
    for made in (figures.torque(picture, 5.0), figures.torque_velocity(picture), figures.torque_position(picture)):
        assert (made.traces, made.empty) == ((), "no torque sensor on this bench")
    assert figures.source(picture).empty == "identified in situ, at the end"
    assert picture.in_situ


def test_a_dynamometer_and_a_free_shaft_promise_their_parameters(rig: Rig) -> None:
    for each in (rig, load_rig(RIGS / "sim-free-shaft.toml")):
        picture = Picture(each)
        assert not picture.in_situ
        assert figures.source(picture).empty == "fills in while the step 'free' runs"
    assert figures.torque(Picture(rig), 5.0).empty == "nothing measured yet"
