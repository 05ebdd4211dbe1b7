"""The ``[simulated]`` table: read with its units, refused with a sentence for each mistake."""

import copy
import tomllib
from pathlib import Path

import pytest

from norton_bench.models.parameters import PARAMETERS
from norton_drivers.errors import WiringError
from norton_sim.truth import read_truth, true_parameters

RIG = Path(__file__).parents[2] / "rigs" / "sim-odrive.toml"
PLACE = "rigs/mine.toml"


@pytest.fixture
def simulated() -> dict:
    return tomllib.loads(RIG.read_text())["simulated"]


def put(table: dict, path: str, value: object) -> dict:
    """A copy of ``table`` with the dotted ``path`` set, or taken out where ``value`` is None."""
    changed = copy.deepcopy(table)
    *tables, key = path.split(".")
    inner = changed
    for name in tables:
        inner = inner[name]
    if value is None:
        del inner[key]
    else:
        inner[key] = value
    return changed


def test_true_parameters_carry_the_identifiers_names_and_units(simulated):
    parameters = true_parameters(read_truth(simulated, seed=None, place=PLACE))
    of_a_motor = [parameter.name for parameter in PARAMETERS if parameter.name != "torque_limit"]  # a servo's
    assert list(parameters) == of_a_motor
    assert parameters == {
        "torque_gain": (pytest.approx(18 * 0.05), "N*m/(N*m)"),
        "amplifier_bandwidth": (600.0, "rad/s"),
        "inertia": (5e-5, "kg*m^2"),
        "viscous_damping": (1e-3, "N*m*s/rad"),
        "coulomb_torque": (0.02, "N*m"),
        "presliding_stiffness": (10.0, "N*m/rad"),
        "presliding_damping": (0.01, "N*m*s/rad"),
        "torque_constant": (0.05, "N*m/A"),
        "amplifier_gain": (18.0, "A/(N*m)"),
    }


def test_quantities_are_turned_into_the_units_of_their_names(simulated):
    truth = read_truth(simulated, seed=None, place=PLACE)
    assert truth.actuator.cogging is not None
    assert truth.actuator.cogging.amplitude_nm == pytest.approx(3e-4)
    assert truth.actuator.current_noise_a == pytest.approx(5e-3)
    assert truth.torque_sensor.noise_nm == pytest.approx(1e-3)
    assert truth.transport.can_delay_ns == 250_000
    assert truth.transport.serial_jitter_ns == 100_000


def test_a_load_gives_its_torque_gain_for_each_newton_metre(simulated):
    truth = read_truth(simulated, seed=None, place=PLACE)
    assert truth.load is not None
    assert truth.load.motor.Km * truth.load.motor.Ka == pytest.approx(0.95)
    assert truth.load.mounted == -1


def test_a_given_seed_comes_before_the_files(simulated):
    assert read_truth(simulated, seed=None, place=PLACE).seed == 1
    assert read_truth(simulated, seed=7, place=PLACE).seed == 7


def test_only_the_actuator_must_be_there(simulated):
    truth = read_truth({"actuator": simulated["actuator"]}, seed=None, place=PLACE)
    assert truth.load is None
    assert truth.torque_sensor.noise_nm == 0.0


def test_the_amplifier_may_be_commanded_in_volts(simulated):
    in_volts = put(simulated, "actuator.amplifier_gain", "900 mA/V")
    truth = read_truth(in_volts, seed=None, place=PLACE, command_unit="V")
    assert truth.actuator.motor.Ka == pytest.approx(0.9)
    assert true_parameters(truth, "V")["torque_gain"] == (pytest.approx(0.045), "N*m/(V)")


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        ("actuator.inertia", "5 N*m", '[simulated.actuator] inertia: "5 N*m" is not in kg*m^2; write it like'),
        ("actuator.inertia", 5, "[simulated.actuator] inertia: "),
        ("actuator.inertia", "0 kg*m^2", "[simulated.actuator] inertia = '0 kg*m^2' should be greater than 0"),
        ("actuator.amplifier_gain", "1 A/V", '[simulated.actuator] amplifier_gain: "1 A/V" is not in A/(N*m)'),
        ("actuator.torque_constant", None, '[simulated.actuator] torque_constant is missing; add torque_constant = "'),
        (
            "actuator.model",
            "stepper",
            "[simulated.actuator] model = 'stepper' is not known; write one of \"dahl_motor\", ",
        ),
        (
            "actuator.mass",
            "1 kg",
            "[simulated.actuator] mass is not known; known here: amplifier_gain, amplifier_bandwidth",
        ),
        ("actuator.cogging", {"amplitude": "1 mN*m"}, "[simulated.actuator.cogging] periods_per_turn is missing; add"),
        ("load.mounted", 2, "[simulated.load] mounted = 2 should be 1 or -1"),
        ("transport.can_delay", "-1 us", "[simulated.transport] can_delay = '-1 us' should be greater than or equal"),
        ("torque_sensor", 3, "[simulated] torque_sensor should be a table of its own: write [simulated.torque_sensor]"),
        ("actuator", None, "[simulated] actuator is missing; add a table [simulated.actuator]"),
        (
            "sensor",
            {},
            '[simulated] sensor is not known; did you mean "torque_sensor"?',
        ),
        ("seed", -1, "[simulated] seed = -1 should be greater than or equal to 0"),
    ],
)
def test_a_mistake_is_told_in_one_sentence_with_place_and_mend(simulated, path, value, sentence):
    with pytest.raises(WiringError) as refused:
        read_truth(put(simulated, path, value), seed=None, place=PLACE)
    told = str(refused.value)
    assert told.startswith(f"{PLACE}: {sentence}")
    assert "\n" not in told


def test_all_mistakes_are_told_at_once(simulated):
    twice = put(put(simulated, "load.inertia", "1 s"), "actuator.viscous_damping", "-1 N*m*s/rad")
    with pytest.raises(WiringError) as refused:
        read_truth(twice, seed=None, place=PLACE)
    assert len(str(refused.value).splitlines()) == 2
