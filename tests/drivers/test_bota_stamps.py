"""A Bota frame's arrival is that of its own last byte, whatever else was read with it."""

import pytest

from norton_drivers import bota
from norton_drivers.codecs.bota import BotaFrame

BYTE_NS = 10e9 / 460_800  # start, eight bits, stop


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def sensor(link, device):
    return bota.open_torque_sensor(device("torque_sensor", "bota"), link)


def read(world, link, data: bytes) -> None:
    world.line.arriving = data
    link.poll()


def frames(count: int) -> bytes:
    return b"".join(BotaFrame(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, k, 25.0).encode() for k in range(count))


def test_bytes_that_followed_came_later(world, link, sensor):
    read(world, link, frames(3)[:-27])
    ages_ns = [world.clock.ns - reading.arrival_ns for reading in sensor.take_torque()]
    assert ages_ns == pytest.approx([47 * BYTE_NS, 10 * BYTE_NS], abs=1)


def test_stamps_never_run_backwards(world, link, sensor):
    read(world, link, frames(1))
    read(world, link, frames(20))  # piled up somewhere, and read at the same instant
    stamps = [reading.arrival_ns for reading in sensor.take_torque()]
    assert stamps == sorted(stamps)
    assert stamps[0] == stamps[-1] == world.clock.ns
