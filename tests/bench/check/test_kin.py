"""Families whose frames look alike: each told from the others, and what is set in them compared with the rig file."""

from typing import Any

import pytest

from norton_bench.rig.load import load_rig
from tests.bench.check.test_families import CUBEMARS, DAMIAO, MIT, ROBSTRIDE, VESC, really, sentences, twins

A_MIT_MOTOR = {"driver": "mit", "position_range": "12.5 rad", "velocity_range": "50 rad/s", "torque_range": "2 N*m"}
A_DAMIAO_MOTOR = {"driver": "damiao"}
A_ROBSTRIDE = {"driver": "robstride", "node": 9, "motor": "rs05"}
A_CUBEMARS = {"driver": "cubemars", "node": 9, "pole_pairs": 21, "gear_ratio": 9}
A_VESC = {"driver": "vesc", "node": 4, "pole_pairs": 7}


@pytest.mark.parametrize(
    ("path", "device", "words"),
    [
        (DAMIAO, {**A_MIT_MOTOR, "node": 1, "master": 17}, 'an actuator in MIT mode (driver = "mit", node = 1, '),
        (
            DAMIAO,
            {**A_MIT_MOTOR, "node": 7, "master": 3},
            'an actuator in MIT mode (driver = "mit", node = 7, master = 3',
        ),
        (DAMIAO, A_VESC, 'a VESC (driver = "vesc", node = 4)'),
        (DAMIAO, A_ROBSTRIDE, 'a RobStride motor (driver = "robstride", node = 9)'),
        (MIT, A_ROBSTRIDE, 'a RobStride motor (driver = "robstride", node = 9)'),
        (MIT, A_CUBEMARS, 'a CubeMars actuator in servo mode (driver = "cubemars", node = 9)'),
        (VESC, A_CUBEMARS, 'a CubeMars actuator in servo mode (driver = "cubemars", node = 9)'),
        (VESC, A_ROBSTRIDE, 'a RobStride motor (driver = "robstride", node = 9)'),
        (
            VESC,
            {**A_DAMIAO_MOTOR, "node": 5, "master": 20},
            'a Damiao motor (driver = "damiao", node = 5, master = 20)',
        ),
        (ROBSTRIDE, A_CUBEMARS, 'a CubeMars actuator in servo mode (driver = "cubemars", node = 9)'),
        (ROBSTRIDE, {**A_MIT_MOTOR, "node": 7}, 'an actuator in MIT mode (driver = "mit", node = 7'),
        (CUBEMARS, A_VESC, 'a VESC (driver = "vesc", node = 4)'),
        (CUBEMARS, {**A_MIT_MOTOR, "node": 7}, 'an actuator in MIT mode (driver = "mit", node = 7'),
        (MIT, {**A_DAMIAO_MOTOR, "node": 5, "master": 20}, 'a Damiao motor (driver = "damiao", node = 5, master = 20)'),
        (
            MIT,
            {**A_DAMIAO_MOTOR, "node": 1, "master": 0},
            'a Damiao motor (driver = "damiao") has a temperature in its',
        ),
    ],
)
def test_one_in_the_place_of_another(path: Any, device: dict[str, Any], words: str) -> None:
    (sentence,) = sentences(really(load_rig(path), "actuator", **device))
    assert words in sentence


@pytest.mark.parametrize(
    ("path", "device", "words"),
    [
        (
            DAMIAO,
            {"torque_range": "10 N*m"},
            'its TMAX (register 23) is 10 N*m, but the rig file says torque_range = "2',
        ),
        (DAMIAO, {"position_range": "25 rad"}, 'write position_range = "25 rad", or set 12.5 in the motor'),
        (DAMIAO, {"velocity_range": "30 rad/s"}, 'write velocity_range = "30 rad/s", or set 50 in the motor'),
        (
            ROBSTRIDE,
            {"motor": "rs01"},
            "its limit_torque (0x700B) is 17 N*m, as of rs01 or rs02, but the rig file says motor",
        ),
        (DAMIAO, {"velocity_bandwidth": "40 Hz"}, 'write velocity_bandwidth = "40 Hz", or set 499 in the motor'),
    ],
)
def test_what_is_set_in_it_is_compared(path: Any, device: dict[str, Any], words: str) -> None:
    (sentence,) = sentences(really(load_rig(path), "actuator", **device))
    assert words in sentence


def test_two_that_only_send_are_told_by_their_rate() -> None:
    found = sentences(twins(CUBEMARS))
    assert any("oftener than one can; do two have this CAN id?" in each for each in found)
