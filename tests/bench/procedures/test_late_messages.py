"""A calibration on a bench whose messages come late now and then, as on a computer with other work."""

from dataclasses import replace
from pathlib import Path

import pytest

from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.knowledge import Knowledge, carry_out
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.rig.load import load_rig
from tests.bench.bench_in_simulation import opened

pytestmark = pytest.mark.long

RIGS = Path(__file__).parents[3] / "rigs"


@pytest.mark.parametrize("name", ["sim-cia402"])
def test_late_messages_move_no_reading_in_time(name: str) -> None:
    """Its torque sensor sends a value only where that has changed: what is late must not be taken for unchanged."""
    rig = load_rig(RIGS / f"{name}.toml")
    late = {"kind": "delay", "on": "can0", "towards": "host", "share": "0.2 %", "by": "5 ms"}
    rig = replace(rig, simulated={**rig.simulated, "fault": [late]})
    known = Knowledge(rig)
    with opened(rig, seed=3) as bench:
        known = carry_out(TareProcedure(TareOptions(duration_s=0.5)), known, bench.loop)
        known = carry_out(CalibrateProcedure(CalibrateOptions(duration_s=4.0)), known, bench.loop)
        assert bench.backend.injected[0].hits > 10
    found = known.calibration
    assert found is not None
    assert found.torque_gain == pytest.approx(0.95, rel=0.02)
    assert found.inertia_kgm2 == pytest.approx(1.2e-4, rel=0.02)
    assert found.sensor_stiffness_nm_rad == pytest.approx(200.0, rel=0.05)
