"""The simulated motor's departures, each against what its equation says of steady motion."""

import math
from pathlib import Path

import pytest

from norton_bench.rig.load import load_rig
from norton_drivers.errors import WiringError
from norton_sim.departures import (
    ByPosition,
    Departures,
    InTime,
    Saturation,
    Stribeck,
)
from norton_sim.plant import Plant
from norton_sim.truth import read_truth

RIG = load_rig(Path(__file__).parents[2] / "rigs" / "sim-odrive.toml")
GAIN, DAMPING, COULOMB = 0.9, 1e-3, 0.02
SETTLED_S = 1.0  # twenty time constants
KEYS = "stribeck, asymmetry, load_friction"


def truth(load=None, **departures):
    """The shipped rig's motor on a free shaft, without cogging."""
    read = read_truth(RIG.simulated, seed=1, place="rig", command_unit="N*m")
    actuator = read.actuator.model_copy(update={"cogging": None, "departures": Departures(**departures)})
    return read.model_copy(update={"actuator": actuator, "load": load})


def steady(command, begin_s=0.0, mean_s=0.0, **departures):
    """The free velocity once it has settled, or its mean over the ``mean_s`` that follow."""
    plant = Plant(truth(**departures), 0)
    plant.advance(round(begin_s * 1e9))
    plant.command("actuator", command)
    plant.advance(round((begin_s + SETTLED_S) * 1e9))
    if not mean_s:
        return plant.true_velocity_rad_s("actuator")
    before = plant.true_position_rad("actuator")
    plant.advance(plant.now_ns + round(mean_s * 1e9))
    return (plant.true_position_rad("actuator") - before) / mean_s


def test_none_is_the_papers_motor():
    assert steady(0.06) == pytest.approx((GAIN * 0.06 - COULOMB) / DAMPING, rel=1e-6)


def test_friction_falls_with_speed():
    speed = steady(0.03, stribeck=Stribeck(drop=0.3, velocity="2 rad/s"))
    assert pytest.approx(DAMPING * speed + COULOMB * (1 - 0.3 * (1 - math.exp(-((speed / 2) ** 2))))) == GAIN * 0.03


@pytest.mark.parametrize(("command", "factor"), [(0.06, 1.1), (-0.06, 0.9)])
def test_friction_depends_on_the_direction(command, factor):
    speed = steady(command, asymmetry=0.1)
    assert abs(speed) == pytest.approx((GAIN * 0.06 - factor * COULOMB) / DAMPING, rel=1e-6)


def test_damping_grows_with_speed():
    speed = steady(0.06, quadratic_drag="3e-6 N*m*s^2/rad^2")
    assert pytest.approx(COULOMB + DAMPING * speed + 3e-6 * speed**2, rel=1e-6) == GAIN * 0.06


def test_the_torque_saturates():
    """At 2 A it is a tenth less."""
    command = 2.0 / 18.0
    speed = steady(command, saturation=Saturation(share=0.1, current="2 A"))
    assert speed == pytest.approx((0.9 * GAIN * command - COULOMB) / DAMPING, rel=1e-4)


def test_damping_drifts_and_the_motor_warms():
    drifted = steady(0.06, 59.0, damping_drift=InTime(share=0.1, over="120 s"))
    assert drifted == pytest.approx((GAIN * 0.06 - COULOMB) / (DAMPING * 1.05), rel=1e-3)
    warm = steady(0.06, 9.0, warming=InTime(share=-0.05, over="10 s"))
    assert warm == pytest.approx((GAIN * (1 - 0.05 * (1 - math.exp(-1.0))) * 0.06 - COULOMB) / DAMPING, rel=1e-3)


def test_what_goes_with_the_position_averages_out():
    """Over many turns; at any one place it does not."""
    for departure in ("ripple", "friction_by_position"):
        share = {departure: ByPosition(share=0.2, periods_per_turn=3)}
        assert steady(0.06, mean_s=1.0, **share) == pytest.approx((GAIN * 0.06 - COULOMB) / DAMPING, rel=0.02)
        assert abs(steady(0.06, **share) - steady(0.06)) > 1e-3


def test_friction_grows_with_what_is_carried():
    """Against a load that holds back by a torque of its own."""
    read = read_truth(RIG.simulated, seed=1, place="rig", command_unit="N*m")
    plant = Plant(truth(read.load, load_friction=0.1), 0)
    plant.command("actuator", 0.15)
    plant.command("load", 0.03 / read.load.torque_gain * -read.load.mounted)
    plant.advance(2_000_000_000)
    speed, port = plant.true_velocity_rad_s("actuator"), plant.true_port_torque_nm()
    assert GAIN * 0.15 - port == pytest.approx(DAMPING * speed + COULOMB + 0.1 * abs(port), rel=1e-3)
    assert abs(port) > 0.02


def test_a_rig_file_names_them():
    simulated = {**RIG.simulated, "actuator": {**RIG.simulated["actuator"], "departures": {"asymmetry": "10 %"}}}
    assert read_truth(simulated, seed=1, place="rig").actuator.departures.asymmetry == pytest.approx(0.1)
    simulated["actuator"]["departures"] = {"wear": "10 %"}
    with pytest.raises(WiringError, match=KEYS):
        read_truth(simulated, seed=1, place="rig")
