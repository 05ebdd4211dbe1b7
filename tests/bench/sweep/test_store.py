"""Results on disk: read back as they were, whatever happened to the file, and never mixed with another sweep's."""

from math import isnan, nan

import pytest

from norton_bench.errors import UsageError
from norton_bench.models.parameters import Estimate, Status
from norton_bench.sweep.run import RESULTS, Store
from norton_bench.sweep.task import TaskResult, summary

ABOUT = {"kind": "simulations", "rig": "abc"}


def outcome(name, value=5e-5, std=1e-7, **more):
    unknown = Estimate("torque_constant", nan, nan, "N*m/A", Status.UNEXCITED)
    inertia = Estimate("inertia", value, std, "kg*m^2", Status.VALID)
    return TaskResult(name, (inertia, unknown), converged=True, true={"inertia": 5e-5}, took_s=1.5, **more)


def test_what_was_put_is_there_again(tmp_path):
    store = Store.opened(tmp_path, ABOUT)
    store.put(outcome("seed 1"))
    store.put(TaskResult("seed 2", failure="the bus was lost"))
    store.close()
    again = Store.opened(tmp_path, ABOUT).done
    assert list(again) == ["seed 1"]  # what failed is to be tried again
    inertia, unknown = again["seed 1"].estimates
    assert inertia == outcome("seed 1").estimates[0]
    assert isnan(unknown.value)
    assert unknown.status is Status.UNEXCITED
    assert again["seed 1"].true == {"inertia": 5e-5}


def test_a_line_cut_off_is_left_and_the_next_one_stands_on_its_own(tmp_path):
    store = Store.opened(tmp_path, ABOUT)
    store.put(outcome("seed 1"))
    store.put(outcome("seed 2"))
    store.close()
    path = tmp_path / RESULTS
    path.write_bytes(path.read_bytes()[:-40])
    store = Store.opened(tmp_path, ABOUT)
    assert list(store.done) == ["seed 1"]
    store.put(outcome("seed 3"))
    store.close()
    assert list(Store.opened(tmp_path, ABOUT).done) == ["seed 1", "seed 3"]


def test_another_sweep_is_not_added_to(tmp_path):
    Store.opened(tmp_path, ABOUT).close()
    with pytest.raises(UsageError, match="holds a sweep with another rig; choose another folder"):
        Store.opened(tmp_path, {**ABOUT, "rig": "def"})


def test_a_file_that_is_no_sweep_is_said_to_be_none(tmp_path):
    (tmp_path / "sweep.json").write_text("{")
    with pytest.raises(UsageError, match="is not what a sweep has written"):
        Store.opened(tmp_path, ABOUT)


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be used"):
        Store.opened(tmp_path / "file" / "folder", ABOUT)


def test_the_summary_has_spread_errors_and_what_the_intervals_hold():
    outcomes = [outcome("1", 5.01e-5), outcome("2", 4.99e-5), outcome("3", 5.001e-5), TaskResult("4", failure="no")]
    (inertia,) = summary(outcomes)
    assert (inertia.name, inertia.runs, inertia.median) == ("inertia", 3, 5.001e-5)
    assert inertia.spread == pytest.approx(1.003e-7, rel=0.01)
    assert inertia.rms_error == pytest.approx(8.18e-8, rel=0.01)
    assert inertia.within == 1.0
    assert summary([outcome("1", 5.1e-5)])[0].within == 0.0


def test_without_truth_there_are_no_errors():
    nothing_true = [TaskResult(str(k), (Estimate("inertia", 5e-5, 1e-7, "kg*m^2", Status.VALID),)) for k in range(3)]
    (inertia,) = summary(nothing_true)
    assert isnan(inertia.rms_error)
    assert isnan(inertia.within)
