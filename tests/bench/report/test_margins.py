"""Nothing that stands beside a panel leaves the figure, or runs into the next panel."""

from collections.abc import Callable
from itertools import combinations

import pytest
from matplotlib.figure import Figure

from norton_bench.report.figures_fit import (
    impedance_table_figure,
    live_figure,
    residual_figure,
    residual_tests_figure,
    timing_figure,
    validation_figure,
)
from norton_bench.report.figures_network import (
    bench_time_s,
    blocked_figure,
    impedance_figure,
    legend,
    presliding_loops,
    sliding_samples,
    source_map_figure,
)
from norton_bench.report.figures_tables import source_motion_figure, trials_figure
from norton_bench.report.svg import figure, style
from norton_bench.result import Result

FIGURES: dict[str, Callable[[Result], Figure]] = {
    "source map": lambda data: source_map_figure(data.source_map, data.network, "N*m"),
    "blocked": lambda data: blocked_figure(data.blocked_map, data.network, "N*m"),
    "impedance": lambda data: impedance_figure(
        presliding_loops(data.measured, data.fit.trace, 2e-3), sliding_samples(data.measured, data.fit.trace)
    ),
    "validation": lambda data: validation_figure(data.validation.torque, "torque"),
    "table": lambda data: impedance_table_figure(data.without_model.table, data.network, "N*m"),
    "residual": lambda data: residual_figure(data.fit.trace),
    "residual tests": lambda data: residual_tests_figure(data.residuals),
    "live": lambda data: live_figure(
        data.live, bench_time_s(data.measured, [each.stamp_ns for each in data.live]), data.fit
    ),
    "timing": lambda data: timing_figure(data.measured.ticks),
    "trials": lambda data: trials_figure(data.trials),
    "source motion": lambda data: source_motion_figure(data.in_situ.source, "N*m"),
}


def boxes(picture: Figure) -> list[tuple[float, float, float, float]]:
    """Left, bottom, right and top of every panel with all that belongs to it, in inches."""
    picture.draw_without_rendering()
    panels = [axes for axes in picture.axes if axes.get_visible()]
    scale = picture.dpi_scale_trans.inverted()
    return [axes.get_tightbbox().transformed(scale).extents for axes in panels]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_holds_its_panels_apart(name: str, full: Result) -> None:
    with style():
        picture = FIGURES[name](full)
        found = boxes(picture)
    width, height = picture.get_size_inches()
    assert found
    for left, bottom, right, top in found:
        assert left > 0
        assert bottom > 0
        assert right < width
        assert top < height
    for one, other in combinations(found, 2):
        beside = one[2] < other[0] or other[2] < one[0]
        assert beside or one[3] < other[1] or other[3] < one[1]


def test_a_legend_above_has_room_for_all_of_its_lines() -> None:
    tops = []
    with style():
        for entries in (1, 4, 9):
            picture = figure(3.0)
            axes = picture.subplots()
            for k in range(entries):
                axes.plot([0, 1], label=f"line {k}")
            legend(axes)
            ((_, _, _, top),) = boxes(picture)
            assert top < 3.0
            tops.append(axes.get_position().y1)
    assert tops[0] == tops[1]
    assert tops[1] - tops[2] > 0.08
