"""This program inside the guest: its commands, a rig on the guest's links, and its simulated bench on them."""

import io
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

RATE = "250 Hz"
COMMAND = str(Path(sys.executable).with_name("norton-bench"))
_PATIENCE_S = 120.0


def shipped_rig(checkout: Path, family: str) -> Path:
    return checkout / f"rigs/sim-{family}.toml"


def rig_on(checkout: Path, family: str, channel: str, name: str = "") -> Path:
    """The family's shipped rig, with its bus on a link of the kernel's, and a slower loop."""
    text = shipped_rig(checkout, family).read_text(encoding="utf-8")
    text = text.replace('rate = "1 kHz"', f'rate = "{RATE}"').replace('"udp_multicast"', '"socketcan"')
    text = re.sub(r'channel = "239[^"]*"', f'channel = "{channel}"', text)
    file = Path(f"{name or family}.toml").absolute()
    file.write_text(text, encoding="utf-8")
    return file


def bench(*arguments: object) -> tuple[int, str]:
    """One of this program's commands: its exit code, and what it printed, or the error where it failed."""
    done = subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, check=False)
    return done.returncode, done.stderr if done.returncode and not done.stdout else done.stdout


def bench_here(*arguments: object) -> tuple[int, str]:
    """The same in this process, which spares an emulated processor the imports: all that it said."""
    from norton_bench.cli.app import main

    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        code = main([str(each) for each in arguments])
    return code, said.getvalue()


@contextmanager
def served(rig: Path, seed: int) -> Iterator[None]:
    """Inside, the rig's simulated devices are on its bus."""
    server = subprocess.Popen(
        [COMMAND, "sim", "serve", str(rig), "--seed", str(seed)], stderr=subprocess.PIPE, text=True
    )
    assert server.stderr is not None
    begun_s = time.monotonic()
    line = server.stderr.readline()
    if not line.startswith("serving"):
        raise RuntimeError(f"sim serve said {line!r} after {time.monotonic() - begun_s:.0f} s")
    try:
        yield
    finally:
        server.terminate()
        server.wait(_PATIENCE_S)
