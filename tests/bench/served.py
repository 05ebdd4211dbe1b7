"""Simulated devices served in wall time by a process of their own, for tests of what meets them as hardware."""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig

RIG_FILE = Path(__file__).parents[2] / "rigs" / "sim-odrive.toml"
GROUP = "239.74.163.65"
# A host that is no real-time machine may stand still for tens of milliseconds.
PATIENT = {
    'stale_after = "100 ms"': 'stale_after = "250 ms"',
    'stall_after = "100 ms"': 'stall_after = "200 ms"',
    'watchdog = "300 ms"': 'watchdog = "400 ms"',
}


def rig_of_its_own(folder: Path, group: str = GROUP, *, backend: str = "hardware", **changes: str) -> Rig:
    """``rigs/sim-odrive.toml`` on a group, a port and a pseudo-terminal that nobody else has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    own = {
        "239.74.163.2": group,
        "socket://localhost:7641": str(folder / "bota"),
        'bitrate = "1 Mbit/s"': f'bitrate = "1 Mbit/s"\noptions = {{ port = {port} }}',
    }
    text = RIG_FILE.read_text()
    for right, other in {**PATIENT, **own, **changes}.items():
        assert right in text
        text = text.replace(right, other)
    (folder / "rig.toml").write_text(text)
    return load_rig(folder / "rig.toml", backend=backend)


@contextmanager
def served(rig: Rig) -> Iterator[Path]:
    """The rig's devices; yields the file of what is true."""
    witness = Path(rig.place).with_name("witness.csv")
    command = [sys.executable, "-m", "norton_bench", "sim", "serve", rig.place, "--witness", str(witness)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        said = server.stderr.readline()
        try:
            assert said.startswith("serving"), said
            yield witness
        finally:
            server.send_signal(signal.SIGINT)
            assert server.wait(20) == 0
