"""What authors of drivers test theirs with: a contract to subclass, and a world to script a device in.

Import it in tests only: it needs pytest (``pip install norton-bench[testing]``). docs/drivers.md shows how.
"""

import pytest

# So that a broken contract shows the values that broke it.
pytest.register_assert_rewrite("bench.testing.contract", "bench.testing.amplifier", "bench.testing.torque_sensor")

from bench.testing.amplifier import AmplifierContract
from bench.testing.far_end import AmplifierFarEnd, FarEnd, SetUp, TorqueSensorFarEnd
from bench.testing.torque_sensor import TorqueSensorContract
from bench.testing.world import ScriptedBus, ScriptedClock, ScriptedLine, ScriptedWorld

__all__ = [
    "AmplifierContract",
    "AmplifierFarEnd",
    "FarEnd",
    "ScriptedBus",
    "ScriptedClock",
    "ScriptedLine",
    "ScriptedWorld",
    "SetUp",
    "TorqueSensorContract",
    "TorqueSensorFarEnd",
]
