"""What is true of a machine is found in its log, whichever columns the log has."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.arrays import FloatArray
from norton_bench.errors import BenchError, UsageError
from norton_bench.logs.fit import Request, fit_logs, parse_selection
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import FREE, LOADED, Columns, Machine, column_map, estimate, fit_of, write_csv

TRUE = Machine(duration_s=10.0)
VELOCITY = FREE.replace('position = { name = "q", unit = "rad" }', 'velocity = { name = "w", unit = "rad/s" }')


def near(fit: object, **truth: float) -> None:
    """Every estimate is valid and within four of its deviations, and these are small."""
    for name, true in truth.items():
        found = estimate(fit, name)  # type: ignore[arg-type]
        assert found.status is Status.VALID, found
        assert abs(found.value - true) < 4 * found.std + 1e-3 * abs(true), found
        assert found.std < 0.05 * abs(true), found


ALL = {"inertia": TRUE.inertia, "viscous_damping": TRUE.damping, "coulomb_torque": TRUE.coulomb, "offset": TRUE.offset}


@pytest.mark.parametrize("text", [FREE, VELOCITY], ids=["position", "velocity"])
def test_known_gain_and_a_free_port(tmp_path: Path, text: str) -> None:
    fit = fit_of(tmp_path, TRUE.log(), text)
    near(fit, **ALL)
    assert fit.converged
    assert not fit.doubtful
    assert any("its scale is that of the torque gain given" in said for said in fit.verdict)
    assert fit.train.exertion is not None
    needed = float(np.sqrt(np.mean(TRUE.needed(TRUE.log()["t"]) ** 2)))
    assert fit.train.exertion.relative < 0.05
    assert fit.train.exertion.rms == pytest.approx(fit.train.exertion.relative * needed, rel=0.05)


def test_a_sensor_at_the_port_gives_the_gain_too(tmp_path: Path) -> None:
    near(fit_of(tmp_path, TRUE.log(), LOADED), torque_gain=TRUE.gain, **ALL)


@pytest.mark.parametrize("text", [FREE, LOADED], ids=["free", "loaded"])
def test_what_is_predicted_lies_nearer_to_the_truth_than_what_was_logged(tmp_path: Path, text: str) -> None:
    noisy = replace(TRUE, noise=0.05, coulomb=1e-6)
    trace = fit_of(tmp_path, noisy.log(), text).exertion
    quiet = replace(noisy, noise=0.0).log()
    true = np.interp(trace.time_s, quiet["t"], quiet["tau"] if text is LOADED else noisy.gain * quiet["u"])
    inside = slice(20, -20)
    off = [np.std(values[inside] - true[inside]) for values in (trace.predicted, trace.measured)]
    assert off[0] < 0.8 * off[1]


def test_a_sensor_and_a_gain_that_is_known(tmp_path: Path) -> None:
    near(fit_of(tmp_path, TRUE.log(), LOADED + '[actuator]\ntorque_gain = "2 N*m/A"\n'), **ALL)


def test_friction_only(tmp_path: Path) -> None:
    """No command: what the port needs is what brakes, turned round."""
    text = LOADED.replace('command = { name = "u2", unit = "A" }\n', "")
    log = TRUE.log()
    near(fit_of(tmp_path, log | {"tau": log["tau"] - TRUE.gain * log["u2"]}, text), **ALL)


def test_a_known_load_fixes_the_scale_without_any_sensor(tmp_path: Path) -> None:
    """A pendulum at the port: its inertia and gravity are known, the motor's own are not."""
    log = TRUE.log()
    q, _, a = TRUE.motion(log["t"])
    log["u"] = log["u"] + (0.2 * a + 1.5 * np.sin(q - 0.1)) / TRUE.gain
    text = FREE.replace('torque_gain = "2 N*m/A"', "")
    text += '[load]\ninertia = "0.2 kg*m^2"\ngravity = "1.5 N*m"\ngravity_zero = "0.1 rad"\n'
    near(fit_of(tmp_path, log, text), torque_gain=TRUE.gain, **ALL)


def coarse(seed: int, held_s: float) -> Columns:
    """Angles of 0.01°, and a command that acts ``held_s`` later than its row says."""
    rng, count = np.random.default_rng(seed), np.deg2rad(0.01)
    machine = replace(TRUE, seed=seed, phases=tuple(rng.uniform(0.0, 6.0, 3)))
    log = machine.log()
    later = machine.needed(log["t"] + held_s) / machine.gain
    q = machine.motion(log["t"])[0]
    return log | {"q": np.round(q / count) * count, "u": later + 0.02 * rng.standard_normal(later.size)}


def test_counts_and_half_a_sample_of_delay_are_within_the_intervals(tmp_path: Path) -> None:
    """Of 30 intervals at least 26 hold: by chance alone fewer would once in 64 times (binomial, 95 % each)."""
    off = []
    for seed in range(1, 11):
        fit = fit_of(tmp_path, coarse(seed, 1e-3))
        for name in ("inertia", "viscous_damping", "coulomb_torque"):
            found = estimate(fit, name)
            off.append((found.value - ALL[name]) / found.std)
    assert np.count_nonzero(np.abs(off) < 1.96) >= 26
    assert np.sqrt(np.mean(np.square(off))) < 1.4


def test_a_delay_of_nothing_that_the_map_gives_is_not_sought(tmp_path: Path) -> None:
    names = [each.name for each in fit_of(tmp_path, TRUE.log()).estimates]
    given = [
        each.name for each in fit_of(tmp_path, TRUE.log(), FREE.replace('"A" }', '"A", shift = "0 ms" }')).estimates
    ]
    assert "command_shift" in names
    assert "command_shift" not in given


@pytest.mark.long
def test_a_forgotten_pendulum_is_a_poor_fit_and_no_failure(tmp_path: Path) -> None:
    log = TRUE.log()
    q, _, _ = TRUE.motion(log["t"])
    log["u"] = log["u"] + 9.0 * np.sin(q) / TRUE.gain
    fit = fit_of(tmp_path, log, FREE.replace('["coulomb-viscous"]', "[]"), model="elasto-plastic")
    assert fit.model == "elasto-plastic"
    assert np.isfinite(fit.totals[0].std)


@pytest.mark.long
def test_counts_that_are_in_the_known_load_as_well_are_within_the_intervals(tmp_path: Path) -> None:
    """The load takes twice what the machine does, computed from the same counted angle."""
    off, turn = [], 2 * np.pi / 2**13
    text = FREE.replace('torque_gain = "2 N*m/A"', "") + '[load]\ninertia = "0.02 kg*m^2"\ngravity = "1.5 N*m"\n'
    for seed in range(1, 7):
        phases = tuple(np.random.default_rng(seed).uniform(0.0, 6.0, 3))
        machine = replace(TRUE, inertia=0.01, seed=seed, phases=phases)
        log = machine.log()
        q, _, a = machine.motion(log["t"])
        log |= {"u": log["u"] + (0.02 * a + 1.5 * np.sin(q)) / machine.gain, "q": np.round(q / turn) * turn}
        found = estimate(fit_of(tmp_path, log, text), "inertia")
        off.append((found.value - 0.01) / found.std)
    assert np.max(np.abs(off)) < 4.0
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_gravity_that_is_not_known_is_found(tmp_path: Path) -> None:
    log = TRUE.log()
    q, _, _ = TRUE.motion(log["t"])
    log["u"] = log["u"] + 1.5 * np.sin(q) / TRUE.gain
    near(fit_of(tmp_path, log, FREE + "gravity = true\n"), gravity_sine=1.5, **ALL)


def test_gravity_of_several_bodies_is_a_fourier_series(tmp_path: Path) -> None:
    log = TRUE.log()
    q, _, _ = TRUE.motion(log["t"])
    log["u"] = log["u"] + (1.5 * np.sin(q) - 0.6 * np.cos(2 * q)) / TRUE.gain
    fit = fit_of(tmp_path, log, FREE + "gravity = 2\n")
    near(fit, gravity_sine=1.5, gravity_cosine_2=-0.6, **ALL)
    assert fit.train.motion is None  # one pendulum does not pull like that
    assert abs(estimate(fit, "gravity_sine_2").value) < 0.02
    assert estimate(fit, "gravity_sine_2").status is Status.VALID


def test_cogging_is_an_additive_option(tmp_path: Path) -> None:
    log = TRUE.log()
    q, _, _ = TRUE.motion(log["t"])
    log["u"] = log["u"] + 0.2 * np.cos(2 * np.pi * q / 0.5) / TRUE.gain
    near(fit_of(tmp_path, log, FREE + 'cogging_period = "0.5 rad"\n'), cogging_cosine=0.2, **ALL)


def test_friction_may_change_with_the_temperature(tmp_path: Path) -> None:
    log = TRUE.log()
    _, v, _ = TRUE.motion(log["t"])
    log["temp"] = 20.0 + 2.0 * log["t"]
    thinned = -0.004 * v * (log["temp"] - np.mean(log["temp"]))
    log["u"] = log["u"] + thinned / TRUE.gain
    text = (
        FREE.replace("[actuator]", 'temperature = { name = "temp", unit = "degC" }\n[actuator]')
        + "temperature = true\n"
    )
    fit = fit_of(tmp_path, log, text)
    near(fit, viscous_damping_per_degree=-0.004, **ALL)
    assert estimate(fit, "viscous_damping_per_degree").unit == "N*m*s/rad/K"
    assert estimate(fit, "coulomb_torque_per_degree").unit == "N*m/K"


def test_without_any_scale_only_ratios_are_known(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, TRUE.log(), FREE.replace('torque_gain = "2 N*m/A"', ""))
    for name in ("torque_gain", *ALL):
        found = estimate(fit, name)
        assert found.status is Status.RATIO_ONLY
        assert np.isnan(found.value)
    (said,) = [said for said in fit.verdict if "common factor" in said]
    assert f"coulomb torque / torque gain = {TRUE.coulomb / TRUE.gain:.2g}" in said.replace("0.399", "0.4")
    assert fit.train.exertion is None


def test_translation_has_other_units(tmp_path: Path) -> None:
    text = FREE.replace("rotation", "translation").replace('"rad"', '"m"').replace("N*m/A", "N/A")
    fit = fit_of(tmp_path, TRUE.log(), text)
    near(fit, **ALL)
    assert [each.unit for each in fit.estimates] == ["kg", "N", "s", "N*s/m", "N"]


def test_a_voltage_driven_motor_brakes_itself(tmp_path: Path) -> None:
    """With its resistance known, the back-EMF's part Km²/R of the damping is taken out."""
    resistance, constant = 0.05, 0.1
    log = TRUE.log()
    log["u"] = log["u"] + constant**2 / resistance * TRUE.motion(log["t"])[1] / TRUE.gain
    text = FREE.replace('unit = "A"', 'unit = "V"').replace("N*m/A", "N*m/V")
    whole = fit_of(tmp_path, log, text.replace("[actuator]", "[actuator]\nvoltage_driven = true"))
    near(whole, **(ALL | {"viscous_damping": TRUE.damping + constant**2 / resistance}))
    assert any("holds the back-EMF's" in said for said in whole.verdict)
    parted = text.replace("[actuator]", '[actuator]\nvoltage_driven = true\nresistance = "0.05 ohm"')
    fit = fit_of(tmp_path, log, parted)
    near(fit, torque_constant=constant, **ALL)
    assert [each.value for each in fit.totals] == pytest.approx([TRUE.coulomb, TRUE.damping], rel=0.02)


def test_an_uneven_clock(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    time_s = np.sort(np.arange(5000) / 500 + rng.uniform(-4e-4, 4e-4, 5000))
    near(fit_of(tmp_path, TRUE.log(time_s)), **ALL)


def later(log: Columns, name: str, delay_s: float, machine: Machine = TRUE) -> Columns:
    """The log with one column as it was so long before each row."""
    return log | {name: machine.log(log["t"] - delay_s)[name]}


@pytest.mark.parametrize("delay_ms", [-0.7, 0.9, 20.0])
def test_a_command_logged_late_or_early_is_found_within_a_sample(tmp_path: Path, delay_ms: float) -> None:
    """At 2 ms a sample. It is no friction, and no inertia."""
    fit = fit_of(tmp_path, later(TRUE.log(), "u", 1e-3 * delay_ms))
    near(fit, **ALL)
    found = estimate(fit, "command_shift")
    assert abs(found.value + 1e-3 * delay_ms) < 4 * found.std
    assert found.std < 3e-4
    assert not fit.doubtful
    assert any("command is logged" in said and "is reckoned with" in said for said in fit.verdict) is (delay_ms == 20.0)


def test_two_columns_may_be_late_by_different_times(tmp_path: Path) -> None:
    log = TRUE.log()
    delayed = TRUE.log(log["t"] - 0.01)
    torque = TRUE.gain * np.interp(log["t"] - 0.01, log["t"], log["u2"]) - TRUE.needed(log["t"] - 0.01)
    noise = TRUE.noise * np.random.default_rng(5).standard_normal(log["t"].size)
    assert delayed["tau"].shape == torque.shape
    shifted = log | {"u2": np.interp(log["t"] - 0.003, log["t"], log["u2"]), "tau": torque + noise}
    fit = fit_of(tmp_path, shifted, LOADED)
    near(fit, torque_gain=TRUE.gain, **ALL)
    for name, true_s in (("command_shift", -0.003), ("exertion_shift", -0.01)):
        assert estimate(fit, name).value == pytest.approx(true_s, abs=3e-4)


def test_a_delay_that_the_map_gives_is_not_sought(tmp_path: Path) -> None:
    log = TRUE.log()
    log["u"] = np.roll(log["u"], 10)
    log = {name: values[10:] for name, values in log.items()}
    fit = fit_of(tmp_path, log, FREE.replace('unit = "A" }', 'unit = "A", shift = "-20 ms" }'))
    near(fit, **ALL)
    assert "command_shift" not in {each.name for each in fit.estimates}
    unsought = fit_of(tmp_path, log, FREE + "delays = false\n")
    assert {each.status for each in unsought.estimates} == {Status.DOUBTFUL}
    assert any("later than the motion" in said for said in unsought.verdict)


@pytest.mark.parametrize("rate_hz", [100.0, 250.0, 2000.0])
def test_the_sampling_rate_does_not_matter(tmp_path: Path, rate_hz: float) -> None:
    near(fit_of(tmp_path, replace(TRUE, rate_hz=rate_hz).log()), **ALL)


def test_what_the_data_cannot_tell_apart_is_said(tmp_path: Path) -> None:
    """One small sine: the acceleration is the position turned round, so gravity and the inertia are one."""
    t = np.arange(5000) / 500
    wave = 2 * np.pi * 0.5
    q = 0.05 * np.sin(wave * t)
    log = {"t": t, "q": q, "u": (0.05 * -(wave**2) * q + 0.3 * q + 0.02 * np.sign(np.cos(wave * t))) / 2}
    log["u"] += 1e-2 * np.random.default_rng(3).standard_normal(t.size)
    fit = fit_of(tmp_path, log, FREE + "gravity = true\n")
    assert any("Known only" in said and "inertia" in said and "gravity sine" in said for said in fit.verdict)


def test_train_and_test_by_time(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, TRUE.log(), train="0:4 s, 6:7.5 s", test="7.5:10 s")
    near(fit, **ALL)
    assert fit.test.exertion is not None
    assert fit.test.exertion.relative == pytest.approx(TRUE.noise * TRUE.gain / 1.0, abs=0.05)
    assert fit_of(tmp_path, TRUE.log()).test.exertion is None


@pytest.mark.long
def test_train_and_test_by_file(tmp_path: Path) -> None:
    other = replace(TRUE, inertia=0.1)
    paths = [write_csv(tmp_path / f"{name}.csv", one.log()) for name, one in (("a1", TRUE), ("a2", TRUE), ("b", other))]
    request = Request(tuple(paths), column_map(FREE), test="b*")
    fit = fit_logs(request)
    near(fit, **ALL)
    assert fit.test.exertion is not None
    assert fit.train.exertion is not None
    assert fit.test.exertion.rms > 3 * fit.train.exertion.rms
    # The map's own split holds, unless it is about other logs.
    named = column_map(FREE + '[split]\ntest = "b*"\ntrain = "a*"\n')
    assert fit_logs(replace(request, column_map=named, test=None)).test == fit.test
    others = column_map(FREE + '[split]\ntest = "d*"\ntrain = "c*"\n')
    assert fit_logs(replace(request, paths=(paths[0],), column_map=others, test=None)).test.exertion is None
    # A file that is only named in --test is read too.
    again = fit_logs(replace(request, paths=tuple(paths[:2]), test=str(paths[2])))
    assert again.test == fit.test


@pytest.mark.parametrize(
    ("train", "said"),
    [
        ("5:3 s", '--train: "5:3 s" ends before it begins'),
        ("0:3 m", "--train:"),
        ("nowhere.csv", 'no log is named "nowhere.csv"'),
        (" ", "--train: is empty"),
        ("30:40 s", "0 rows are left to learn from"),
        ("0:3, x", 'no log is named "x"'),
        ("log.csv 5:3 s", '"log.csv 5:3 s" ends before it begins'),
    ],
)
def test_splits_that_cannot_be_are_said(tmp_path: Path, train: str, said: str) -> None:
    with pytest.raises(BenchError) as raised:
        fit_of(tmp_path, TRUE.log(), train=train)
    assert said in str(raised.value)


@pytest.mark.long
def test_every_file_may_have_windows_of_its_own(tmp_path: Path) -> None:
    paths = [write_csv(tmp_path / f"{name}.csv", TRUE.log()) for name in ("a1", "a2", "b")]
    request = Request(tuple(paths), column_map(FREE), train="a* 0:4 s, b.csv 2:4 s, b.csv 5:6 s", test="b.csv 7: s")
    times = {path.name: np.arange(0.05, 10.0, 0.1) for path in paths}
    assert request.train is not None
    chosen = parse_selection(request.train, "--train")
    assert [int(chosen.of(path, times[path.name]).sum()) for path in paths] == [40, 40, 30]
    fit = fit_logs(request)
    near(fit, **ALL)
    assert fit.test.exertion is not None


@pytest.mark.long
def test_the_ladder_lists_every_model_and_the_best_is_the_true_one(tmp_path: Path) -> None:
    text = FREE.replace('candidates = ["coulomb-viscous"]', 'candidates = ["coulomb-viscous", "stribeck", "dahl"]')
    fit = fit_of(tmp_path, TRUE.log(), text.replace('friction = "coulomb-viscous"', 'friction = "best"'))
    assert [step.model for step in fit.ladder] == ["coulomb-viscous", "stribeck", "dahl"]
    assert [step.model for step in fit.ladder if step.selected] == [fit.model] == ["coulomb-viscous"]
    assert fit_of(tmp_path, TRUE.log(), text, model="dahl").model == "dahl"
    with pytest.raises(UsageError, match='there is no friction model "dahlia"; did you mean "dahl"'):
        fit_of(tmp_path, TRUE.log(), text, model="dahlia")


def test_a_maps_split_counts_where_its_logs_are_at_hand(tmp_path: Path) -> None:
    split = '[split]\ntrain = "low*.csv"\ntest = "high*.csv"\n'
    log = TRUE.log()
    low, high, other = (write_csv(tmp_path / f"{name}.csv", log) for name in ("low1", "high1", "other"))
    both = fit_logs(Request((low, high), column_map(FREE + split)))
    assert both.test.exertion is not None
    alone = fit_logs(Request((other,), column_map(FREE + split)))
    assert alone.train.exertion is not None
    assert alone.test.exertion is None


@pytest.mark.long
def test_a_measured_torque_does_not_explain_itself_as_friction_by_load(tmp_path: Path) -> None:
    """Without a command all of it is taken by the machine: a friction in proportion to it would be any friction."""
    text = LOADED.replace('command = { name = "u2", unit = "A" }', "").replace('candidates = ["coulomb-viscous"]', "")
    log = TRUE.log()
    fit = fit_of(tmp_path, log | {"tau": -TRUE.gain * log["u"]}, text.replace('"coulomb-viscous"', '"best"'))
    assert "load-dependent" not in {step.model for step in fit.ladder}
    near(fit, **ALL)
    assert {each.name: each for each in fit.totals}["total_coulomb"].value == pytest.approx(TRUE.coulomb, rel=0.01)


CARRIED = 0.03  # kg·m², by the actuator's port, and nothing else


def carrying(**changes: FloatArray | float) -> Columns:
    """A log of an actuator that drives an inertia behind a torque sensor."""
    log = TRUE.log()
    torque = CARRIED * TRUE.motion(log["t"])[2]
    noise = 0.005 * np.random.default_rng(3).standard_normal(log["t"].size)
    return log | {"u2": log["u"] + torque / TRUE.gain, "tau": torque + noise}


GIVEN = LOADED.replace("[model]", '[actuator]\ntorque_gain = "2 N*m/A"\n[model]')


def test_an_inertia_alone_at_the_port_leaves_a_given_gain_in_peace(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, carrying(), GIVEN)
    assert not fit.doubtful, fit.verdict
    near(fit, **ALL)


def test_an_inertia_alone_at_the_port_tells_no_gain(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, carrying(), LOADED)
    assert any("follows from the motion alone, as that of an inertia of 0.03 kg*m^2" in said for said in fit.verdict)
    assert not any("swapped" in said or "turn the sign" in said for said in fit.verdict)
    assert {each.status for each in fit.estimates} == {Status.DOUBTFUL}


@pytest.mark.parametrize(
    ("name", "factor", "said"),
    [
        ("u2", -1.0, "turn the sign of command in"),
        ("tau", -1.0, "turn the sign of exertion in"),
        ("tau", 5.0, "turning no sign mends it; check the units and scales of exertion"),
    ],
)
def test_of_several_columns_the_wrong_one_is_named(tmp_path: Path, name: str, factor: float, said: str) -> None:
    log = carrying()
    fit = fit_of(tmp_path, log | {name: factor * log[name]}, GIVEN)
    assert any(said in sentence for sentence in fit.verdict), fit.verdict
    assert not any("swapped" in sentence for sentence in fit.verdict)


def test_a_law_that_the_record_leaves_open_is_named_with_its_size(tmp_path: Path) -> None:
    """A Stribeck effect of a thirtieth of the friction: surely there if the law is right, and no better held out."""
    log = replace(TRUE, noise=0.1, duration_s=20.0).log()
    velocity = TRUE.motion(log["t"])[1]
    falls = 0.03 * np.exp(-np.abs(velocity / 0.6)) * np.sign(velocity) / TRUE.gain
    text = FREE.replace('candidates = ["coulomb-viscous"]', 'candidates = ["coulomb-viscous", "stribeck"]')
    fit = fit_of(tmp_path, log | {"u": log["u"] + falls}, text.replace('= "coulomb-viscous"', '= "best"'))
    assert fit.model == "coulomb-viscous"
    assert any("stribeck would have stribeck torque" in said and "is open" in said for said in fit.verdict), fit.verdict


def test_windows_that_overlap_are_said_to(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, TRUE.log(), train="0:6 s", test="4:10 s")
    assert any("--train and --test overlap" in said for said in fit.verdict)
    assert not any("overlap" in said for said in fit_of(tmp_path, TRUE.log(), train="0:4 s", test="4:10 s").verdict)
