"""A joint that gives, with encoders at the motor and at the link: scipy's two masses give back their own values."""

from functools import cache
from math import sin, tanh
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.errors import UsageError
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import Columns, column_map, estimate, write_csv

RATIO, GAIN = 50.0, 2.0
TRUE = {"inertia": 0.4, "viscous_damping": 1.5, "coulomb_torque": 3.0, "link_stiffness": 900.0, "link_damping": 1.2}
LINK_INERTIA, PULL = 0.25, 6.0
RATE_HZ, DURATION_S = 500.0, 20.0
COUNTS = 2**19
MAP = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "motor", unit = "rad", side = "motor" }
link_position = { name = "link", unit = "rad" }
command = { name = "i", unit = "A", side = "motor" }
[actuator]
gear_ratio = 50
[model]
candidates = ["coulomb-viscous", "stribeck"]
"""
SENSOR = MAP.replace("[actuator]", 'exertion = { name = "tau", unit = "N*m" }\n[actuator]')
GAINED = MAP.replace("[actuator]", '[actuator]\ntorque_gain = "0.04 N*m/A"')
LOADED = f'{MAP}[load]\ninertia = "{LINK_INERTIA} kg*m^2"\ngravity = "{PULL} N*m"\n'


@cache
def log(seed: int, *, locked: bool = False) -> Columns:
    """Driven by a sum of sines in a loop of the motor's position; friction turns round within 2 mrad/s."""
    rng = np.random.default_rng(seed)
    wave, reach, phase = (
        2 * np.pi * np.array([0.17, 0.53, 1.3, 2.9]),
        np.array([0.9, 0.4, 0.15, 0.04]),
        rng.uniform(0, 6, 4),
    )
    if locked:
        reach = 0.02 * reach

    waves = tuple(zip(reach.tolist(), wave.tolist(), phase.tolist(), strict=True))

    def current(goal: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 400.0 * (goal - q) - 12.0 * v

    def transmitted(q: np.ndarray, v: np.ndarray, q_link: np.ndarray, v_link: np.ndarray) -> np.ndarray:
        return TRUE["link_stiffness"] * (q - q_link) + TRUE["link_damping"] * (v - v_link)

    def slope(t: float, state: np.ndarray) -> list[float]:
        q, v, q_link, v_link = state.tolist()
        goal = sum(size * sin(rate * t + begin) for size, rate, begin in waves)
        friction = TRUE["viscous_damping"] * v + TRUE["coulomb_torque"] * tanh(v / 2e-3)
        torque = transmitted(q, v, q_link, v_link)
        motor = (GAIN * current(goal, q, v) - friction - torque) / TRUE["inertia"]
        link = 0.0 if locked else (torque - PULL * sin(q_link)) / LINK_INERTIA
        return [v, motor, v_link, link]

    t = np.arange(0.05, DURATION_S, 1 / RATE_HZ)
    done = solve_ivp(slope, (0.0, DURATION_S), np.zeros(4), "LSODA", t_eval=t, max_step=2e-3, rtol=1e-9, atol=1e-11)
    state, goal = done.y, reach @ np.sin(np.outer(wave, t) + phase[:, None])
    turn = 2 * np.pi / COUNTS
    return {
        "t": t - t[0],
        "motor": np.round(RATIO * state[0] / turn) * turn,
        "link": np.round(state[2] / turn) * turn,
        "i": current(goal, state[0], state[1]) + 0.02 * rng.standard_normal(t.size),
        "tau": transmitted(*state) + 0.02 * rng.standard_normal(t.size),
    }


@pytest.mark.parametrize("text", [SENSOR, GAINED, LOADED], ids=["sensor", "gain", "load"])
def test_the_joint_is_found_whatever_tells_the_torque(tmp_path: Path, text: str) -> None:
    fit = fit_logs(Request((write_csv(tmp_path / "log.csv", log(1)),), column_map(text), test="15: s"))
    assert fit.model == "coulomb-viscous"
    assert not fit.doubtful
    assert not fit.alarms
    for name, true in TRUE.items():
        found = estimate(fit, name)
        assert found.status is Status.VALID
        # What jumps between two samples of 2 ms leaves 0.05 % of the damping.
        assert abs(found.value - true) < max(4 * found.std, 2e-3 * true)
        assert found.std < 0.03 * true
    assert (text is GAINED) or any("A linear spring between motor and link leaves 0." in said for said in fit.verdict)


@pytest.mark.long
def test_a_locked_link_twists_its_joint(tmp_path: Path) -> None:
    held = log(1, locked=True)
    assert np.ptp(held["link"]) == 0.0
    fit = fit_logs(Request((write_csv(tmp_path / "log.csv", held),), column_map(SENSOR)))
    assert estimate(fit, "link_stiffness").value == pytest.approx(TRUE["link_stiffness"], rel=1e-3)
    # So little motion does not tell a late torque from damping.
    damping = estimate(fit, "link_damping")
    assert abs(damping.value - TRUE["link_damping"]) < 4 * damping.std


def test_what_is_fitted_of_the_weight_is_transmitted_too(tmp_path: Path) -> None:
    text = GAINED.replace("[model]", f'[load]\ninertia = "{LINK_INERTIA} kg*m^2"\n[model]\ngravity = true')
    fit = fit_logs(Request((write_csv(tmp_path / "log.csv", log(1)),), column_map(text)))
    assert estimate(fit, "gravity_sine").value == pytest.approx(PULL, rel=0.01)
    assert estimate(fit, "link_stiffness").value == pytest.approx(TRUE["link_stiffness"], rel=0.02)


@pytest.mark.long
def test_encoders_may_be_set_to_zero_anew_in_each_log(tmp_path: Path) -> None:
    logs = [log(seed) | {"link": log(seed)["link"] + zero} for seed, zero in ((1, 0.0), (2, 0.003))]
    paths = tuple(write_csv(tmp_path / f"{index}.csv", each) for index, each in enumerate(logs))
    fit = fit_logs(Request(paths, column_map(SENSOR)))
    assert estimate(fit, "link_stiffness").value == pytest.approx(TRUE["link_stiffness"], rel=2e-3)
    assert any("A linear spring between motor and link leaves 0." in said for said in fit.verdict)


def test_what_is_no_spring_has_no_stiffness(tmp_path: Path) -> None:
    columns = log(1)
    wrong = columns | {"link": columns["link"] + 0.05 * np.sin(2 * np.pi * 0.4 * columns["t"])}
    fit = fit_logs(Request((write_csv(tmp_path / "log.csv", wrong),), column_map(SENSOR)))
    assert estimate(fit, "link_stiffness").status is not Status.VALID


def test_a_spring_that_is_none_is_said(tmp_path: Path) -> None:
    """A third of the torque that the sensor measures comes from elsewhere."""
    columns = log(1)
    other = 1.5 * np.sin(2 * np.pi * 0.71 * columns["t"])
    fit = fit_logs(
        Request((write_csv(tmp_path / "log.csv", columns | {"tau": columns["tau"] + other}),), column_map(SENSOR))
    )
    (said,) = [said for said in fit.verdict if "A linear spring" in said]
    assert 15 < float(said.split("leaves ")[1].split("%")[0]) < 35


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"link", unit = "rad" }', '"link", unit = "rad", sign = -1 }', "link_position runs against position"),
        ("gear_ratio = 50", "gear_ratio = 60", "link_position moves 1.2 times as far as position"),
        ('name = "link"', 'name = "motor"', "link_position moves 50 times as far as position"),
    ],
)
def test_encoders_that_do_not_go_together_are_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    fit = fit_logs(Request((write_csv(tmp_path / "log.csv", log(1)),), column_map(GAINED.replace(old, new))))
    assert fit.doubtful
    assert any(said in each for each in fit.verdict)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('position = { name = "motor", unit = "rad", side = "motor" }', 'velocity = "motor"', "add the motor's as"),
        ("[model]", '[load]\ninertia = "1 kg*m^2"\n[model]\nrefine = "motion"', "is of a joint that does not give"),
    ],
)
def test_mistakes_are_told_with_their_mend(old: str, new: str, said: str) -> None:
    with pytest.raises(UsageError) as raised:
        column_map(MAP.replace(old, new, 1))
    assert said in str(raised.value)
