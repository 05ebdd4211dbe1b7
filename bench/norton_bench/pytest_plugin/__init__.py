"""Fixtures for tests of an actuator's model: simulated rigs, sessions run on them, and assertions on what they found.

pytest finds this by itself where norton-bench is installed. It loads nothing heavy before a test asks for a fixture.

    def test_friction(norton_rig, norton_run):
        rig = norton_rig("rigs/dyno.toml", {"simulated.actuator.coulomb_torque": "25 mN*m"})
        found = norton_run(rig, "sessions/quick.toml")
        found.parameter("coulomb_torque").within("2 %").of("25 mN*m")
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from norton_bench.pytest_plugin.checks import SessionOutcome
    from norton_bench.rig.rig import Rig

OUT = "--norton-out"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where recordings and reports go."""
    group = parser.getgroup("norton-bench")
    group.addoption(OUT, default=None, metavar="DIR", help="Keep recordings and reports of norton_run in this folder.")


@pytest.fixture(scope="session")
def norton_rig() -> "Callable[..., Rig]":
    """``norton_rig(path, overrides={})``: the rig of that file, simulated; see :func:`.checks.simulated_rig`."""
    from norton_bench.pytest_plugin.checks import simulated_rig  # noqa: PLC0415

    return simulated_rig


@pytest.fixture(scope="session")
def norton_run(
    pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory
) -> "Callable[..., SessionOutcome]":
    """``norton_run(rig, session=None, *, seed=1, values={}, answers={}, fresh=False)``; see :class:`.checks.Runs`."""
    from norton_bench.pytest_plugin.checks import Runs  # noqa: PLC0415

    retained = pytestconfig.getoption(OUT)
    return Runs(Path(retained) if retained else tmp_path_factory.mktemp("norton-bench"))
