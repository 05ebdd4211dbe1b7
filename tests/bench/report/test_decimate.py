import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.report.svg import envelope, thinned


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
