"""What was logged at the motor's side of a gear gives the values of the joint; loads of known mass or current."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.logs.log import read_log
from tests.bench.logs.machines import FREE, LOADED, Machine, column_map, estimate, fit_of, write_csv

MACHINE = Machine(duration_s=10.0, rate_hz=200.0)
RATIO = 50.0
MOTOR = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "q", unit = "rad", side = "motor" }
command = { name = "u", unit = "A", side = "motor" }
[actuator]
torque_gain = "0.04 N*m/A"
gear_ratio = 50
[model]
candidates = ["coulomb-viscous"]
"""


@pytest.mark.parametrize("sign", [1, -1])
def test_a_motors_position_and_current_give_the_joint(tmp_path: Path, sign: int) -> None:
    columns = MACHINE.log()
    columns["q"] = sign * RATIO * columns["q"]
    columns["u"] = sign * columns["u"]
    fit = fit_of(tmp_path, columns, MOTOR.replace("50", str(sign * 50)))
    assert estimate(fit, "inertia").value == pytest.approx(MACHINE.inertia, rel=0.02)
    assert estimate(fit, "viscous_damping").value == pytest.approx(MACHINE.damping, rel=0.03)
    assert estimate(fit, "coulomb_torque").value == pytest.approx(MACHINE.coulomb, rel=0.02)


def test_gears_that_turn_the_other_way_turn_a_gain_that_is_fitted(tmp_path: Path) -> None:
    """The motor's position and current agree with each other; the sensor is at the joint."""
    columns = MACHINE.log()
    columns["q"], columns["u2"] = -RATIO * columns["q"], -columns["u2"]
    text = LOADED.replace('"q", unit = "rad"', '"q", unit = "rad", side = "motor"')
    text = text.replace('"u2", unit = "A"', '"u2", unit = "A", side = "motor"')
    fit = fit_of(tmp_path, columns, text.replace("[model]", "[actuator]\ngear_ratio = -50\n[model]"))
    assert not fit.doubtful
    assert estimate(fit, "torque_gain").value == pytest.approx(-MACHINE.gain, rel=0.01)
    assert estimate(fit, "inertia").value == pytest.approx(MACHINE.inertia, rel=0.02)


def test_a_current_at_the_motor_with_a_position_at_the_joint(tmp_path: Path) -> None:
    log = read_log(
        write_csv(tmp_path / "log.csv", MACHINE.log()),
        column_map(MOTOR.replace('unit = "rad", side = "motor"', 'unit = "rad"')),
    )
    np.testing.assert_allclose(log.columns["position"], MACHINE.log()["q"], rtol=1e-6)
    assert log.given("actuator", "torque_gain") == pytest.approx(2.0)


def test_a_screw_turns_the_motor_by_so_many_radians_a_metre(tmp_path: Path) -> None:
    text = MOTOR.replace('"rotation"', '"translation"').replace("gear_ratio = 50", 'gear_ratio = "1 rad/mm"')
    log = read_log(write_csv(tmp_path / "log.csv", MACHINE.log()), column_map(text))
    np.testing.assert_allclose(log.columns["position"], MACHINE.log()["q"] / 1000, rtol=1e-6)
    # N·m/A of the motor become N/A of the slide.
    assert log.given("actuator", "torque_gain") == pytest.approx(40.0)


def test_the_gains_of_a_loop_at_the_motor_are_per_radian_of_the_joint(tmp_path: Path) -> None:
    text = MOTOR.replace("[actuator]", 'goal = { name = "q", unit = "rad", side = "motor" }\n[actuator]')
    text += '[loop]\nproportional = "3 A/rad"\nderivative = "0.1 A*s/rad"\n'
    log = read_log(write_csv(tmp_path / "log.csv", MACHINE.log()), column_map(text))
    assert log.given("loop", "proportional") == pytest.approx(150.0)
    assert log.given("loop", "derivative") == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gear_ratio = 50\n", "", "[columns.position] side: is the motor's, so the ratio is needed; add"),
        (', side = "motor"', "", "[actuator] gear_ratio: acts on nothing; write side ="),
        ("gear_ratio = 50", 'gear_ratio = "50 m"', "[actuator] gear_ratio"),
        ("gear_ratio = 50", "gear_ratio = 0", "[actuator] gear_ratio of map.toml is zero"),
        ('unit = "A", ', 'unit = "A", gain = "much", ', '"much" is not a quantity; write it like "0.12 N*m/A"'),
    ],
)
def test_mistakes_are_told_with_their_mend(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = write_csv(tmp_path / "log.csv", MACHINE.log())
    with pytest.raises(UsageError) as raised:
        read_log(path, column_map(MOTOR.replace(old, new)))
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("column", "factor"),
    [('unit = "A", gain = "0.5 N*m/A"', 0.5), ('unit = "kN", gain = "-20 cm"', -200.0), ('gain = "3 N*m"', 3.0)],
)
def test_a_torque_is_known_as_a_current_or_as_a_force_at_a_lever(tmp_path: Path, column: str, factor: float) -> None:
    columns = MACHINE.log()
    columns["tau"] = columns["tau"] / factor
    text = LOADED.replace('name = "tau", unit = "N*m"', f'name = "tau", {column}')
    fit = fit_of(tmp_path, columns, text)
    assert estimate(fit, "torque_gain").value == pytest.approx(MACHINE.gain, rel=0.01)
    assert estimate(fit, "inertia").value == pytest.approx(MACHINE.inertia, rel=0.02)


def test_a_load_of_known_mass_and_length(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", MACHINE.log())
    log = read_log(path, column_map(f'{FREE}[load]\nmass = "500 g"\nlength = "20 cm"\n'))
    assert log.given("load", "gravity") == pytest.approx(0.5 * 9.80665 * 0.2)
    assert log.given("load", "inertia") == pytest.approx(0.5 * 0.04)
    log = read_log(path, column_map(f'{FREE}[load]\nmass = "500 g"\nlength = "20 cm"\ninertia = "0.03 kg*m^2"\n'))
    assert log.given("load", "inertia") == pytest.approx(0.03)
    with pytest.raises(UsageError, match=r"\[load\] mass: needs a length"):
        column_map(f'{FREE}[load]\nmass = "500 g"\n')
    slide = FREE.replace('"rotation"', '"translation"').replace('"rad"', '"m"').replace("2 N*m/A", "2 N/A")
    with pytest.raises(UsageError, match=r"\[load\] mass: is of a turning load; for a slide write"):
        column_map(f'{slide}[load]\nmass = "500 g"\nlength = "2 m"\n')
