"""What the benchmark counts and prints, and that the load which it makes ends with it."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.rehearsals import HEAD, RIGS, Rehearsal, Values, busy, finished, kept, line, summary
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


def test_values_are_held_against_the_true_ones() -> None:
    parameters = {
        "inertia": {"value": 5.1e-5, "std": 1e-6, "status": "valid"},
        "torque_gain": {"value": 0.9, "std": 1e-3, "status": "valid"},
        "coulomb_torque": {"value": 0.02, "std": 1e-4, "status": "inadequate"},
    }
    words = "The model is inadequate: something is missing."
    result = json.dumps({"parameters": parameters, "verdict": [words, "7 readings left out."]})
    true = {"inertia": (5e-5, "kg*m^2"), "torque_gain": (0.91, "N*m/(N*m)"), "coulomb_torque": (0.02, "N*m")}
    values = Values.of(result, true)
    assert values == Values(stated=3, valid=2, held=1, inadequate=(words,))
    first, second = line(replace(DONE, values=values)).split("\n")
    assert first.index("2/3, 1") == HEAD.index("valid, held")
    assert second.strip() == words
    assert Values.of("", true) == Values()


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
