"""What the benchmark counts and prints, and that the load which it makes ends with it."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.rehearsals import HEAD, RIGS, Rehearsal, busy, finished, kept, line, summary
from tests.processes import children, process_lives

DONE = Rehearsal("sim-odrive", 0, 100.0, 0.4, 17.0, 0.002, "stood still for 2 ms at most", 1.0, 0.1, "")
STOPPED = replace(DONE, exit_code=5, said="torque sensor: silent for 151.0 ms")


def test_what_was_finished_is_counted_by_rig() -> None:
    runs = [DONE, STOPPED, DONE, DONE, replace(STOPPED, rig="sim-mit")]
    assert finished(runs) == {"sim-odrive": 0.75, "sim-mit": 0.0}
    assert list(summary(runs)) == [
        "sim-odrive: 3 of 4 finished",
        "sim-mit: 0 of 1 finished",
        "2: torque sensor: silent for 151.0 ms",
    ]


def test_a_line_says_how_it_ended_and_why() -> None:
    assert line(STOPPED).endswith("2 ms at most; torque sensor: silent for 151.0 ms")
    assert " exit 5 " in line(STOPPED)
    assert line(DONE).index("finished") == HEAD.index("ended")
    assert line(DONE).index("0.40, 17.0") == HEAD.index("late")


def test_every_rig_is_there() -> None:
    assert all(rig.is_file() for rig in RIGS)


@pytest.mark.skipif(os.name != "posix", reason="reads /proc")
def test_the_load_ends() -> None:
    before = set(children(os.getpid()))
    with busy(2):
        loads = set(children(os.getpid())) - before
        assert len(loads) == 2
    assert not any(process_lives(pid) for pid in loads)


def test_a_folder_that_is_named_stays(tmp_path: Path) -> None:
    with kept(tmp_path / "out", "sim-odrive-0") as folder:
        (folder / "said.txt").write_text("something")
    with kept(None, "sim-odrive-0") as passing:
        pass
    assert (folder / "said.txt").is_file()
    assert not passing.exists()
