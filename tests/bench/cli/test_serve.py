"""Two processes meet over real sockets and a pseudo-terminal: one serves the simulated devices, one is the bench."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
PROGRAM = [sys.executable, "-c", "import sys; from norton_bench.cli.app import main; sys.exit(main())"]


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """The dynamometer, on a multicast group and a port of this test's own."""
    text = (ROOT / "rigs" / "sim-odrive.toml").read_text()
    path = tmp_path / "rig.toml"
    path.write_text(
        text.replace("239.74.163.2", "239.74.163.61").replace("socket://localhost:7641", f"{tmp_path}/bota")
    )
    return path


@pytest.fixture
def served(rig: Path) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [*PROGRAM, "sim", "serve", str(rig)], cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stderr is not None
        assert "serving sim-odrive on 239.74.163.61" in process.stderr.readline()
        yield process
        process.kill()


@pytest.mark.wall_time
def test_a_second_process_finds_the_served_devices(served: subprocess.Popen[str], rig: Path) -> None:
    command = [*PROGRAM, "rig", "check", str(rig), "--backend", "hardware", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    devices = json.loads(done.stdout)["devices"]
    assert [device["role"] for device in devices] == ["actuator", "load", "torque_sensor"]
    assert all(device["firmware"] or device["driver"] == "bota" for device in devices)
    # The host may freeze for some milliseconds; what came must have come in step all the same.
    assert all(stream["readings"] > 0 for device in devices for stream in device["streams"].values())


@pytest.mark.wall_time
def test_an_interrupt_ends_serving_and_takes_the_port_away(served: subprocess.Popen[str], rig: Path) -> None:
    assert (rig.parent / "bota").is_symlink()
    served.send_signal(signal.SIGINT)
    assert served.wait(timeout=10) == 0
    assert not (rig.parent / "bota").is_symlink()
