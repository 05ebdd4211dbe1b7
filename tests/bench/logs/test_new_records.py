"""What is fitted holds on a record that the fit has not touched, or it is said why not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli.app import main
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.results import LogFit
from norton_bench.logs.slow import drift_columns
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import FREE, Columns, Machine, column_map, estimate, fit_of, write_csv

pytestmark = pytest.mark.long

TRUE = Machine(duration_s=12.0)
OTHER = replace(TRUE, seed=2, phases=(2.0, 0.1, 0.7))


def two_files(folder: Path, first: Columns, second: Columns, text: str = FREE, **options: str) -> LogFit:
    """The first trained on, the second only predicted."""
    paths = (write_csv(folder / "train.csv", first), write_csv(folder / "test.csv", second))
    return fit_logs(Request(paths, column_map(text), test="test.csv", **options))


def test_drift_keeps_its_last_value_outside_the_training(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, TRUE.log(), FREE + 'drift = "2 s"\n', train="3:8 s")
    assert fit.test.exertion is not None
    assert fit.train.exertion is not None
    assert fit.test.exertion.rms < 1.5 * fit.train.exertion.rms
    assert not fit.alarms


def test_every_log_has_an_offset_of_its_own_and_one_not_trained_on_the_last() -> None:
    time_s = np.arange(100) / 10
    trained = np.ones(100, dtype=bool)
    columns = drift_columns(["a", "b", "c"], [time_s] * 3, [trained, trained & (time_s < 5), ~trained], 4.95)
    assert list(columns) == ["offset_1", "offset_2", "offset_3", "offset_4", "offset_5"]
    line = -np.array([1.0, 2.0, 3.0, 10.0, 20.0]) @ np.stack(list(columns.values()))
    assert line[0] == pytest.approx(1.0)
    assert line[99] == pytest.approx(3.0)
    assert line[100] == pytest.approx(10.0)
    np.testing.assert_allclose(line[150:], 20.0)


def test_drift_before_the_first_training_is_its_first_value() -> None:
    time_s = np.arange(100) / 10
    columns = drift_columns(["a", "b"], [time_s] * 2, [np.zeros(100, dtype=bool), time_s > 3], 100.0)
    assert [-column[0] for column in columns.values()] == [1.0]
    assert [-column[110] for column in columns.values()] == [1.0]


@pytest.mark.parametrize(
    "text", [FREE, FREE.replace('candidates = ["coulomb-viscous"]', 'candidates = ["dahl", "stribeck"]')]
)
def test_what_is_only_predicted_changes_nothing(tmp_path: Path, text: str) -> None:
    """However fast, finely sampled, or wrong it is."""
    alone = fit_of(tmp_path, TRUE.log(), text, model="best")
    wild = {name: 7 * values for name, values in replace(TRUE, rate_hz=1000.0).log().items()}
    wild["t"] = wild["t"] / 7
    beside = two_files(tmp_path, TRUE.log(), wild, text, model="best")
    assert beside.model == alone.model
    assert beside.estimates == alone.estimates
    assert [step.held_out_relative for step in beside.ladder] == [step.held_out_relative for step in alone.ladder]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        (lambda log: log | {"u": log["u"] + 1.0}, "the zero of a sensor or a constant load differs"),
        (lambda log: log | {"u": 1.5 * log["u"]}, "everything is 1.5 times as large as predicted"),
        (lambda log: log | {"u": log["u"] + np.sin(40 * log["t"])}, "no single cause shows"),
        (lambda _: replace(OTHER, inertia=0.06).log(), "with inertia 0.06 kg*m^2 in place of 0.05"),
        (lambda _: replace(OTHER, damping=0.36).log(), "with viscous damping 0.36"),
    ],
)
def test_a_test_that_errs_far_more_than_promised_is_an_alarm_with_the_reason(
    tmp_path: Path, changed: object, reason: str
) -> None:
    fit = two_files(tmp_path, TRUE.log(), changed(OTHER.log()))  # type: ignore[operator]
    (alarm,) = fit.alarms
    assert reason in alarm
    assert alarm in fit.verdict


def test_a_test_of_the_same_machine_is_no_alarm(tmp_path: Path) -> None:
    assert not two_files(tmp_path, TRUE.log(), OTHER.log()).alarms


def test_only_what_a_gain_would_scale_is_a_ratio_to_it(tmp_path: Path) -> None:
    text = FREE.replace('[actuator]\ntorque_gain = "2 N*m/A"\n', "")
    fit = fit_of(tmp_path, TRUE.log(), text)
    (said,) = [each for each in fit.verdict if "only up to a common factor" in each]
    assert "inertia / torque gain = 0.025" in said
    assert "shift" not in said
    assert estimate(fit, "command_shift").status is not Status.RATIO_ONLY


def test_a_motion_that_is_not_foretold_is_said(tmp_path: Path) -> None:
    """An axis that nothing holds runs away under a constant that is not there."""
    log = TRUE.log()
    assert not any("simulated motion" in said for said in fit_of(tmp_path, log).verdict)
    other = log | {"u": log["u"] + 0.1 * np.sin(2 * np.pi * 0.02 * log["t"])}
    fit = fit_of(tmp_path, other)
    assert fit.train.motion is not None
    assert fit.train.motion.relative > 0.5
    assert any("of its spread: where nothing holds a position" in said for said in fit.verdict)


def test_an_alarm_is_exit_code_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = write_csv(tmp_path / "train.csv", TRUE.log())
    second = write_csv(tmp_path / "test.csv", OTHER.log() | {"u": OTHER.log()["u"] + 1.0})
    (tmp_path / "map.toml").write_text(FREE)
    options = ["--columns", str(tmp_path / "map.toml"), "--json"]
    assert main(["fit", str(first), "--test", str(second), *options]) == 1
    assert '"alarms": [\n' in capsys.readouterr().out


@pytest.mark.parametrize("model", ["coulomb-viscous-asymmetric", "stribeck-asymmetric"])
def test_a_constant_load_is_no_negative_friction(tmp_path: Path, model: str) -> None:
    heavy = replace(TRUE, offset=5.0)
    fit = fit_of(tmp_path, heavy.log(), FREE, model=model)
    assert all(each.value >= 0 for each in fit.estimates if "torque" in each.name or "damping" in each.name)
    assert estimate(fit, "offset").value == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("model", ["coulomb-viscous", "stribeck-asymmetric", "film", "dahl", "maxwell-slip"])
def test_total_friction_is_told_whatever_the_model(tmp_path: Path, model: str) -> None:
    fit = fit_of(tmp_path, TRUE.log(), FREE, model=model)
    total = {each.name: each for each in fit.totals}
    for name, true in (("total_coulomb", TRUE.coulomb), ("total_viscous", TRUE.damping)):
        assert total[name].value == pytest.approx(true, rel=0.05)
        assert abs(total[name].value - true) < 4 * total[name].std + 2e-3
    assert total["total_coulomb"].status is Status.VALID


STIFFNESS, STRENGTH = 200.0, 2.0
CONTACT = """
[log]
motion = "translation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "x", unit = "m" }
exertion = { name = "f", unit = "N" }
[model]
friction = "best"
inertia = false
"""


def contact_log(seed: int, share: float, drop: int = 0) -> Columns:
    """A contact (Dahl's) that begins under tension, moved to and fro by little more than it deflects."""
    rng = np.random.default_rng(seed)
    t = np.arange(2000) / 200
    x = 0.02 * np.sin(2 * np.pi * 0.35 * t + rng.uniform(0, 6)) + 0.01 * np.sin(2 * np.pi * 0.13 * t)
    force = np.empty(t.size)
    force[0] = share * STRENGTH
    fine = 20
    for k in range(1, t.size):
        step = (x[k] - x[k - 1]) / fine
        now = force[k - 1]
        for _ in range(fine):
            now += STIFFNESS * (step - abs(step) * now / STRENGTH)
        force[k] = now
    return {"t": t, "x": x, "f": -force + 0.01 * rng.standard_normal(t.size)}


def test_contacts_may_begin_under_any_tension(tmp_path: Path) -> None:
    fit = two_files(tmp_path, contact_log(41, 0.0), contact_log(42, -0.95), CONTACT)
    assert fit.model == "dahl"
    assert fit.test.exertion is not None
    assert fit.test.exertion.relative < 0.02
    assert not fit.alarms
    # Laws of velocity alone cannot foretell this, and are no candidates.
    assert {step.model for step in fit.ladder} >= {"dahl", "maxwell-slip"}
    assert "coulomb-viscous" not in {step.model for step in fit.ladder}
    assert any("laws of velocity alone leave" in said for said in fit.verdict)


def test_no_model_fails_on_a_new_record(tmp_path: Path) -> None:
    """Elements that the way was too short to turn over have no strength, however many there are."""
    for name in ("maxwell-slip", "maxwell-slip-asymmetric", "elasto-plastic-asymmetric"):
        text = CONTACT.replace('"best"', f'"{name}"\ncandidates = ["{name}"]')
        fit = two_files(tmp_path, contact_log(43, 0.5), contact_log(44, 0.9), text)
        assert fit.test.exertion is not None
        assert fit.test.exertion.relative < 0.10


def test_logs_of_one_machine_that_differ_widen_its_intervals(tmp_path: Path) -> None:
    def both(inertia: float) -> LogFit:
        logs = [replace(TRUE, seed=seed, inertia=value).log() for seed, value in ((1, 0.05), (2, inertia))]
        paths = tuple(write_csv(tmp_path / f"{index}.csv", log) for index, log in enumerate(logs))
        return fit_logs(Request(paths, column_map(FREE)))

    alike, apart = both(0.05), both(0.055)
    assert alike.between is not None
    assert any("0.csv, 1.csv) agree" in said for said in alike.verdict)
    assert any("inertia 0.05" in said and "intervals are widened" in said for said in apart.verdict)
    assert estimate(alike, "inertia").std < 1e-4
    assert estimate(apart, "inertia").std > 0.5 * 0.005 / np.sqrt(2)


def test_a_log_of_another_machine_is_named(tmp_path: Path) -> None:
    """Together they ask for a delay that none of them has."""
    others = {3: {"inertia": 0.06, "coulomb": 1.1}}
    logs = [replace(TRUE, seed=seed, phases=(seed, 1.1, 2.0), **others.get(seed, {})).log() for seed in range(1, 5)]
    paths = tuple(write_csv(tmp_path / f"{index}.csv", log) for index, log in enumerate(logs, start=1))
    fit = fit_logs(Request(paths, column_map(FREE)))
    assert any("Leave 3.csv out, or fit it apart" in said for said in fit.verdict)
    assert fit.between is not None
    for one in fit.between.each:
        assert one.odd == ("3.csv" if one.name in ("inertia", "coulomb_torque") else "")
        if one.name == "command_shift":
            assert np.all(np.abs(one.values) < 4 * one.stds)
    delay = estimate(fit, "command_shift")
    assert abs(delay.value) < 4 * delay.std or delay.status is Status.INADEQUATE


def test_the_quarters_of_one_record_are_compared(tmp_path: Path) -> None:
    # Each of five values differs by chance with a probability of 5 %: in 4 of 20 seeds one does (3, 6, 8 and 12).
    log = replace(TRUE, seed=1).log()
    _, v, _ = TRUE.motion(log["t"])
    steady = fit_of(tmp_path, log)
    assert any("Quarters of the record agree" in said for said in steady.verdict)
    warming = fit_of(tmp_path, log | {"u": log["u"] - 0.01 * v * (log["t"] - 6)})
    assert any("Quarters of the record differ" in said and "viscous damping" in said for said in warming.verdict)
    assert not any("drift" in said for said in warming.verdict)
    drifting = fit_of(tmp_path, log | {"u": log["u"] + 0.02 * log["t"]})
    assert any('try [model] drift = "30 s"' in said for said in drifting.verdict)
    mended = fit_of(tmp_path, log | {"u": log["u"] + 0.02 * log["t"]}, FREE + 'drift = "30 s"\n')
    assert estimate(mended, "inertia").value == pytest.approx(TRUE.inertia, rel=0.01)
    assert estimate(warming, "viscous_damping").std > 5 * estimate(steady, "viscous_damping").std
