"""The bench finds the actuator that is there, and another one where there is another."""

from pathlib import Path

HERE = Path(__file__).parent
RIG = HERE.parent.parent / "rigs" / "sim-odrive.toml"


def test_the_actuator_is_as_it_was(norton_rig, norton_run):
    found = norton_run(norton_rig(RIG), HERE / "session.toml")
    found.as_expected()
    found.parameter("torque_gain").within("2 %").of("0.9")


def test_another_friction_is_found(norton_rig, norton_run):
    rig = norton_rig(RIG, {"simulated.actuator.coulomb_torque": "25 mN*m"})
    norton_run(rig, HERE / "session.toml").parameter("coulomb_torque").within("3 %").of("25 mN*m")
