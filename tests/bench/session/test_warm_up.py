"""Nothing is left to compile once the bench is warm."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from norton_bench.rig.load import load_rig
from norton_bench.session import engine
from norton_bench.session.schema import standard_session
from norton_drivers.errors import ConnectionFailedError

ROOT = Path(__file__).parents[3]
# What Python calls; the others are compiled within them.
COUNT = """
from norton_bench.control import core
from norton_bench.identification import loops
from norton_bench.identification import friction_operators as operators
from norton_bench.models import network_steps
from norton_bench.session.warm_up import warm_up

warm_up()
called = {core: "sense track feed_forward pass_on advance put_first".split(), network_steps: ["free_motion"]}
called[loops] = "count_readings filter_at friction_path_of later lag_of_held mean_lag_of_held".split()
called |= {network_steps: ["strengths", "gains"], operators: "bristle stops elasto_plastic part_sums".split()}
print([name for module, names in called.items() for name in names if not getattr(module, name).signatures])
"""


def test_every_function_that_is_called_has_been_compiled() -> None:
    told = subprocess.run([sys.executable, "-c", COUNT], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


@pytest.mark.long
def test_a_port_that_is_not_there_is_told_before_anything_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "warm_up", lambda: pytest.fail("compiled, which may take a minute"))
    rig = load_rig(ROOT / "rigs" / "sim-odrive.toml", backend="hardware")
    assert rig.wiring.torque_sensor is not None
    unplugged = replace(rig.wiring.torque_sensor, port=str(tmp_path / "unplugged"))
    absent = replace(rig, wiring=replace(rig.wiring, torque_sensor=unplugged))
    with pytest.raises(ConnectionFailedError, match="is it plugged in"):
        engine.run_session(absent, standard_session(rig), out=tmp_path)
