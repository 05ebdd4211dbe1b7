"""The benchmark of other worlds: its rigs are what they say, and its truth agrees with a network that is the truth."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from norton_bench.models.network import NortonNetwork
from norton_bench.rig.load import parse_rig
from norton_sim.truth import read_truth

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # a program finds its neighbours there
worlds = import_module("other_worlds")

NETWORK = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")


def truth_of(world, strength=1.0):
    rig = parse_rig(worlds.rig_text(world, strength), place="rig")
    return rig, read_truth(rig.simulated, seed=1, place="rig", command_unit="N*m")


@pytest.mark.parametrize("world", worlds.WORLDS)
def test_every_world_departs_half_as_much_at_half_the_strength(world):
    whole, half = (truth_of(world, strength)[1].actuator for strength in worlds.STRENGTHS)
    if world in worlds.DEPARTURES:
        assert half.departures.row() != pytest.approx(whole.departures.row())
    elif world == "backlash":
        assert half.backlash.width_rad == pytest.approx(0.5 * whole.backlash.width_rad)
    else:
        assert half.spring.stiffness_nm_rad == pytest.approx(2 * whole.spring.stiffness_nm_rad)


@pytest.mark.long
def test_the_true_motor_is_predicted_as_it_is():
    """Without cogging the network is the plant: what is left is what ticks of 0.1 ms make of it."""
    rig, truth = truth_of(worlds.CONTROL)
    truth = truth.model_copy(update={"actuator": truth.actuator.model_copy(update={"cogging": None})})
    rng = np.random.default_rng(1)
    for command, motion in worlds.unseen_motions((-0.08, 0.08), rig, rng):
        assert max(worlds.torque_errors(truth, NETWORK, command, motion, rig.tick_s, 0.0)) < 0.03e-3
    for command in worlds.unseen_commands((-0.08, 0.08), rig, rng):
        assert max(worlds.velocity_errors(truth, NETWORK, command, rig.tick_s, 0.0)) < 0.02


def test_asymmetric_friction_is_as_far_off_as_it_is():
    """A tenth of 20 mN·m in sliding, either way."""
    rig, truth = truth_of("asymmetry")
    truth = truth.model_copy(update={"actuator": truth.actuator.model_copy(update={"cogging": None})})
    command, motion = next(worlds.unseen_motions((-0.08, 0.08), rig, np.random.default_rng(1)))
    assert list(worlds.torque_errors(truth, NETWORK, command, motion, rig.tick_s, 0.0)) == pytest.approx(
        [2e-3, 2e-3], rel=0.15
    )


def test_figures_count_what_they_say():
    right = worlds.Outcome("ripple", 1.0, 1, "", ("ripple",), False, True, 1e-3, 0.1, (0.9e-3, 0.5e-3), (0.05, 0.2))
    wrong = worlds.Outcome("ripple", 1.0, 2, "", ("drag",), True, True, 1e-3, 0.1, (2.1e-3, 0.5e-3), (0.05, 0.05))
    quiet = worlds.Outcome(worlds.CONTROL, 1.0, 1, "", (), True, True, 1e-3, 0.1, (0.5e-3,), (0.05,))
    loud = worlds.Outcome(worlds.CONTROL, 1.0, 2, "", ("drag",), False, True, 1e-3, 0.1, (0.5e-3,), (0.05,))
    of = worlds.figures([right, wrong, quiet, loud])
    assert of["held"] == pytest.approx(10 / 12)
    assert of["confidently_wrong"] == 1
    assert of["named"] == 0.5
    assert of["control_quiet"] == 0.5
    refused = worlds.Outcome("ripple", 1.0, 3, "the shaft did not move")
    assert worlds.figures([refused])["refused"] == 1
