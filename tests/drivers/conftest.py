"""A world of its own for each test."""

from collections.abc import Callable

import pytest

from norton_bench.testing import ScriptedWorld
from norton_drivers.wiring import DeviceSettings


@pytest.fixture
def world():
    made = ScriptedWorld()
    yield made
    made.close()


@pytest.fixture
def device() -> Callable[..., DeviceSettings]:
    def make(role: str, driver: str, *, direction: int = 1, **options: object) -> DeviceSettings:
        return DeviceSettings(role, driver, bus="can0", port="fake", direction=direction, options=options)

    return make
