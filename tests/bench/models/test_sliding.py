"""Steady sliding with terms, against the motion and the torque that the network's own steps give."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import (
    command_shown,
    drive_nm,
    falling,
    greatest_friction_nm,
    held_nm,
    port_torque_nm,
    resistance_nm,
)
from norton_bench.models.terms import NetworkTerm

MOTOR = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, "N*m")
STRIBECK = NetworkTerm("stribeck", (0.008, 2.0))
SAME_EVERYWHERE = (
    STRIBECK,
    NetworkTerm("asymmetry", (0.2,)),
    NetworkTerm("load", (0.1,)),
    NetworkTerm("saturation", (20.0,)),
    NetworkTerm("drag", (2e-5,)),
)
ALL = replace(MOTOR, terms=SAME_EVERYWHERE)
TICK_S = 1e-3


@pytest.mark.parametrize("velocity", [-30.0, -1.0, 0.5, 20.0])
@pytest.mark.parametrize("command", [-0.06, 0.0, 0.09])
def test_a_steady_slide_exerts_what_the_network_says(velocity, command):
    """Under a motion of that velocity, once contact and amplifier have settled."""
    position = velocity * TICK_S * np.arange(2000)
    given = {"motor_torque_nm": ALL.torque_gain * command, "friction_torque_nm": 0.02 * np.sign(velocity)}
    torque = ALL.torque(np.full(position.size, command), position, TICK_S, **given)[-10]
    assert float(port_torque_nm(ALL, command, velocity)) == pytest.approx(torque, rel=1e-4)


def test_the_free_velocity_is_where_drive_and_resistance_meet():
    command = np.array([-0.1, -0.05, 0.06, 0.1])
    assert resistance_nm(ALL, ALL.source_velocity(command)) == pytest.approx(drive_nm(ALL, command))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_shaft_begins_to_slide_at_the_threshold(side):
    lower, upper = ALL.thresholds
    assert float(drive_nm(ALL, upper if side > 0.0 else lower)) == pytest.approx(side * held_nm(ALL, side))


def test_friction_that_falls_is_seen_with_where_it_falls():
    """Slope of τc(1 + Δ·exp(−(ω/v)²)) + Bω: B − 2Δτω/v²·exp(−(ω/v)²), steepest at ω = v/√2."""
    low, high, slope = falling(replace(MOTOR, terms=(STRIBECK,)), 40.0)
    assert slope == pytest.approx(1e-3 - 2 * 0.008 / 2.0 * np.exp(-0.5) / np.sqrt(2.0), rel=1e-4)
    assert 0.0 < low < 2.0 / np.sqrt(2.0) < high < 6.0
    assert falling(MOTOR, 40.0) is None
    assert falling(replace(MOTOR, terms=(NetworkTerm("stribeck", (0.001, 2.0)),)), 40.0) is None


def test_a_motor_that_saturates_before_it_moves_has_a_command_to_show_all_the_same():
    stuck = replace(MOTOR, terms=(NetworkTerm("saturation", (1e4,)),))
    assert not np.isfinite(stuck.thresholds[1])
    assert command_shown(stuck) == pytest.approx(3 * 0.02 / 0.9)


def test_the_greatest_friction_is_what_holds_at_the_worst_place():
    """Against the torque that it takes to slide slowly over a turn, in both directions."""
    terms = (
        STRIBECK,
        NetworkTerm("asymmetry", (0.2,)),
        NetworkTerm("friction_by_position", (0.1, 0.1), 6),
        NetworkTerm("cogging", (-0.002, -0.002), 6),  # against the motion where friction is greatest
    )
    network = replace(MOTOR, terms=terms)
    position = 0.05 * TICK_S * np.arange(130_000)
    held = max(np.abs(network.torque(np.zeros(position.size), way * position, TICK_S)).max() for way in (-1.0, 1.0))
    damping = network.viscous_damping_nms_rad * 0.05
    assert greatest_friction_nm(network) == pytest.approx(held - damping, rel=1e-3)
    assert greatest_friction_nm(MOTOR) == MOTOR.coulomb_torque_nm
