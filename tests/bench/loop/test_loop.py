"""What the loop keeps of a tick is what really happened on the wires."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.procedures.makers import pushed
from norton_bench.rig.load import load_rig
from norton_bench.segments import Use
from tests.bench.bench_in_simulation import opened

RIGS = Path(__file__).parents[3] / "rigs"


@pytest.mark.parametrize(
    ("rig_file", "command", "carried", "load_carried"),
    [
        ("sim-odrive.toml", 0.1, float(np.float32(0.1)), float(np.float32(0.05))),
        ("sim-vesc.toml", 0.12345, 0.123, float(np.float32(0.05))),  # whole milliamperes
        ("sim-vesc.toml", 0.009, 0.0, float(np.float32(0.05))),  # less than the drive's minimum
        ("sim-mit.toml", 0.12345, -2 + 2174 * 4 / 4095, float(np.float32(0.05))),  # the nearest of 4096 codes
        ("sim-mit.toml", 0.0, -2 + 2048 * 4 / 4095, float(np.float32(0.05))),  # which is never quite zero
    ],
)
def test_commands_are_recorded_as_the_wire_carries_them(
    rig_file: str, command: float, carried: float, load_carried: float
) -> None:
    segment = pushed("test", "push", Use.PREPARE, np.full(20, 0.05), np.full(20, command))
    with opened(load_rig(RIGS / rig_file)) as bench, bench.loop.running():
        ticks = bench.loop.run(segment).ticks
    assert ticks["command"] == pytest.approx(carried, abs=1e-12)
    assert ticks["load_torque_nm"] == pytest.approx(load_carried, abs=1e-12)
    assert set(ticks["wished_load_torque_nm"]) == {0.05}
