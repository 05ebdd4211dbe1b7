"""A segment unrolled as its steps are asked for has the segment's values."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.errors import RigError
from norton_bench.loop.segment_run import BACK, CHUNK, SegmentRun, Steps
from norton_bench.sample import Target
from norton_bench.segments import PRESCRIBED_MOTION, LoadMode, Segment, Use

TICKS = 3 * CHUNK + 7
BASE_RAD = 0.7
VALUES = np.random.default_rng(1).normal(size=(6, TICKS))
MOVED = Segment(
    "test", "moved", Use.PREPARE, VALUES[0], LoadMode.ADMITTANCE, PRESCRIBED_MOTION, *VALUES[1:4], modulation=VALUES[5]
)
PUSHED = Segment("test", "pushed", Use.PREPARE, VALUES[0], LoadMode.TORQUE, load_torque_nm=VALUES[4])


@pytest.mark.parametrize("ahead", [0, 5, BACK - 1, CHUNK])
def test_every_step_is_that_of_the_segment(ahead: int) -> None:
    steps = Steps(MOVED, BASE_RAD)
    for tick in range(TICKS):
        for index in (tick, min(tick + ahead, TICKS - 1)):
            step, at = steps.at(index), VALUES[:, index]
            assert (step.command, step.modulation, step.load_torque_nm) == (at[0], at[5], 0.0)
            assert step.target == Target(BASE_RAD + at[1], at[2], at[3])
    assert type(steps.at(0).command) is float
    assert steps.at(TICKS + 50) == steps.at(TICKS - 1)


def test_a_torque_has_no_reference_and_a_reference_may_be_missing() -> None:
    step = Steps(PUSHED, BASE_RAD).at(3)
    assert (step.load_torque_nm, step.modulation, step.target) == (VALUES[4][3], 0.0, Target())
    empty = np.empty(0)
    still = replace(MOVED, position_rad=empty, velocity_rad_s=empty, acceleration_rad_s2=empty)
    assert Steps(still, BASE_RAD).at(3).target == Target(BASE_RAD)


def test_who_looks_a_little_ahead_makes_each_chunk_be_unrolled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, unroll = list[int](), Steps._unroll
    monkeypatch.setattr(Steps, "_unroll", lambda self, index: (begun.append(index), unroll(self, index))[1])
    steps = Steps(PUSHED, BASE_RAD)
    for index in range(TICKS - 5):
        assert steps.at(index + 5).command == VALUES[0][index + 5]
        assert steps.at(index).command == VALUES[0][index]
    assert len(begun) == len(set(begun)) == 4


def test_missed_ticks_are_skipped_but_for_the_last() -> None:
    run = SegmentRun(PUSHED, None, BASE_RAD)
    run.skip(10)
    assert run.index == 10
    run.skip(TICKS)
    assert run.index == run.ticks - 1 == TICKS - 1
    assert run.end_rad is None


def test_an_imposed_motion_needs_a_calibrated_load() -> None:
    with pytest.raises(RigError, match="needs a calibrated load drive; run the step 'calibrate' before it"):
        SegmentRun(MOVED, None, BASE_RAD)
