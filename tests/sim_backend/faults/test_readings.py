"""Sensors that lie, in ever new messages."""

from collections.abc import Callable
from math import nan, radians

import numpy as np
import pytest

from norton_sim.faults.schema import BiasJump, EncoderJump, FalseReading, Freeze, Saturation, SignFlip
from tests.sim_backend.faults.conftest import MS, Host

MakeHost = Callable[..., Host]
STEP_RAD = 2 * np.pi / 131072


def turning(host: Host) -> Host:
    """Enabled, and at a good speed."""
    host.enable()
    host.drive((0.15, 0.0), 200)
    for take in (host.actuator.take_motion, host.load.take_motion, host.sensor.take_torque):
        take()
    return host


def true_rad(host: Host, role: str) -> float:
    return host.backend.world.plant.true_position_rad(role)


@pytest.mark.parametrize("role", ["actuator", "load"])
def test_a_frozen_encoder_stands_and_its_velocity_dies_away(make_host: MakeHost, role: str) -> None:
    host = turning(make_host())
    host.backend.inject(Freeze(on=role, lasts_s=0.05))
    host.drive((0.15, 0.0), 45)
    readings = getattr(host, role).take_motion()
    later = readings[3:]
    assert len(readings) >= 44
    assert len({reading.position_rad for reading in later}) == 1
    assert abs(readings[0].velocity_rad_s) > 10
    assert later[-1].velocity_rad_s == 0
    assert true_rad(host, role) - later[-1].position_rad > 0.5
    host.drive((0.15, 0.0), 20)
    again = getattr(host, role).take_motion()[-1]
    assert again.position_rad == pytest.approx(true_rad(host, role), abs=0.1)
    assert again.velocity_rad_s > 10


@pytest.mark.parametrize("role", ["actuator", "load"])
def test_an_encoder_goes_on_counting_the_other_way(make_host: MakeHost, role: str) -> None:
    host = turning(make_host())
    before_rad = true_rad(host, role)
    host.backend.inject(SignFlip(on=role))
    host.drive((0.15, 0.0), 60)
    reading = getattr(host, role).take_motion()[-1]
    turned_rad = true_rad(host, role) - before_rad
    assert turned_rad > 0.5
    assert reading.position_rad == pytest.approx(before_rad - turned_rad, abs=0.1)
    assert reading.velocity_rad_s < -10


def test_an_encoder_jumps_and_its_tracker_takes_it_for_speed(make_host: MakeHost) -> None:
    host = make_host(EncoderJump(on="load", at_s=0.1, by_rad=radians(30)))
    host.listen(200)
    readings = host.load.take_motion()
    # The load's own positive sense is the bench's negative.
    assert readings[50].position_rad == pytest.approx(0, abs=STEP_RAD)
    assert readings[-1].position_rad == pytest.approx(-radians(30), abs=2 * STEP_RAD)
    assert min(reading.velocity_rad_s for reading in readings) < -100
    assert readings[-1].velocity_rad_s == pytest.approx(0, abs=0.1)


def torques_nm(host: Host, duration_ms: int = 50) -> np.ndarray:
    """Readings of what is measured from now on."""
    host.listen(4)
    host.sensor.take_torque()
    host.listen(duration_ms)
    return np.array([reading.torque_nm for reading in host.sensor.take_torque()])


def test_a_frozen_torque_stands_in_new_messages(make_host: MakeHost) -> None:
    host = make_host(Freeze(on="torque_sensor", at_s=0.05))
    host.listen(50)
    stamps = host.sensor.take_torque()
    frozen = torques_nm(host)
    assert len({reading.torque_nm for reading in stamps}) > 40
    assert (len(frozen), len(set(frozen))) == (pytest.approx(50, abs=1), 1)


@pytest.mark.parametrize(
    ("fault", "expected_nm"),
    [
        (BiasJump(on="torque_sensor", by_nm=0.2), 0.203),
        (FalseReading(on="torque_sensor", torque_nm=-1.5), -1.5),
        (FalseReading(on="torque_sensor", torque_nm=nan), nan),
    ],
)
def test_what_a_resting_sensor_then_says(make_host: MakeHost, fault: FalseReading, expected_nm: float) -> None:
    host = make_host(fault)
    # Bias 3 mN m; noise 1 mN m, of which fifty readings leave a seventh.
    assert np.mean(torques_nm(host)) == pytest.approx(expected_nm, abs=7e-4, nan_ok=True)


def test_a_saturated_sensor_gives_no_more_than_its_limit(make_host: MakeHost) -> None:
    host = turning(make_host(Saturation(on="torque_sensor", limit_nm=1e-3)))
    host.drive((-0.15, 0.0), 20)
    readings = [reading.torque_nm for reading in host.sensor.take_torque()]
    assert {-1e-3, 1e-3} >= {round(min(readings), 6), round(max(readings), 6)}
    assert max(map(abs, readings)) == pytest.approx(1e-3, rel=1e-6)


def test_faults_of_one_sensor_add_up_and_end_each_for_itself(make_host: MakeHost) -> None:
    host = make_host(BiasJump(on="torque_sensor", by_nm=0.5), SignFlip(on="torque_sensor", lasts_s=0.1, at_s=1e-3))
    assert np.mean(torques_nm(host)) == pytest.approx(-0.503, abs=1e-3)
    host.backend.clock.wait_until_ns(110 * MS)
    assert np.mean(torques_nm(host)) == pytest.approx(0.503, abs=1e-3)
