"""The sheet itself: on one network, on a whole session, on two side by side; as page, as paper and as data."""

import json
import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from norton_bench.cli import app
from norton_bench.datasheet import data as data_module
from norton_bench.datasheet.data import comparison_data, content_of, html, sheet_data
from norton_bench.datasheet.evidence import evidence
from norton_bench.datasheet.pictures import BACKDRIVING, BODE, ENVELOPE, HYSTERESIS, drawings, pictures
from norton_bench.datasheet.printed import LEAST_SHARE, _height_in, _share, pages, write_pdf
from norton_bench.datasheet.sheet import Sheet, compared, sheet_of_network, sheet_of_result
from norton_bench.datasheet.tables import (
    difference_table,
    parameter_difference_table,
    parameter_table,
    remarks,
    valid_where,
)
from norton_bench.errors import ExperimentError, UsageError
from norton_bench.report import svg
from norton_bench.report.svg import Palette
from norton_bench.report.words import between
from norton_bench.result import Result
from tests.bench.models.test_derived import motor_with_terms, network
from tests.bench.networks.some import PNEUMATIC
from tests.bench.whole_session import whole_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return whole_session(tmp_path_factory).result


@pytest.fixture(scope="module")
def recorded(session: Result) -> Sheet:
    return sheet_of_result(session)


@pytest.fixture
def alone() -> Sheet:
    return sheet_of_network(network(), "some.network.json")


@pytest.fixture
def few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first two alone: drawing all of them takes nearly all of a sheet's time."""
    monkeypatch.setattr(data_module, "pictures", lambda sheets: islice(pictures(sheets), 2))


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    assert app.main(["datasheet", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_recording_adds_points_that_agree_with_its_network(recorded: Sheet) -> None:
    spectra = recorded.evidence.spectra
    assert spectra is not None
    gain = recorded.network.torque_gain
    low = spectra.torque.frequency_hz < 20.0
    assert np.median(np.abs(spectra.torque.response[low])) == pytest.approx(gain, rel=0.1)
    assert recorded.evidence.loops
    assert [point.name for point in recorded.points] == ["as measured", "rig's limits"]
    assert recorded.points[1].command == 0.5


def test_friction_is_told_against_temperature_where_that_moved(session: Result) -> None:
    """The simulated friction knows no temperature: a drive that warms up by 20 K changes nothing."""
    fit, measured = session.fit, session.measured
    assert fit is not None
    assert measured is not None
    ticks = measured.ticks.copy()
    ticks["transistor_temperature_c"] = np.linspace(25.0, 45.0, len(ticks))
    warming = evidence(fit, replace(measured, ticks=ticks), None, 1e-3).warming
    assert warming is not None
    assert (warming.from_c, warming.to_c) == (25.0, 45.0)
    # Three deviations; and it tells a change of a tenth of the friction.
    assert abs(warming.change_nm) < 1.5 * warming.half_width_nm
    assert warming.half_width_nm < 0.1 * fit.network.coulomb_torque_nm


def test_friction_that_falls_as_it_warms_is_told(session: Result) -> None:
    """Torque that opposes the motion is added to what was measured, in proportion to the temperature."""
    fit, measured, fallen_nm = session.fit, session.measured, 4e-3
    assert fit is not None
    assert measured is not None
    ticks, torque, motion = measured.ticks.copy(), measured.torque.copy(), measured.motion
    ticks["transistor_temperature_c"] = np.linspace(25.0, 45.0, len(ticks))
    warmth = np.interp(torque["arrival_ns"], ticks["tick_ns"], np.linspace(0.0, 1.0, len(ticks)))
    moved = np.gradient(np.asarray(motion["position_rad"], dtype=np.float64))
    direction = np.sign(np.interp(torque["arrival_ns"], motion["arrival_ns"], np.convolve(moved, np.ones(9), "same")))
    torque["torque_nm"] += fallen_nm * warmth * direction
    warming = evidence(fit, replace(measured, ticks=ticks, torque=torque), None, 1e-3).warming
    assert warming is not None
    # Three deviations, and the instants at which the direction was taken a few milliseconds off.
    assert warming.change_nm == pytest.approx(-fallen_nm, abs=1.5 * warming.half_width_nm + 0.05 * fallen_nm)


def test_sentences_of_two_sheets_are_said_once(alone: Sheet) -> None:
    one, other = alone, replace(alone, told=("Only this one.",))
    told = content_of([one, other]).told
    assert "B: Only this one." in told
    assert sum("From the network alone" in sentence for sentence in told) == 1


def test_on_paper_rows_stay_whole_under_a_head(recorded: Sheet) -> None:
    """No page begins within a row: what stands highest on each is the sheet's title or a table's head."""
    words, palette = replace(content_of([recorded]), pictures=()), Palette.of_print()
    with palette.style():
        drawn = list(pages(words, [recorded], palette))
    highest = [max(page.texts, key=lambda text: text.get_position()[1]) for page in drawn]
    assert len(drawn) == 2
    level = {text.get_text() for text in drawn[1].texts if text.get_position()[1] == highest[1].get_position()[1]}
    assert highest[0].get_text() == "Data sheet · Norton Bench"
    assert level >= {"figure", "value", "unit"}


def test_on_paper_pictures_are_less_high_so_that_one_more_has_room() -> None:
    room_in = 0.8 * (_height_in(ENVELOPE) + _height_in(BACKDRIVING))
    share = _share((ENVELOPE, BACKDRIVING), room_in)
    lower = [replace(each, height_in=share * each.height_in) for each in (ENVELOPE, BACKDRIVING)]
    assert LEAST_SHARE < share < 1.0
    assert sum(map(_height_in, lower)) == pytest.approx(room_in)
    assert _share((ENVELOPE,), room_in) == 1.0


def test_side_by_side_no_legend_covers_what_is_drawn(recorded: Sheet) -> None:
    palette = Palette.of_print()
    with palette.style():
        for picture in (ENVELOPE, BACKDRIVING, BODE, HYSTERESIS):
            drawn = svg.figure(picture.height_in)
            picture.draw(drawn, drawings([recorded, recorded], palette), palette)
            drawn.canvas.draw()
            legends = [legend for axes in drawn.axes if (legend := axes.get_legend()) is not None]
            assert legends
            highest = max(axes.bbox.y1 for axes in drawn.axes)
            assert all(legend.get_window_extent().y0 >= highest for legend in legends), picture.name


def test_steady_velocities_lie_on_the_network(session: Result, recorded: Sheet) -> None:
    """What the shaft still does on its way to a velocity is left out."""
    assert recorded.evidence.sliding
    network = recorded.network
    for each in recorded.evidence.sliding:
        velocity, torque = each.samples.velocity_rad_s, each.samples.measured_nm
        quick = np.abs(velocity) > 5.0
        steady = network.torque_gain * each.command - network.viscous_damping_nms_rad * velocity
        steady = steady - np.sign(velocity) * network.coulomb_torque_nm
        assert np.median(np.abs(torque - steady)[quick]) < 0.1 * network.coulomb_torque_nm


def test_ratios_alone_make_a_sheet_without_torques() -> None:
    page = html([sheet_of_network(network().with_provenance({"scale": "per unit of torque gain"}), "free.json")])
    assert "No torque was measured" in page
    assert "stall torque" not in page
    assert "mechanical time constant" in page


def test_it_says_what_was_not_measured(recorded: Sheet, alone: Sheet) -> None:
    sentences = " ".join(remarks(recorded))
    assert "no electrical efficiency: the current of the motor and the voltage of the supply were recorded" in sentences
    mute = replace(recorded, evidence=replace(recorded.evidence, has_supply=False))
    assert "the current of the motor was recorded, but no voltage." in " ".join(remarks(mute))
    assert "too little to tell what warmth does" in sentences
    assert "From the network alone" in " ".join(remarks(alone))


@pytest.mark.long
def test_a_page_needs_nothing_else_and_is_the_same_again(recorded: Sheet) -> None:
    page = html([recorded])
    assert page == html([recorded])
    assert not re.search(r'(?:src|href)="http', page)
    for picture in ("envelope", "backdriving", "bode", "hysteresis", "efficiency"):
        assert f'id="{picture}"' in page


@pytest.mark.long
def test_a_network_alone_has_no_measured_points(alone: Sheet) -> None:
    page = html([alone])
    assert 'id="bode"' in page
    assert 'id="hysteresis"' not in page
    assert ">measured</text>" not in page


def test_a_value_without_an_interval_says_why(alone: Sheet) -> None:
    """The network's file has no covariance of what the measured current adds."""
    with_current = replace(network(), torque_constant=0.05, amplifier_gain=18.0)
    sheet = sheet_of_network(with_current, "some.network.json")
    assert sheet.told[0].startswith("No interval is given for Km and Ka: this file does not hold their covariance")
    assert not any("No interval" in sentence for sentence in alone.told)
    (row,) = (row for row in parameter_table(sheet).rows if row[0] == "Km")
    assert row[2:4] == ("0.05000", "–")


@pytest.mark.usefixtures("few_pictures")
def test_a_network_tells_which_of_its_values_are_not_valid() -> None:
    of_session = network().with_provenance({"model": "dahl_motor", "status": "viscous_damping=inadequate"})
    sheet = sheet_of_network(of_session, "some.network.json")
    assert {each.name for each in sheet.parameters if not each.settled} == {"viscous_damping"}
    figures = {each.row.name: each for each in sheet.figures()}
    assert not figures["mechanical_time_constant"].settled
    assert figures["breakaway_torque"].settled
    assert "dahl_motor" not in html([sheet])


@pytest.mark.long
@pytest.mark.usefixtures("few_pictures")
def test_on_paper_it_is_the_same_file_again(alone: Sheet, tmp_path: Path) -> None:
    first, second = (write_pdf(tmp_path / name, [alone]).read_bytes() for name in ("a.pdf", "b.pdf"))
    assert first[:5] == b"%PDF-"
    assert first == second


def test_paper_that_cannot_be_written_is_told(alone: Sheet, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ExperimentError, match="cannot write the data sheet"):
        write_pdf(tmp_path / "file" / "sheet.pdf", [alone])


def test_the_same_motor_twice_does_not_differ(alone: Sheet) -> None:
    differences = compared(alone, alone)
    assert len(differences) == len(alone.figures())
    assert not any(each.significant for each in differences)
    assert all(each.value == 0.0 for each in differences)


def test_what_differs_is_named_and_nothing_else(alone: Sheet) -> None:
    stiffer = sheet_of_network(network(presliding_stiffness=12.0), "other.json")
    differ = {each.first.row.name for each in compared(alone, stiffer) if each.significant}
    assert differ == {"presliding_displacement", "lost_motion", "contact_resonance", "contact_damping_ratio"}


def test_independent_repetitions_seldom_differ() -> None:
    """Two networks whose values scatter as their covariances say: anything differs in one pair of sheets of twenty."""
    rng = np.random.default_rng(4)
    significant = []
    for _ in range(60):
        sheets = []
        for _ in range(2):
            gain, coulomb, stiffness = 1 + 0.01 * rng.standard_normal(3)
            own = replace(
                network(),
                torque_gain=gain * network().torque_gain,
                coulomb_torque_nm=coulomb * network().coulomb_torque_nm,
                presliding_stiffness_nm_rad=stiffness * network().presliding_stiffness_nm_rad,
            )
            sheets.append(sheet_of_network(own, "x"))
        significant.append(any(each.significant for each in compared(*sheets)))
    # Binomial: of 60 with a chance of 5 % each, 10 or more come once in a thousand times.
    assert sum(significant) < 10


def test_side_by_side_each_has_its_interval_and_its_status(alone: Sheet) -> None:
    """A row below the values: the interval of each, and why there is none."""
    told = network().with_provenance({"status": "viscous_damping=inadequate"})
    other = sheet_of_network(told, "other.json")
    table = parameter_difference_table(alone, other)
    place = next(place for place, row in enumerate(table.rows) if row[1] == "torque per velocity")
    (damping,) = (each for each in alone.parameters if each.name == "viscous_damping")
    interval = between(damping.value, damping.interval)[1]
    assert table.rows[place + 1][1:] == ("95 % interval", interval, "–", "", "", "B: inadequate")
    figures = difference_table(compared(alone, other))
    place = next(place for place, row in enumerate(figures.rows) if row[0] == "Tm")
    assert figures.rows[place][4] == "–"
    assert figures.rows[place + 1][3:] == ("–", "", "", "B: inadequate")


def test_side_by_side_what_lies_beyond_the_measurements_is_marked(recorded: Sheet) -> None:
    table = difference_table(compared(recorded, recorded))
    place = next(place for place, row in enumerate(table.rows) if row[1].startswith("stall torque (rig's limits"))
    assert table.rows[place + 1][-1] == "extrapolated"
    data = next(each for each in comparison_data(compared(recorded, recorded)) if each["name"] == "stall_torque")
    assert data["extrapolated"] == [False, False]
    assert data["statuses"] == ["valid", "valid"]
    assert all(low < value < high for value, (low, high) in zip(data["values"], data["intervals"], strict=True))


@pytest.mark.parametrize("deviations", [2.2, 4.0])
def test_a_parameter_differs_as_it_does_between_runs(alone: Sheet, deviations: float) -> None:
    """More than 1.96 deviations are nothing unusual among seven parameters."""
    (gain,) = (each for each in alone.parameters if each.name == "torque_gain")
    apart = gain.value + deviations * 2**0.5 * gain.std
    other = replace(alone, parameters=(replace(gain, value=apart), *alone.parameters[1:]))
    row = parameter_difference_table(alone, other).rows[0]
    assert row[-1] == ("differs" if deviations > 3 else "")


def test_other_commands_leave_what_can_be_compared(alone: Sheet) -> None:
    other = sheet_of_network(replace(network(), command_unit="A"), "other.json")
    names = {each.first.row.name for each in compared(alone, other)}
    assert "torque_bandwidth" in names
    assert not names & {"stall_torque", "breakaway_command"}
    assert 'id="bode"' in html([alone, other])


def test_data_has_a_unit_and_an_interval_for_every_figure(recorded: Sheet) -> None:
    data = sheet_data(recorded)
    assert {each["name"] for each in data["figures"]} >= {"stall_torque", "torque_bandwidth", "lost_motion"}
    assert all(each["unit"] is not None and len(each["interval"]) == 2 for each in data["figures"] if each["interval"])
    assert data["measured"]["spectra"]["averages"] > 0


@pytest.mark.long
@pytest.mark.usefixtures("few_pictures")
def test_the_command_writes_page_paper_and_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = tmp_path / "a.network.json", tmp_path / "b.network.json"
    network().save(first)
    network(coulomb_torque=0.03).save(second)
    data = told(capsys, first)
    assert Path(data["datasheet"]) == tmp_path / "a.datasheet.html"
    assert Path(data["datasheet"]).is_file()
    assert data["differences"] is None
    data = told(capsys, first, "--against", second, "--out", tmp_path / "both.pdf")
    assert (tmp_path / "both.pdf").read_bytes()[:5] == b"%PDF-"
    (breakaway,) = (each for each in data["differences"] if each["name"] == "breakaway_torque")
    assert breakaway["significant"]
    assert breakaway["difference"] == pytest.approx(0.01)


def test_what_it_cannot_do_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    network().save(tmp_path / "a.network.json")
    assert app.main(["datasheet", str(tmp_path / "a.network.json"), "--out", str(tmp_path / "a.docx")]) == 2
    assert "end in .html or .pdf" in capsys.readouterr().err
    with pytest.raises(UsageError, match="no identified motor"):
        sheet_of_network(PNEUMATIC, "muscle.json")
    with pytest.raises(UsageError, match="no covariance"):
        sheet_of_network(replace(network(), covariance_names=(), covariance=()), "bare.json")


@pytest.mark.usefixtures("few_pictures")
def test_terms_stand_on_the_sheet_with_how_the_figures_have_them() -> None:
    sheet = sheet_of_network(motor_with_terms(), "some.network.json")
    assert {"stribeck_torque", "load_friction", "quadratic_drag"} <= {each.name for each in sheet.parameters}
    page = html([sheet])
    assert "Coulomb torque at rest less that in fast sliding" in page
    assert "(Δτ = 0.008 N·m, v_s = 2 rad/s); the figures hold this." in page
    assert ", 8 periods a turn; the figures are the mean over a turn." in page
    assert "p = 8" not in page


def test_cogging_is_said_by_its_amplitude() -> None:
    (cogging,) = (term for term in motor_with_terms().terms if term.name == "cogging")
    wave = replace(cogging, values=(3e-4, -4e-4), periods_per_turn=42.0)
    sheet = sheet_of_network(replace(network(), terms=(wave,)), "some.network.json")
    said = "A torque acts that depends on the position: cogging of 0.500 mN·m, 42 periods a turn; "
    assert any(sentence.startswith(said) for sentence in sheet.told)


def test_a_speed_beyond_what_the_rig_allows_says_so(recorded: Sheet) -> None:
    (speed,) = (
        each for each in recorded.figures() if each.row.name == "no_load_speed" and each.at == recorded.points[1]
    )
    assert speed.value > recorded.points[1].velocity_rad_s
    assert valid_where(speed, recorded).endswith("rig's limits; extrapolated beyond 80.0 rad/s")


def test_a_bandwidth_above_the_measured_points_says_so(recorded: Sheet) -> None:
    spectra = recorded.evidence.spectra
    assert spectra is not None
    figures = {each.row.name: each for each in recorded.figures()}
    last_hz = spectra.torque.frequency_hz.max()
    assert figures["torque_bandwidth"].value > last_hz
    said = f"by the model: points end at {last_hz:.0f} Hz"
    assert all(valid_where(figures[name], recorded) == said for name in ("torque_bandwidth", "torque_rise_time"))
    assert valid_where(figures["breakaway_torque"], recorded) == "measured range"
    slow = replace(recorded, network=replace(recorded.network, amplifier_bandwidth_rad_s=6.0 * last_hz))
    assert valid_where(figures["torque_bandwidth"], slow) == "measured range"
