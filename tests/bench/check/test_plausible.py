"""Scales that do not fit together: which of them is wrong, and none where all are right."""

from math import nan

import numpy as np
import pytest

from norton_bench.check.moving import (
    Push,
    TorqueScales,
    Turned,
    push_of,
    ratio_faults,
    torque_faults,
    torque_scales,
    turned_by,
    velocity_faults,
)
from norton_bench.records import MOTION, TICK, Measured


def motion(travel_rad: float, *, velocity_scale: float = 1.0, position_scale: float = 1.0) -> np.ndarray:
    """There in half a second, from rest to rest, read a thousand times a second."""
    table = np.zeros(500, MOTION)
    phase = np.arange(500) / 499
    table["arrival_ns"] = np.arange(500) * 1_000_000
    table["position_rad"] = position_scale * travel_rad * 0.5 * (1 - np.cos(np.pi * phase))
    table["velocity_rad_s"] = velocity_scale * travel_rad * 0.5 * np.pi / 0.499 * np.sin(np.pi * phase)
    return table


def turned(role: str = "actuator", travel_rad: float = 0.2, **scales: float) -> Turned:
    return turned_by(role, motion(travel_rad, **scales), 1e-4)


@pytest.mark.parametrize("scale", [1.0, 0.9, 1.1, -1.0])
@pytest.mark.parametrize("travel_rad", [0.2, -0.2])
def test_velocity_against_position(scale: float, travel_rad: float) -> None:
    faults = list(velocity_faults(turned(travel_rad=travel_rad, velocity_scale=scale)))
    assert bool(faults) == (scale < 0)


@pytest.mark.parametrize("scale", [0.5, 0.75, 1.3, 7.0])
def test_a_wrong_velocity_scale_is_told_with_its_size(scale: float) -> None:
    (fault,) = velocity_faults(turned(velocity_scale=scale))
    assert f"[actuator] its velocity readings say {scale:.2f} times what its positions do" in fault
    assert "range table" in fault


def test_an_encoder_too_coarse_to_tell_is_left_alone() -> None:
    coarse = turned_by("actuator", motion(0.2, velocity_scale=3.0), 0.02)
    assert list(velocity_faults(coarse)) == []
    assert list(velocity_faults(turned(travel_rad=0.01, velocity_scale=3.0))) == []


@pytest.mark.parametrize(("scale", "told"), [(1.0, False), (1.05, False), (2.0, True), (0.5, True), (-1.0, True)])
def test_two_encoders_on_one_shaft(scale: float, told: bool) -> None:
    faults = list(ratio_faults(turned(position_scale=scale), turned("load")))
    assert bool(faults) == told
    if told:
        assert f"[actuator] turned {scale:.2f} times as far as [load]" in faults[0]


@pytest.mark.parametrize(
    ("actuator", "load", "words"),
    [
        (0.9, 0.95, None),
        (1.2, 0.8, None),
        (nan, 1.0, None),
        (2.0, 1.9, "[torque_sensor] shows 1.95 times the torque that [actuator] and [load] agree on"),
        (0.001, 0.00105, "[torque_sensor] shows 0.00 times"),
        (1.77, 0.95, "[actuator] gives 1.77 times the torque that it is told, by [load] and [torque_sensor]"),
        (0.95, 0.4, "[load] gives 0.40 times the torque that it is told, by [actuator] and [torque_sensor]"),
        (nan, 2.0, "[load] gives 2.00 times the torque that it is told, by the torque sensor"),
        (0.2, 3.0, "check the scales of all three"),
    ],
)
def test_of_three_torques_the_odd_one_is_named(actuator: float, load: float, words: str | None) -> None:
    faults = list(torque_faults(TorqueScales(actuator, load)))
    assert (faults == []) if words is None else (len(faults) == 1 and words in faults[0])


def test_scales_follow_from_two_pushes() -> None:
    # Friction of 20 and 8 mN·m; the load gives 0.95 of what it is told, the actuator 0.9, the sensor is right.
    load, actuator = Push(0.028 / 0.95, 0.020), Push(0.028 / 0.9, 0.008)
    scales = torque_scales(load, actuator, in_newton_metres=True)
    assert (scales.actuator, scales.load) == (pytest.approx(0.9), pytest.approx(0.95))
    assert np.isnan(torque_scales(load, actuator, in_newton_metres=False).actuator)


def test_only_the_sliding_part_of_a_push_counts() -> None:
    ticks = np.zeros(100, TICK)
    ticks["velocity_rad_s"][80:] = 2.0
    ticks["load_torque_nm"] = np.linspace(0.01, 0.05, 100)
    ticks["torque_nm"] = 0.003
    ticks["torque_nm"][80:] = -0.017
    push = push_of(Measured(ticks=ticks), "load_torque_nm", 0.003, 2.4)
    assert push.told == pytest.approx(np.mean(ticks["load_torque_nm"][80:]))
    assert push.felt_nm == pytest.approx(0.020)
