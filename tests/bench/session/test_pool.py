"""Many sessions at a time: interrupted, they end at once, in order, and leave nothing behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
# Each work leaves a file when it begins, and takes it away when it ends in order.
PROGRAM = """
import signal, sys, time

signal.signal(signal.SIGINT, signal.default_int_handler)  # a suite in a shell's background has its children ignore it
from pathlib import Path
from norton_bench.cli.app import run_safely
from norton_bench.session.pool import process_pool

def work(path):
    path.touch()
    try:
        time.sleep(60)
    finally:
        path.unlink()

def run():
    folder = Path(sys.argv[1])
    with process_pool(2) as pool:
        futures = [pool.submit(work, folder / str(number)) for number in range(6)]
        (folder / "begun").touch()
        for future in futures:
            future.result()

if __name__ == "__main__":
    sys.exit(run_safely(run, debug=False))
"""


@pytest.mark.parametrize(("number", "times"), [(signal.SIGINT, 1), (signal.SIGINT, 3), (signal.SIGTERM, 1)])
def test_interrupted_all_of_it_ends_at_once(number: signal.Signals, times: int, tmp_path: Path) -> None:
    program, folder = tmp_path / "program.py", tmp_path / "work"
    program.write_text(PROGRAM)
    folder.mkdir()
    process = subprocess.Popen(
        [sys.executable, str(program), str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])},
    )
    with process:
        until_s = time.monotonic() + 60
        while len(list(folder.iterdir())) < 3 and time.monotonic() < until_s:
            time.sleep(0.05)
        begun_s = time.monotonic()
        for _ in range(times):  # as a terminal does, to all processes; SIGTERM comes to one
            os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
            time.sleep(0.2)
        said, _ = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "Interrupted.\n")
    assert time.monotonic() - begun_s < 30  # not the minute that the work would have taken
    assert [path.name for path in folder.iterdir()] == ["begun"]
