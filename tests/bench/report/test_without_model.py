"""What the report says and draws of table, operator and residual."""

from dataclasses import replace

import numpy as np

from norton_bench.identification.residual_tests import ResidualTests
from norton_bench.identification.results import Cogging
from norton_bench.report.figures_fit import impedance_table_figure, operator_figure, residual_tests_figure
from norton_bench.report.sections_checks import (
    residual_sentences,
    residuals_section,
    source_sentences,
    without_model_section,
)
from norton_bench.report.svg import style
from norton_bench.result import Result


def test_each_way_of_predicting_has_its_row(full: Result) -> None:
    (table,) = without_model_section(full).tables
    assert [row[0] for row in table.rows] == ["model", "operator", "table"]
    assert [row[2] for row in table.rows] == ["1.10", "1.13", "15.6"]
    assert table.rows[2][4] == "93 %"


def test_empty_cells_are_said_to_be_empty(full: Result) -> None:
    text = " ".join(without_model_section(full).sentences)
    assert "1 cell is empty" in text
    assert "yields gradually" in text
    assert "error would be 2.20 mN·m" in text


def test_nothing_unseen_leaves_the_comparison_out(full: Result) -> None:
    found = replace(full.without_model, operator_prediction=None, table_prediction=None, stops_alone=None)
    assert without_model_section(replace(full, without_model=found)).tables == ()


def test_a_table_alone_or_an_operator_alone_will_do(full: Result) -> None:
    for missing in ("table", "operator"):
        found = replace(full.without_model, **{missing: None})
        assert len(without_model_section(replace(full, without_model=found)).figures) == 1


def test_every_measured_cell_is_drawn(full: Result) -> None:
    with style():
        curves, left = impedance_table_figure(full.without_model.table, full.network, "N*m").axes
    drawn = sum(len(line.get_xdata()) for line in curves.get_lines() if line.get_linestyle() == "None")
    assert drawn == 17
    assert len(left.containers) == 6  # bars of three commands on either side of rest


def test_the_operators_strengths_are_drawn(full: Result) -> None:
    with style():
        (axes,) = operator_figure([], full.without_model.operator, 2e-3).axes
    assert sum(bar.get_height() for bar in axes.patches) == np.float64(20.0)


def test_the_residual_in_words(full: Result) -> None:
    text = " ".join(residual_sentences(full.residuals))
    assert "with 42 periods a turn: cogging of 0.30 mN·m" in text
    assert "follows acceleration (0.22 mN·m rms, 5.0 % of its variance): inertia or a resonance near 110 Hz" in text
    assert "follows velocity" in text
    assert "command" not in text
    assert "not white noise (p < 0.001" in text


def test_cogging_that_the_network_has_is_not_told_as_something_else(full: Result) -> None:
    """With the network's value: that of the residual alone is a rougher one."""
    first, *_ = residual_sentences(full.residuals, known=(Cogging(42.0, 0.31e-3, 0.01e-3), Cogging(7.0, 1e-3, 1e-4)))
    assert first.startswith("What the parameters alone leave follows position with 42 periods a turn: the network has ")
    assert first.endswith("this cogging, 0.31 ± 0.02 mN·m.")


def quiet(tests: ResidualTests) -> ResidualTests:
    """The same, with nothing found."""
    calm = tuple(replace(each, p_value=0.4) for each in tests.dependences)
    return replace(tests, harmonics=(), dependences=calm, memory=replace(tests.memory, p_value=0.37))


def test_a_residual_that_tells_nothing(full: Result) -> None:
    first, second = residual_sentences(quiet(full.residuals))
    assert "follows none of the command, velocity, acceleration, position" in first
    assert "uncorrelated with itself" in second
    assert "p = 0.37" in second


def test_a_residual_of_the_motion_is_told_in_the_commands_unit(full: Result) -> None:
    known = replace(full.fit, network=full.fit.network.with_provenance({"scale": "free motion only"}))
    tests = replace(full.residuals, memory=None, dependences=full.residuals.dependences[:1])
    section = residuals_section(replace(full, fit=known, residuals=tests))
    assert section.sentences == (
        "The residual follows position with 42 periods a turn: cogging of 0.30 mN·m of command.",
    )


def test_an_acceleration_at_the_edge_of_the_band_is_no_resonance_within_it(full: Result) -> None:
    edge = tuple(replace(each, peak_hz=160.0) for each in full.residuals.dependences)
    text = " ".join(residual_sentences(replace(full.residuals, dependences=edge)))
    assert "upper edge of the band" in text
    assert "near 160" not in text


def test_a_panel_for_each_input_beside_memory_and_position(full: Result) -> None:
    with style():
        titles = [axes.get_title(loc="left") for axes in residual_tests_figure(full.residuals).axes]
        alone = residual_tests_figure(replace(full.residuals, dependences=())).axes
    assert titles[2:] == ["Command", "Velocity", "Acceleration"]
    assert len(alone) == 2


def test_a_spectrum_of_nothing_can_be_drawn(full: Result) -> None:
    blank = replace(full.residuals, spectrum_nm=np.full(256, np.nan), harmonics=())
    assert residuals_section(replace(full, residuals=blank)) is not None


def test_the_branches_in_words(full: Result) -> None:
    text = " ".join(source_sentences(full.source_map, "N·m"))
    assert "rising, the shaft rests over a range of 0.04" in text
    assert "falling, the shaft rests over a range of 0.04" in text
    assert "hysteresis" in text
    assert "torque left at the port" not in text


def test_torque_that_was_taken_off_is_told(full: Result) -> None:
    port_nm = np.full(22, -2e-4)
    source = replace(full.source_map, port_torque_nm=port_nm, port_torque_std_nm=np.full(22, 5e-5))
    assert "up to 0.20\u00a0mN·m." in " ".join(source_sentences(source, "N·m"))
