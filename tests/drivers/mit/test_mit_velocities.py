"""Velocities as commands of a motor in MIT mode: what is sent, what it stands for, and how it is enabled."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.ranges import Ranges
from norton_drivers.errors import WiringError
from norton_drivers.mit import MitOptions
from norton_drivers.servo import Servo
from norton_drivers.spoken_to.goals import Goals

RANGES = Ranges(12.5, 50.0, 2.0)
GIVEN = {"node": 1, "position_range": 12.5, "velocity_range": 50.0, "torque_range": 2.0}
FAST = {"mode": "velocity", "damping": 0.04}
SERVO = Servo(0.0, 33 * 5 / 4095)


@given(velocity_rad_s=st.floats(-49.9, 49.9))
def test_a_velocity_by_hand(velocity_rad_s):
    """unpack_cmd (bgkatz/motorcontrol, can.c): 16, 12, 12, 12 and 12 bits; kp is zero."""
    frame, sent_rad_s = Goals(RANGES, SERVO, protocol.goal_value).frame(velocity_rad_s, 0)
    number = int.from_bytes(frame, "big")
    fields = [number >> shift & (1 << bits) - 1 for shift, bits in ((48, 16), (36, 12), (24, 12), (12, 12), (0, 12))]
    assert fields[2:4] == [0, 33]
    assert sent_rad_s == pytest.approx(velocity_rad_s, abs=0.5 * 100 / 4095 + 1e-12)


@given(velocity_rad_s=st.floats(-49.9, 49.9), moves_rad_s=st.floats(-49.9, 49.9), angle_rad=st.floats(-12.5, 12.5))
def test_what_is_sent_is_what_the_drive_makes_of_it(velocity_rad_s, moves_rad_s, angle_rad):
    """foc.c, torque_control: whatever the angle; half a step of torque, which is never zero, counts as a velocity."""
    frame, sent_rad_s = Goals(RANGES, SERVO, protocol.goal_value).frame(velocity_rad_s, 0)
    held_nm = protocol.goal_of(frame, RANGES).held_nm(angle_rad, moves_rad_s)
    assert held_nm == pytest.approx(SERVO.gain * (sent_rad_s - moves_rad_s), abs=1e-12)


@given(velocity_rad_s=st.one_of(st.floats(50.1, 1e6), st.floats(-1e6, -50.1)))
def test_what_is_beyond_the_range_is_sent_as_its_end(velocity_rad_s):
    _, sent_rad_s = Goals(RANGES, SERVO, protocol.goal_value).frame(velocity_rad_s, 0)
    assert sent_rad_s == pytest.approx(math.copysign(50.0, velocity_rad_s), abs=0.02)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_not_sent(value):
    with pytest.raises(CodecError, match="velocity: not a finite number"):
        Goals(RANGES, SERVO, protocol.goal_value).frame(value, 0)


def test_the_loop_is_what_a_frame_can_hold():
    servo = MitOptions.model_validate({**GIVEN, **FAST, "greatest_torque": 0.44}).servo
    assert servo is not None
    assert not servo.holds_position
    assert (servo.stiffness_nm_rad, servo.of_angle, servo.of_velocity) == (0.0, 0.0, 1.0)
    assert servo.gain == SERVO.gain  # the nearest of 4095 steps to 0.04 N m s/rad
    assert servo.greatest_error == pytest.approx(0.44 / servo.gain)
    assert servo.delay_s == 12.5e-6


def test_units_follow_the_mode():
    assert MitOptions.model_validate({**GIVEN, **FAST}).command_unit == "rad/s"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "velocity"}, r'damping = 0.0: mode = "velocity" needs it, at least 0.0012'),
        ({"mode": "velocity", "damping": 6.0}, r"damping = 6.0: a frame carries no more than 5"),
        ({**FAST, "stiffness": 2.0}, r'stiffness = 2.0: mode = "velocity" has none: its gain is damping; leave it out'),
    ],
)
def test_options_that_cannot_be(device, world, options, words):
    from norton_drivers.mit import open_amplifier

    with pytest.raises(WiringError, match=words):
        open_amplifier(device("actuator", "mit", **{**GIVEN, **options}), world.link())


def test_wherever_the_shaft_stands_it_may_be_enabled():
    goals = Goals(RANGES, SERVO, protocol.goal_value)
    goals.begin(11.0, 0)
    _, sent_rad_s = goals.frame(0.0, 0)
    assert abs(sent_rad_s) <= 0.5 * 100 / 4095
