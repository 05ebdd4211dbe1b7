"""Braille, axes and whole plots, without a terminal."""

from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.screen import plots as braille
from norton_bench.screen.plots import (
    GUTTER,
    Drawer,
    Markers,
    PlotAxis,
    PlotFigure,
    PlotTrace,
    label,
    prefixed,
    settled,
    ticks,
)
from norton_bench.screen.styles import length

VIEW = braille.View(0.0, 7.0, 0.0, 7.0, 4, 2)  # 8 by 8 dots, a dot a unit
TIME_S = np.linspace(0.0, 10.0, 10_001)


def characters(*dots: braille.Dots) -> list[str]:
    codes, _ = braille.cells(list(dots))
    return ["".join(chr(braille.BLANK + int(code)) for code in row) for row in codes]


def figure(*traces: PlotTrace, markers: tuple[Markers, ...] = (), growing: bool = False) -> PlotFigure:
    return PlotFigure("Torque", PlotAxis("x", "s", 1.0), PlotAxis("y", "N*m", 1e-3), traces, markers, growing=growing)


def text(drawer: Drawer, shown: PlotFigure, width: int = 60, height: int = 12) -> list[str]:
    return ["".join(piece for piece, _ in row) for row in drawer.draw(shown, width, height)]


def test_each_dot_is_where_unicode_has_it() -> None:
    x, y = np.arange(8.0), np.full(8, 7.0)
    assert characters(braille.points(VIEW, x[:1], y[:1]))[0][0] == "⠁"
    assert characters(braille.points(VIEW, np.array([1.0]), np.array([4.0])))[0][0] == "⢀"
    assert characters(braille.line(VIEW, x, y)) == ["⠉⠉⠉⠉", "⠀⠀⠀⠀"]
    assert characters(braille.line(VIEW, np.array([0.0, 7.0]), np.array([0.0, 7.0]))) == ["⠀⠀⡠⠊", "⡠⠊⠀⠀"]


def test_traces_that_share_a_cell_are_both_there() -> None:
    """Joined dots, and the colour of whoever has most of them."""
    flat = braille.line(VIEW, np.array([0.0, 7.0]), np.array([7.0, 7.0]))
    steep = braille.line(VIEW, np.array([0.0, 0.0]), np.array([0.0, 7.0]))
    codes, owner = braille.cells([flat, steep])
    assert chr(braille.BLANK + int(codes[0, 0])) == "⡏"
    assert owner.tolist() == [[1, 0, 0, 0], [1, -1, -1, -1]]


def test_a_gap_stays_a_gap_and_a_line_out_of_sight_is_cut() -> None:
    gap = braille.line(VIEW, np.array([0.0, np.nan, 7.0]), np.array([7.0, np.nan, 7.0]))
    assert characters(gap)[0] == "⠁⠀⠀⠈"
    beyond = braille.line(VIEW, np.array([-1e9, 1e9]), np.array([7.0, 7.0]))
    assert beyond.shape == (8, 8)
    assert braille.line(VIEW, np.array([]), np.array([])).sum() == 0


def test_dashes_tell_a_second_trace_without_colour() -> None:
    wide = braille.View(0.0, 79.0, 0.0, 7.0, 40, 2)
    x, y = np.array([0.0, 79.0]), np.array([3.0, 3.0])
    whole, dashed = braille.line(wide, x, y), braille.line(wide, x, y, dashed=True)
    assert 0 < dashed.sum() < whole.sum()
    assert not (dashed & ~whole).any()


def test_no_spike_is_lost_in_ten_thousand_points() -> None:
    y = np.sin(TIME_S)
    y[5003] = 8.0
    x_few, y_few = braille.envelope(TIME_S, y, 100)
    assert len(x_few) <= 400
    assert y_few.max() == 8.0
    assert y_few.min() == pytest.approx(y.min())
    y[2000:4000] = np.nan
    assert np.isnan(braille.envelope(TIME_S, y, 100)[1]).sum() >= 60


def test_the_envelope_is_the_same_picture() -> None:
    """Drawn from a twentieth of its points, the curve has every dot where it was, or next to that."""
    rng = np.random.default_rng(3)
    y = np.cumsum(rng.normal(size=len(TIME_S)))
    view = braille.View(0.0, 10.0, float(y.min()), float(y.max()), 50, 12)
    whole = braille.line(view, TIME_S, y)
    few = braille.line(view, *braille.envelope(TIME_S, y, 100))
    assert not (whole & ~neighbours(few)).any()
    assert not (few & ~neighbours(whole)).any()


def neighbours(dots: braille.Dots) -> braille.Dots:
    """All dots that are at most one dot away from one of these."""
    padded = np.pad(dots, 1)
    height, width = dots.shape
    shifted = [padded[row : row + height, column : column + width] for row in range(3) for column in range(3)]
    return np.any(shifted, axis=0)


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e6), st.integers(1, 12))
def test_ticks_are_tidy_and_inside(low: float, span: float, most: int) -> None:
    places = ticks((low, low + span), most)
    assert len(places) <= most
    assert all(low - 1e-6 * span <= place <= low + span * (1 + 1e-6) for place in places)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=20), st.floats(1e-6, 1.0))
def test_a_range_holds_its_values_and_stands_still(values: list[float], least: float) -> None:
    shown = np.array(values)
    span = settled(None, shown, least)
    assert span[0] <= shown.min()
    assert shown.max() <= span[1]
    assert span[1] - span[0] >= least * (1 - 1e-9)
    assert settled(span, shown, least) == span


def test_a_range_grows_at_once_and_narrows_late() -> None:
    wide = settled(None, np.array([-10.0, 10.0]), 1.0)
    assert settled(wide, np.array([-6.0, 6.0]), 1.0) == wide
    assert settled(wide, np.array([-1.0, 1.0]), 1.0)[1] < 2.0
    assert settled(wide, np.array([-10.0, 30.0]), 1.0)[1] >= 30.0
    assert settled(wide, np.array([np.nan]), 1.0) == wide


def test_numbers_are_said_with_prefix_and_sign() -> None:
    assert prefixed(0.02, "N*m") == (1e3, "mN·m")
    assert prefixed(3.0, "N*m") == (1.0, "N·m")
    assert prefixed(2e-5, "rad") == (1e6, "µrad")
    assert label(-0.5, 0.25) == "−0.5"
    assert label(-0.0, 5.0) == "0"


@pytest.mark.parametrize(("width", "height"), [(36, 6), (44, 8), (60, 12), (120, 40), (9, 3), (3, 1)])
def test_a_plot_fills_its_place_and_no_more(width: int, height: int) -> None:
    y = 0.02 * np.sin(TIME_S)
    drawn = Drawer().draw(figure(PlotTrace(TIME_S, y), growing=True), width, height)
    assert len(drawn) <= max(height, 2)
    assert all(length(row) <= max(width, 0) for row in drawn)


def test_heading_has_the_unit_and_the_gutter_lines_up() -> None:
    rows = text(Drawer(), figure(PlotTrace(TIME_S, 0.02 * np.sin(TIME_S)), growing=True))
    assert rows[0].startswith("Torque mN·m ─")
    assert {row[GUTTER] for row in rows[1:-1]} <= {"│", "┤"}
    assert any(row[:GUTTER].strip() == "−20" for row in rows)
    assert rows[-1].endswith("s")


def test_markers_are_drawn_over_everything() -> None:
    marked = figure(PlotTrace(TIME_S, TIME_S), markers=(Markers(np.array([5.0]), np.array([5.0]), "▴"),))
    assert sum(row.count("▴") for row in text(Drawer(), marked)) == 1


def test_nothing_to_show_is_said() -> None:
    assert any("nothing measured yet" in row for row in text(Drawer(), figure()))
    unknown = np.full(5, np.nan)
    assert len(text(Drawer(), figure(PlotTrace(np.arange(5.0), unknown)))) == 12


def test_a_plot_is_cheap() -> None:
    """Three traces of two thousand points on 128 by 43 cells. Public widgets take 50 to 150 ms for it."""
    x = np.linspace(0.0, 10.0, 2000)
    shown = figure(*(PlotTrace(x, np.sin(x + k), k) for k in range(3)), growing=True)
    drawer = Drawer()
    drawer.draw(shown, 128, 43)
    begun = process_time()
    for _ in range(10):
        drawer.draw(shown, 128, 43)
    assert (process_time() - begun) / 10 < 0.03
