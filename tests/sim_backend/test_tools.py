"""What the command line finds of the simulator."""

from importlib.metadata import entry_points

import pytest

from norton_drivers.errors import WiringError
from norton_sim.joined import open_two_joints, true_joints
from norton_sim.serve import serve
from norton_sim.tools import true_parameters


def test_the_tools_are_found_by_name() -> None:
    tools = {entry.name: entry.load() for entry in entry_points(group="norton_bench.simulators")}
    assert tools == {
        "serve": serve,
        "true_parameters": true_parameters,
        "two_joints": open_two_joints,
        "true_joints": true_joints,
    }


def test_true_parameters_are_those_of_the_rig_file(simulated: dict[str, object]) -> None:
    truth = true_parameters(simulated, seed=None, place="rig.toml")
    # Km Ka = 0.05 N m/A times 18 A/(N m).
    assert truth["torque_gain"] == (pytest.approx(0.9), "N*m/(N*m)")
    assert truth["inertia"] == (5e-5, "kg*m^2")
    with pytest.raises(WiringError, match=r"rig\.toml"):
        true_parameters({}, seed=None, place="rig.toml")
