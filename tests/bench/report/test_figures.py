"""What the pictures are made from, and what they draw."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.identification.results import Trace
from norton_bench.report.figures_fit import close_up
from norton_bench.report.figures_network import drawn_samples, presliding_loops, sliding_samples, source_map_figure
from norton_bench.report.svg import envelope, style, thinned
from norton_bench.result import Result


def test_small_loops_are_cut_out_by_their_segments(full: Result) -> None:
    loops = presliding_loops(full.measured, full.fit.trace, deflection_rad=2e-3)
    assert [round(1e3 * np.ptp(loop.position_rad), 1) for loop in loops] == [10.0, 3.0, 1.0]
    assert all(abs(loop.position_rad.max() + loop.position_rad.min()) < 1e-12 for loop in loops)
    assert all(len(loop.measured_nm) == 1000 for loop in loops)


def test_no_line_joins_what_lies_beside_a_gap(full: Result) -> None:
    """Samples that were left out of the fit are not bridged by a straight line."""
    trace = full.fit.trace
    whole = presliding_loops(full.measured, trace, deflection_rad=2e-3)[0]
    segment = next(each for each in full.measured.segments if each.name == "loop 5 mrad")
    begin_s = (segment.start_ns - int(full.measured.ticks["tick_ns"][0])) * 1e-9
    missing = (trace.time_s > begin_s + 0.4) & (trace.time_s < begin_s + 0.6)
    gap = Trace(trace.time_s, np.where(missing, np.nan, trace.measured), trace.predicted, trace.unit)
    loop = presliding_loops(full.measured, gap, deflection_rad=2e-3)[0]
    assert not np.isnan(whole.measured_nm).any()
    (place,) = np.flatnonzero(np.isnan(loop.measured_nm))
    assert np.isnan(loop.predicted_nm[place])
    assert np.isfinite(loop.position_rad).all()
    assert place in drawn_samples(loop)


def test_loops_that_mostly_slide_are_left_out(full: Result) -> None:
    assert len(presliding_loops(full.measured, full.fit.trace, deflection_rad=2e-4)) == 1


def test_only_steady_velocities_stand_for_the_viscous_branch(full: Result) -> None:
    sliding = sliding_samples(full.measured, full.fit.trace)
    asked = np.array([0.0, 6.0, -6.0, 24.0, -24.0, 48.0, -48.0])
    off = np.min(np.abs(sliding.velocity_rad_s[:, None] - asked), axis=1)
    assert np.mean(off < 0.1) > 0.98
    assert {float(v) for v in np.round(sliding.velocity_rad_s) if v in asked} == set(asked.tolist())


def test_no_grid_gives_no_cloud(full: Result) -> None:
    assert sliding_samples(replace(full.measured, segments=()), full.fit.trace) is None


def test_the_close_up_is_where_most_happens() -> None:
    values = np.zeros(5000)
    values[3000:3400] = 1.0
    chosen = close_up(Trace(np.arange(5000.0), values, values, "N*m"))
    assert chosen[0] <= 3000
    assert chosen[-1] >= 3399


def test_the_source_is_drawn_with_its_corners(full: Result) -> None:
    with style():
        axes, _ = source_map_figure(full.source_map, full.network, "N*m").axes
    line = axes.get_lines()[0]
    command, velocity = line.get_data()
    low, high = full.network.thresholds
    assert {low, high} <= set(command)
    np.testing.assert_allclose(velocity[(command >= low) & (command <= high)], 0.0, atol=1e-9)
    np.testing.assert_allclose(velocity[-1], (0.9 * 0.08 - 0.02) / 1e-3)


@given(st.integers(0, 30_000), st.integers(4, 3000), st.integers(0, 2**32 - 1))
def test_no_spike_is_lost_and_time_runs_forward(count: int, points: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, time_s = rng.normal(size=count), np.arange(count) * 1e-3
    few_s, few = envelope(time_s, values, points)
    assert len(few) <= points
    assert (np.diff(few_s) > 0).all()
    assert np.isin(few, values).all()
    if count:
        assert (few.min(), few.max()) == (values.min(), values.max())


def test_a_gap_stays_a_gap() -> None:
    values = np.sin(np.arange(10_000.0))
    values[4000:6000] = np.nan
    time_s, few = envelope(np.arange(10_000.0), values, 500)
    inside = (time_s > 4100) & (time_s < 5900)
    assert inside.any()
    assert np.isnan(few[inside]).all()
    assert not np.isnan(few[~inside & ((time_s < 3900) | (time_s > 6100))]).any()


@given(st.integers(0, 10_000), st.integers(1, 500))
def test_a_cloud_is_thinned_to_both_ends(count: int, points: int) -> None:
    chosen = thinned(count, points)
    assert len(chosen) <= points
    assert len(set(chosen.tolist())) == len(chosen)
    if count > 1 and points > 1:
        assert (chosen[0], chosen[-1]) == (0, count - 1)
