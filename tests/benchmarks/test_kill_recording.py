"""What the benchmark calls lost and wrong."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.kill_recording import Kill, lost_ms, summary, wrong_frames, wrong_rows
from norton_bench.recording import wire
from norton_bench.records import TICK, Measured
from norton_drivers.readings import RawFrame

MS = 1_000_000


def heard(ticks: int) -> list[tuple[int, int, bytes]]:
    """Two commands a millisecond."""
    return [(tick * MS + 100, node << 5 | 0x0E, bytes([tick])) for tick in range(ticks) for node in (1, 2)]


def kept(ticks: int) -> tuple[RawFrame, ...]:
    return tuple(RawFrame(stamp_ns, "can0", True, data, node) for stamp_ns, node, data in heard(ticks))


def test_lost_is_what_was_commanded_after_the_last_tick_kept() -> None:
    assert lost_ms(heard(100), kept_ns=59 * MS, killed_ns=100 * MS) == 40.0
    assert lost_ms(heard(100), kept_ns=59 * MS, killed_ns=80 * MS) == 20.0
    assert lost_ms(heard(60), kept_ns=59 * MS, killed_ns=10_000 * MS) == 0.0


def test_a_frame_that_nobody_heard_is_wrong() -> None:
    frames = kept(50)
    assert wrong_frames(frames, heard(80)) == 0
    assert wrong_frames((*frames, frames[-1]._replace(data=b"\xff")), heard(80)) == 1
    received = frames[-1]._replace(data=b"\xff", sent=False)
    assert wrong_frames((*frames, received), heard(80)) == 0


def test_a_row_that_the_witness_has_otherwise_is_wrong(tmp_path: Path) -> None:
    ticks = np.zeros(100, TICK)
    ticks["tick_ns"] = np.arange(100)
    with (tmp_path / "witness").open("wb") as file:
        for first in (0, 50):
            wire.send(file, wire.part_of(Measured(ticks=ticks[first : first + 50])))
        file.write((1000).to_bytes(8, "little") + b"half a message")
    assert wrong_rows(Measured(ticks=ticks[:70]), tmp_path / "witness") == 0
    damaged = ticks[:70].copy()
    damaged["torque_nm"][[3, 60]] += 1e-9
    assert wrong_rows(Measured(ticks=damaged), tmp_path / "witness") == 2


@pytest.mark.parametrize(
    ("lost", "wrong", "recovered", "held"),
    [(140, 0, True, True), (151, 0, True, False), (1, 1, True, False), (1, 0, False, False)],
)
def test_the_verdict_needs_all_three(lost: float, wrong: int, recovered: bool, held: bool) -> None:
    good = Kill("program", 10.0, 100, 0, 0, True, 0.0)
    other = Kill("recorder", lost, 100, wrong, 0, recovered, 100.0)
    assert summary([good, other], 0)["held"] is held
