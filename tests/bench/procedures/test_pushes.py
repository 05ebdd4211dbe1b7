"""Pushes off a path: as far as the path is long, and no faster or harder than is allowed."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from norton_bench.identification.assembly import Trial
from norton_bench.procedures.pushes import best_of, push_nm
from norton_bench.procedures.waves import multisine
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from tests.bench.linear_assembly import DURATION_S, LOAD, SOURCE_RAD, STIFFNESS_NM_RAD, TICK_S, TICKS, moved, trial

REST_S, GREATEST_NM = 0.3, 1.0
RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-arm.toml")


def rig(velocity_rad_s: float) -> Rig:
    return replace(
        RIG,
        wiring=replace(RIG.wiring, tick_ns=round(TICK_S * 1e9)),
        limits=replace(RIG.limits, velocity_rad_s=velocity_rad_s),
    )


@lru_cache
def trials() -> tuple[Trial, ...]:
    waves = [multisine(DURATION_S, TICK_S, low_hz=0.5, high_hz=8.0, seed=seed) for seed in (5, 6)]
    return tuple(trial(push_nm, lambda _: STIFFNESS_NM_RAD) for push_nm in (np.zeros(TICKS), *0.02 * np.array(waves)))


def test_the_deflection_is_a_tenth_of_the_way() -> None:
    push = push_nm(LOAD, trials(), (), GREATEST_NM, REST_S, rig(100.0))
    with_push, _ = moved(push, lambda _: STIFFNESS_NM_RAD, 1.2e-3)
    without, _ = moved(np.zeros(TICKS), lambda _: STIFFNESS_NM_RAD, 1.2e-3)
    assert np.max(np.abs(with_push - without)) == pytest.approx(0.1 * np.ptp(SOURCE_RAD), rel=0.15)
    assert not push[: round(REST_S / TICK_S)].any()
    assert abs(push[-1]) < 1e-12


def test_each_push_is_another_one() -> None:
    first, second = (push_nm(LOAD, trials(), pushed, GREATEST_NM, REST_S, rig(100.0)) for pushed in ((), trials()[:1]))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.5


def test_no_push_is_harder_than_the_drive_or_faster_than_the_rig_allows() -> None:
    weak = push_nm(LOAD, trials(), (), 0.01 + np.max(np.abs(best_of(trials()).load_torque_nm)), REST_S, rig(100.0))
    assert np.max(np.abs(weak)) == pytest.approx(0.01)
    path_rad = np.mean([each.seen.load_position_rad for each in trials()], axis=0)
    fastest_rad_s = float(np.max(np.abs(np.gradient(path_rad, TICK_S))))
    slow = push_nm(LOAD, trials(), (), GREATEST_NM, REST_S, rig((fastest_rad_s + 0.2) / 0.9))
    deflected = (
        moved(slow, lambda _: STIFFNESS_NM_RAD, 1.2e-3)[0] - moved(0 * slow, lambda _: STIFFNESS_NM_RAD, 1.2e-3)[0]
    )
    assert np.max(np.abs(np.gradient(deflected, TICK_S))) == pytest.approx(0.2, rel=0.15)


def test_where_nothing_is_left_nothing_is_pushed() -> None:
    assert not push_nm(LOAD, trials(), (), 0.0, REST_S, rig(100.0)).any()
    assert not push_nm(LOAD, trials(), (), GREATEST_NM, REST_S, rig(0.1)).any()


def test_the_best_trial_is_the_one_with_the_least_torque() -> None:
    assert best_of(trials()) is min(trials(), key=lambda each: np.std(each.torque_nm))
