"""Records of procedures, mapped from nameless files: the same rows, and none of them in memory."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from norton_bench.procedures.knowledge import Knowledge
from norton_bench.records import MOTION, TICK, TORQUE, Measured, SegmentInfo, join
from norton_bench.rig.load import load_rig
from norton_bench.segments import Use
from norton_bench.session.run import with_last_on_disk

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
TICKS = 50_000


def record(ticks: int, seed: int = 1) -> Measured:
    rng = np.random.default_rng(seed)
    tables = {name: np.zeros(ticks, dtype) for name, dtype in (("ticks", TICK), ("motion", MOTION), ("torque", TORQUE))}
    for table in tables.values():
        table.view(np.uint8)[:] = rng.integers(0, 2, table.nbytes, dtype=np.uint8)
    return Measured(**tables, segments=(SegmentInfo(0, "free", "x", Use.IDENTIFY, "admittance", 0, 1),))


def test_the_rows_stay_the_same_and_leave_no_file(tmp_path: Path) -> None:
    first, second = record(1000), record(500, seed=2)
    known = with_last_on_disk(Knowledge(RIG, records=(first,)), tmp_path)
    known = with_last_on_disk(Knowledge(RIG, records=(*known.records, second)), tmp_path)
    for name in ("ticks", "motion", "load_motion", "torque", "current"):
        assert getattr(join(known.records), name).tobytes() == getattr(join((first, second)), name).tobytes()
        assert getattr(known.records[1], name).dtype == getattr(second, name).dtype
    assert known.records[1].segments == second.segments
    assert list(tmp_path.iterdir()) == []


def test_memory_is_given_back(tmp_path: Path) -> None:
    tracemalloc.start()
    try:
        known = Knowledge(RIG, records=(record(TICKS),))
        size = sum(table.nbytes for table in (known.records[0].ticks, known.records[0].motion, known.records[0].torque))
        assert tracemalloc.get_traced_memory()[0] > size
        known = with_last_on_disk(known, tmp_path)
        assert tracemalloc.get_traced_memory()[0] < 0.01 * size
    finally:
        tracemalloc.stop()
    assert len(known.records[0].ticks) == TICKS


@pytest.mark.parametrize("records", [(), (Measured(),)])
def test_nothing_to_keep_is_kept(tmp_path: Path, records: tuple[Measured, ...]) -> None:
    assert with_last_on_disk(Knowledge(RIG, records=records), tmp_path).records == records


def test_a_disk_without_room_leaves_it_in_memory(tmp_path: Path) -> None:
    kept = record(100)
    assert with_last_on_disk(Knowledge(RIG, records=(kept,)), tmp_path / "gone").records[0] is kept
