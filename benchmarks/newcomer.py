"""A newcomer's first hour, timed: an installation of its own in an empty folder, without the repository.

For every Python that is found the wheel is installed into a fresh environment. Then the demonstration, copies of the
examples, a rig file made from answers, its check on the simulated twin, the standard session on it, its report, its
data sheet, and the plug-in of pytest in a project with folders ``bench`` and ``drivers`` of its own. Printed are wall
time and processor time of each step, and the size of the installation; the program fails where a step does.

    python benchmarks/newcomer.py [--pythons python3.11,python3.12]
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
PYTHONS = ("python3.11", "python3.12", "python3.13", "python3.14")
# What is typed of a bench that is nobody's here: a VESC against an ODrive, with a sensor of strain gauges between them.
ANSWERS = {
    "actuator.driver": "vesc",
    "actuator.node": "5",
    "actuator.pole_pairs": "7",
    "actuator.mode": "torque",
    "actuator.torque_constant": "0.06 N*m/A",
    "actuator.command": "0.5 N*m",
    "load.driver": "odrive",
    "load.node": "2",
    "load.torque_limit": "1 N*m",
    "torque_sensor.driver": "bota",
    "torque_sensor.port": "/dev/ttyUSB0",
    "bus.can0.channel": "can0",
    "limits.torque": "1 N*m",
    "limits.velocity": "60 rad/s",
    "simulated.twin": "typical",
}
PROJECT = {
    "bench/__init__.py": "",
    "drivers/__init__.py": "",
    "tests/test_mine.py": (
        "import bench, drivers\n\n\n"
        "def test_friction(norton_rig, norton_run):\n"
        '    found = norton_run(norton_rig("my-rig.toml"))\n'
        '    assert found.parameter("coulomb_torque").value > 0.0\n'
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pythons", default=",".join(PYTHONS), help="programs, separated by commas")
    pythons = [found for name in parser.parse_args().pythons.split(",") if (found := shutil.which(name))]
    if not pythons:
        sys.exit(f"none of {', '.join(PYTHONS)} is on the path; name one with --pythons")
    failed = False
    with TemporaryDirectory() as folder:
        wheel = built(Path(folder))
        for python in pythons:
            failed |= not first_hour(python, wheel)
    sys.exit(failed)


def built(folder: Path) -> Path:
    """The wheel of this repository."""
    code = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return folder / done.stdout.split()[-1]


def first_hour(python: str, wheel: Path) -> bool:
    """Every step, printed; whether all were done."""
    version = subprocess.run([python, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    print(f"{version}{'':22}{'wall [s]':>9}{'processor [s]':>15}", flush=True)
    with TemporaryDirectory() as folder:
        home, began_s = Path(folder), time.monotonic()
        for name, command in steps(python, wheel, home):
            wall_s, busy_s, done = timed(command, home)
            print(f"  {name:<32}{wall_s:9.1f}{busy_s:15.2f}", flush=True)
            if done.returncode:
                print(f"  {' '.join(command)}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
                return False
        size = sum(
            path.stat().st_size for path in (home / "env").rglob("*") if path.is_file() and not path.is_symlink()
        )
        print(f"  {'in all':<32}{time.monotonic() - began_s:9.1f}; installed: {size / 2**20:.0f} MiB\n", flush=True)
    return True


def steps(python: str, wheel: Path, home: Path) -> Iterator[tuple[str, Sequence[str]]]:
    """Name and command of each, carried out one after the other in ``home``."""
    program = str(home / "env" / "bin" / "norton-bench")
    own = str(home / "env" / "bin" / "python")
    yield "an environment", [python, "-m", "venv", "env"]
    yield "pip install", [own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"{wheel}[testing]"]
    yield "--version", [program, "--version"]
    yield "--help", [program, "--help"]
    yield "demo", [program, "demo", "--quiet", "--out", "demo"]
    yield "--help, once more", [program, "--help"]
    yield "examples", [program, "examples", "mine"]
    answers = [word for key, value in ANSWERS.items() for word in ("--set", f"{key}={value}")]
    yield "rig new", [program, "rig", "new", "my-rig.toml", "--yes", *answers]
    yield "rig check", [program, "rig", "check", "my-rig.toml", "--backend", "simulated"]
    yield "identify --dry-run", [program, "identify", "my-rig.toml", "--dry-run"]
    yield "identify", [program, "identify", "my-rig.toml", "--backend", "simulated", "--quiet", "--out", "first"]
    (recording,) = (home / "first").glob("*.mcap")
    yield "report", [program, "report", str(recording), "--quiet"]
    yield "datasheet", [program, "datasheet", str(recording)]
    yield "runs", [program, "runs", "."]
    for name, text in PROJECT.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text, encoding="utf-8")
    yield "pytest with folders bench, drivers", [own, "-m", "pytest", "-q", "tests"]


def timed(command: Sequence[str], home: Path) -> tuple[float, float, subprocess.CompletedProcess[str]]:
    """Wall time and processor time [s] of a command, its children's included."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    began_s, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=home, env=environment, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - began_s, busy_s, done


if __name__ == "__main__":
    main()
