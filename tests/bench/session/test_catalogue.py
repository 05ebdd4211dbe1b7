"""Earlier runs, by the files that they left."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.models.network import CONDITIONS, DEVIATION, STATUS, NortonNetwork
from norton_bench.models.parameters import Status
from norton_bench.session.catalogue import Run, _line, compare, run_of, runs_in, trend_of

BEGAN = datetime(2026, 1, 1, tzinfo=UTC)
TRUE = {
    "torque_gain": 0.9,
    "amplifier_bandwidth": 600.0,
    "inertia": 5e-5,
    "viscous_damping": 1e-3,
    "coulomb_torque": 0.02,
    "presliding_stiffness": 10.0,
    "presliding_damping": 0.01,
}
STD = 0.01  # of each value


def left_by_a_run(
    folder: Path, days: float = 0.0, rig: str = "dyno", unit: str = "N*m", told: str = "", **values: float
) -> Path:
    """A recording's place with the network file beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    recording = folder / f"{rig}.mcap"
    recording.touch()
    network = NortonNetwork.of_parameters(
        {**TRUE, **values},
        unit,
        covariance_names=tuple(TRUE),
        covariance=tuple(map(tuple, np.diag([(STD * value) ** 2 for value in TRUE.values()]).tolist())),
        provenance={
            "rig": rig,
            "session": "the standard session",
            "started": (BEGAN + timedelta(days=days)).isoformat(),
            STATUS: "presliding_damping=inadequate",
            CONDITIONS: told,
            DEVIATION: "torque_constant=1e-05; amplifier_gain=0.002",
        },
    )
    network.save(recording.with_suffix(".network.json"))
    return recording


def test_runs_are_listed_by_their_time_with_what_they_found(tmp_path: Path) -> None:
    left_by_a_run(tmp_path / "b", days=3.0)
    left_by_a_run(tmp_path / "a" / "deeper", days=5.0, rig="other")
    left_by_a_run(tmp_path / "c")
    found = runs_in(tmp_path)
    assert [run.recording.parent.name for run in found] == ["c", "b", "deeper"]
    assert [run.rig for run in found] == ["dyno", "dyno", "other"]
    assert found[0].ending == "6 valid, 1 inadequate"
    assert found[0].estimates["presliding_damping"].status is Status.INADEQUATE
    assert found[0].estimates["coulomb_torque"].std == pytest.approx(STD * TRUE["coulomb_torque"])


def test_what_cannot_be_read_is_listed_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "empty.mcap").touch()
    (run,) = runs_in(tmp_path)
    assert "empty" in run.ending
    assert run.started is None
    with pytest.raises(UsageError, match="no such folder"):
        runs_in(tmp_path / "elsewhere")
    (tmp_path / "second.mcap").touch()
    with pytest.raises(UsageError, match="holds 2 recordings"):
        run_of(tmp_path)


def test_parameters_drawn_from_others_and_the_conditions_are_told_by_the_network_file(tmp_path: Path) -> None:
    told = "impedance form=holds; unique zero=does not hold; stable zero dynamics=cannot be told"
    whole = run_of(left_by_a_run(tmp_path / "1", torque_constant=0.05, amplifier_gain=18.0, told=told))
    assert whole.ending == "8 valid, 1 inadequate; unique zero does not hold, stable zero dynamics cannot be told"
    assert whole.estimates["torque_constant"].std == 1e-5
    assert whole.conditions["impedance form"] == "holds"
    held = run_of(left_by_a_run(tmp_path / "2", told="impedance form=holds; unique zero=holds"))
    assert held.ending == "6 valid, 1 inadequate; conditions hold"


def test_what_is_in_another_unit_is_left_out_and_named(tmp_path: Path) -> None:
    of_torque = run_of(left_by_a_run(tmp_path / "1"))
    of_current = run_of(left_by_a_run(tmp_path / "2", unit="A", coulomb_torque=0.022))
    found = compare(of_torque, of_current)
    assert [(one.name, one.unit, other.unit) for one, other in found.left_out] == [
        ("torque_gain", "N*m/(N*m)", "N*m/(A)")
    ]
    assert [each.first.name for each in found.differences] == [name for name in TRUE if name != "torque_gain"]
    assert [each.first.name for each in found.differences if each.shows] == ["coulomb_torque"]
    only_gains = [
        replace(run, estimates={"torque_gain": run.estimates["torque_gain"]}) for run in (of_torque, of_current)
    ]
    with pytest.raises(UsageError, match="have torque_gain, each in two units"):
        compare(*only_gains)


def test_several_rigs_have_no_trend(tmp_path: Path) -> None:
    for number, rig in enumerate(("dyno", "dyno", "other")):
        left_by_a_run(tmp_path / str(number), days=number, rig=rig)
    with pytest.raises(UsageError, match="coulomb_torque: was identified on dyno, other; choose one with --rig"):
        trend_of("coulomb_torque", runs_in(tmp_path))


def test_two_runs_differ_where_chance_does_not_explain_it(tmp_path: Path) -> None:
    first = run_of(left_by_a_run(tmp_path / "1"))
    second = run_of(left_by_a_run(tmp_path / "2", coulomb_torque=0.022, inertia=5.05e-5).parent)
    found = {difference.first.name: difference for difference in compare(first, second).differences}
    assert [name for name, difference in found.items() if difference.shows] == ["coulomb_torque"]
    assert found["coulomb_torque"].value == pytest.approx(0.002)
    assert found["coulomb_torque"].std == pytest.approx(np.sqrt(2) * STD * 0.02)


def test_nothing_differs_by_chance_more_often_than_said(tmp_path: Path) -> None:
    """Of 400 pairs that differ by noise alone 5 % show something; 33 is the 99.7 % quantile of that binomial."""
    rng = np.random.default_rng(1)
    base = run_of(left_by_a_run(tmp_path / "1"))

    def drawn() -> Run:
        moved = {
            name: type(each)(name, each.value + each.std * rng.standard_normal(), each.std, each.unit, each.status)
            for name, each in base.estimates.items()
        }
        return Run(base.recording, base.rig, base.session, base.started, base.ending, moved)

    alarms = sum(any(difference.shows for difference in compare(drawn(), drawn()).differences) for _ in range(400))
    assert 5 <= alarms <= 33


def test_a_trend_over_months(tmp_path: Path) -> None:
    for month in range(6):
        left_by_a_run(tmp_path / str(month), days=30.0 * month, coulomb_torque=0.02 + 0.001 * month)
    found = trend_of("coulomb_torque", runs_in(tmp_path))
    assert found.slope_per_month == pytest.approx(0.001, rel=1e-6)
    assert found.combined.p < 1e-6
    same = trend_of("inertia", runs_in(tmp_path))
    assert same.slope_per_month is not None
    assert same.slope_std is not None
    assert abs(same.slope_per_month) < same.slope_std


def test_a_slopes_interval_holds_it_as_often_as_it_says() -> None:
    """Runs that also differ from each other by three times their own error. 1000 draws: 95 % ± 2 % at three sigma."""
    rng = np.random.default_rng(2)
    times, stds, held = np.arange(6.0), np.full(6, 0.1), 0
    for _ in range(1000):
        slope, std = _line(times, 2.0 + 0.3 * times + rng.normal(0.0, 0.1 * np.sqrt(10.0), 6), stds)
        held += abs(slope - 0.3) < 1.96 * std
    assert 930 <= held <= 970


def test_what_gives_no_trend(tmp_path: Path) -> None:
    left_by_a_run(tmp_path / "1")
    with pytest.raises(UsageError, match="needs two runs"):
        trend_of("inertia", runs_in(tmp_path))
    left_by_a_run(tmp_path / "2")
    assert trend_of("inertia", runs_in(tmp_path)).slope_per_month is None
