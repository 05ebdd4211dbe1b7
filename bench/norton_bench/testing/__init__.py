"""What authors of drivers test theirs with: a contract to subclass, and a world to script a device in.

Import it in tests only: it needs pytest (``pip install norton-bench[testing]``). docs/drivers.md shows how.
"""

import pytest

# So that a broken contract shows the values that broke it.
pytest.register_assert_rewrite("norton_bench.testing.contract", "norton_bench.testing.devices")

from norton_bench.testing.contract import EmulatedAmplifier, EmulatedDevice, EmulatedTorqueSensor, SetUp
from norton_bench.testing.devices import AmplifierContract, TorqueSensorContract
from norton_bench.testing.world import ScriptedBus, ScriptedClock, ScriptedLine, ScriptedWorld

__all__ = [
    "AmplifierContract",
    "EmulatedAmplifier",
    "EmulatedDevice",
    "EmulatedTorqueSensor",
    "ScriptedBus",
    "ScriptedClock",
    "ScriptedLine",
    "ScriptedWorld",
    "SetUp",
    "TorqueSensorContract",
]
