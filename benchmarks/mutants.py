"""Would the tests notice? Small changes to the code, one at a time, and how many of them a test fails for.

Run with ``make mutants`` or ``python benchmarks/mutants.py [part ...]``; without a part, all of them are looked at. It
needs mutmut, which wants the packages beside the tests: they are copied so into a folder, which stays for
``mutmut show`` to be run in (it is printed). Code that numba compiles is not changed, nor is what has a decorator.

The guard: 1,539 of 1,619 are noticed. Of the 80 that are not, some half change nothing that could be seen: a comparison
of floats at equality (``<`` or ``<=``), 1e6 or 1000001 before three digits are printed, values that are written again
before they are read (a side of the balance before it has settled, a unit beside a number that is none), ``|=`` or ``=``
on what is zero.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "runs" / "mutants"
SOURCES = ("bench/norton_bench", "drivers/norton_drivers", "sim_backend/norton_sim")
BESIDE = ("rigs", "sessions", "examples", "benchmarks", "docs")
# mutmut's exit codes of a mutant's tests: pytest's own for what it noticed, 33 for no test at all.
SURVIVED, UNTESTED = 0, 33


@dataclass(frozen=True)
class Part:
    """What is changed, the tests that are to notice, and the least share that they must."""

    code: tuple[str, ...]
    tests: tuple[str, ...]
    least: float


PARTS = {
    "guard": Part(("norton_bench/guard/*",), ("tests/bench/guard",), 0.95),
    "codecs": Part(("norton_drivers/codecs/*",), ("tests/drivers/codecs",), 0.9),
    "control": Part(("norton_bench/control/*",), ("tests/bench/control",), 0.9),
    "fit": Part(
        ("norton_bench/identification/fit.py", "norton_bench/identification/statistics.py"),
        ("tests/bench/identification/test_fit.py", "tests/bench/identification/test_statistics.py"),
        0.9,
    ),
}


def stage(name: str, part: Part) -> Path:
    """The folder that mutmut works in, made anew."""
    folder = FOLDER / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    litter = shutil.ignore_patterns("__pycache__")
    for source in SOURCES:
        shutil.copytree(ROOT / source, folder / Path(source).name, ignore=litter)
    for beside in ("tests", *BESIDE):
        shutil.copytree(ROOT / beside, folder / beside, ignore=litter)
    settings = {
        "source_paths": [Path(source).name for source in SOURCES],
        "only_mutate": list(part.code),
        "also_copy": list(BESIDE),
        "pytest_add_cli_args": ["-n", "0", "-p", "no:cacheprovider"],
        "pytest_add_cli_args_test_selection": list(part.tests),
    }
    own = "\n".join(f"{key} = {json.dumps(value)}" for key, value in settings.items())
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (folder / "pyproject.toml").write_text(f"{text}\n[tool.mutmut]\n{own}\n", encoding="utf-8")
    return folder


def outcomes(folder: Path) -> dict[str, int | None]:
    """The exit code of every mutant's tests, by its name."""
    found: dict[str, int | None] = {}
    for path in sorted((folder / "mutants").rglob("*.meta")):
        found |= json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
    return found


def look_at(name: str, part: Part, processes: int) -> bool:
    """Change the part's code in every way; prints what was not noticed, and says whether enough was."""
    folder = stage(name, part)
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", str(processes)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": ""}
    subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, check=False)
    found = outcomes(folder)
    counts = Counter(found.values())
    left = sorted(mutant for mutant, code in found.items() if code in (SURVIVED, UNTESTED, None))
    for mutant in left:
        print(f"  not noticed: {mutant}{' (no test runs it)' if found[mutant] == UNTESTED else ''}")
    share = 1.0 - len(left) / max(len(found), 1)
    print(f"{name}: {len(found) - len(left)} of {len(found)} noticed, {share:.1%}; at least {part.least:.0%} is asked")
    print(f"  exit codes of their tests: {dict(counts)}; they are in {folder}")
    return bool(found) and share >= part.least


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="part", help=", ".join(PARTS))
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    names = arguments.parts or list(PARTS)
    enough = [look_at(name, PARTS[name], arguments.processes) for name in names]
    return 0 if all(enough) else 1


if __name__ == "__main__":
    sys.exit(main())
