"""What the benchmark calls growth and drift, and a short soak of its own."""

import numpy as np
import pytest

from benchmarks.soak import RIG, growth_mb, pace_ppm, session_of, soak
from norton_bench.procedures.options import RestOptions
from norton_bench.rig.load import load_rig
from norton_bench.session.schema import Step


def test_growth_is_what_comes_after_the_warm_up() -> None:
    warm = [(k * 10_000, 100.0 + (k if k < 20 else 20), 30.0 + 0.1 * k) for k in range(1, 101)]
    assert growth_mb(warm, 1)["growth_mb"] == pytest.approx(0.0, abs=0.1)
    assert growth_mb(warm, 2)["growth_mb_per_million_ticks"] == pytest.approx(10.0)


def test_pace_is_the_difference_of_two_clocks() -> None:
    stamps = np.arange(1000) * 1_000_000
    assert pace_ppm(stamps, np.round(stamps * 7.5e-6).astype(int)) == pytest.approx(7.5, abs=0.01)


@pytest.mark.parametrize("ticks", [100_000, 1_000_000])
def test_a_session_is_planned_for_at_least_the_ticks_asked(ticks: int) -> None:
    rig = load_rig(RIG)
    session = session_of(rig, ticks)
    assert [step.do for step in session.steps[:4]] == ["tare", "calibrate", "free", "imposed"]
    assert 18 < ticks * rig.tick_s / (len(session.steps) / 2) < 60


@pytest.mark.long
def test_a_short_soak_reads_what_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.soak.TURN", (Step("rest", RestOptions(duration_s=20.0)),))
    found = soak(20_000, looks=2)
    assert [look["readable"] for look in found["looks"]] == [look["ticks"] for look in found["looks"]]
    assert found["lost_ticks"] == found["clocks"]["ticks_off_the_grid"] == 0
    assert found["clocks"]["sensor_clock_ppm"] == pytest.approx([7.5, 7.5], abs=0.2)
