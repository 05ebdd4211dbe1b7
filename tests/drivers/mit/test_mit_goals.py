"""Positions as commands of a motor in MIT mode: what is sent, how it is enabled, how it stops."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.ranges import Ranges
from norton_drivers.errors import DeviceError, WiringError
from norton_drivers.mit import MitOptions
from norton_drivers.servo import FURTHEST_RAD, LED_RAD_S, Servo
from norton_drivers.spoken_to.goals import Goals

MS = 1_000_000
RANGES = Ranges(3.2, 50.0, 2.0)
SERVO = Servo(1.9536, 0.02198)
GIVEN = {"node": 1, "position_range": 3.2, "velocity_range": 50.0, "torque_range": 2.0}
STIFF = {"mode": "position", "stiffness": 2.0, "damping": 0.022}


@given(position_rad=st.floats(-3.2, 3.2))
def test_a_goal_by_hand(position_rad):
    """unpack_cmd (bgkatz/motorcontrol, can.c): 16, 12, 12, 12 and 12 bits; kp to 500 and kd to 5."""
    frame, sent_rad = Goals(RANGES, SERVO, protocol.goal_value).frame(position_rad, 0)
    number = int.from_bytes(frame, "big")
    fields = [number >> shift & (1 << bits) - 1 for shift, bits in ((48, 16), (36, 12), (24, 12), (12, 12), (0, 12))]
    assert fields[0] * 6.4 / 65535 - 3.2 == pytest.approx(sent_rad, abs=1e-12)
    assert sent_rad == pytest.approx(position_rad, abs=0.5 * 6.4 / 65535 + 1e-12)
    assert fields[1:4] == [2047, round(1.9536 / 500 * 4095), round(0.02198 / 5 * 4095)]
    assert protocol.goal_of(frame, RANGES).position_rad == pytest.approx(sent_rad, abs=1e-12)


def test_gains_are_those_that_a_frame_can_hold():
    servo = MitOptions.model_validate({**GIVEN, **STIFF, "greatest_torque": 0.44}).servo
    assert servo is not None
    assert servo.stiffness_nm_rad == 16 * 500 / 4095  # the nearest of 4095 steps to 2 N m/rad
    assert servo.damping_nms_rad == 18 * 5 / 4095
    assert (servo.of_angle, servo.gain) == (1.0, servo.stiffness_nm_rad)
    assert servo.of_velocity == pytest.approx(servo.damping_nms_rad / servo.stiffness_nm_rad)
    assert servo.greatest_error == pytest.approx(0.44 / servo.stiffness_nm_rad)
    assert servo.delay_s == 12.5e-6  # 40 kHz, held for a period
    assert servo.window_s == 475e-6  # nineteen of them


def test_units_follow_the_mode():
    assert MitOptions.model_validate({**GIVEN, **STIFF}).command_unit == "rad"
    assert MitOptions.model_validate(GIVEN).command_unit == "N*m"
    assert MitOptions.model_validate(GIVEN).servo is None


def test_a_position_needs_a_stiffness(device, world):
    from norton_drivers.mit import open_amplifier

    with pytest.raises(WiringError, match=r'stiffness.*mode = "position" needs it, at least'):
        open_amplifier(device("actuator", "mit", **{**GIVEN, "mode": "position"}), world.link())


@given(away_rad=st.floats(-FURTHEST_RAD, FURTHEST_RAD), steps=st.lists(st.integers(0, 200), min_size=1, max_size=40))
def test_a_motor_away_from_zero_is_led_there_slowly(away_rad, steps):
    goals, now_ns, before = Goals(RANGES, SERVO, protocol.goal_value), 0, away_rad
    goals.begin(away_rad, now_ns)
    for step in steps:
        now_ns += step * MS
        _, sent_rad = goals.frame(0.0, now_ns)
        # No faster than that, but for the rounding to codes, and never beyond zero.
        assert abs(sent_rad - before) <= LED_RAD_S * min(step, 50) * 1e-3 + 2e-4
        assert abs(sent_rad) <= abs(before) + 2e-4
        before = sent_rad
    _, sent_rad = goals.frame(0.0, now_ns)
    for _ in range(20):
        now_ns += 50 * MS
        _, sent_rad = goals.frame(0.0, now_ns)
    assert abs(sent_rad) <= 1e-4


@pytest.mark.parametrize("away_rad", [0.3, -1.0, math.pi])
def test_a_motor_far_from_zero_is_not_enabled(away_rad):
    with pytest.raises(DeviceError, match=r"where a command of 0 would take it; turn it to within 0\.25 rad"):
        Goals(RANGES, SERVO, protocol.goal_value).begin(away_rad, 0)


def test_no_gain_is_sent_by_a_stop():
    assert int.from_bytes(protocol.command_value(RANGES.command_code(0.0)), "big") >> 12 & 0xFFFFFF == 0
