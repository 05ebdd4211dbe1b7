"""What is installed, and that it collides with nobody."""

import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[1]
# A user's project with folders named like those of this repository.
PROJECT = {
    "bench/__init__.py": "",
    "bench/errors.py": "raise ImportError('the wrong package')",
    "drivers/__init__.py": "raise ImportError('the wrong package')",
    "sim_backend.py": "raise ImportError('the wrong package')",
    "tests/test_mine.py": """
        import bench

        def test_mine(norton_rig, norton_run):
            assert bench.__file__.endswith("bench/__init__.py")
            rig = norton_rig(RIG, {"simulated.actuator.coulomb_torque": "25 mN*m"})
            assert rig.name == "sim-odrive"
            assert callable(norton_run)
    """,
}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    build = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", build, str(folder)], cwd=ROOT, capture_output=True, text=True, timeout=120, check=True
    )
    return ZipFile(folder / done.stdout.split()[-1])


def test_nothing_is_installed_under_a_common_name(wheel: ZipFile) -> None:
    tops = {name.partition("/")[0] for name in wheel.namelist()}
    assert {name for name in tops if not name.endswith(".dist-info")} == {
        "norton_bench",
        "norton_drivers",
        "norton_sim",
    }


def test_rigs_sessions_scripts_and_docs_are_in_it(wheel: ZipFile) -> None:
    names = set(wheel.namelist())
    for pattern in ("README.md", "rigs/*.toml", "sessions/*.toml", "examples/*.py", "docs/*.md", "docs/images/*.png"):
        there = {f"norton_bench/shipped/{path.relative_to(ROOT)}" for path in ROOT.glob(pattern)}
        assert there
        assert there <= names


@pytest.mark.long
def test_the_plugin_works_in_a_project_with_folders_of_the_same_names(tmp_path: Path) -> None:
    for name, text in PROJECT.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        lines = text.strip("\n").splitlines()
        (tmp_path / name).write_text("\n".join(line.removeprefix("        ") for line in lines))
    rig = f"RIG = {str(ROOT / 'rigs' / 'sim-odrive.toml')!r}\n"
    mine = tmp_path / "tests" / "test_mine.py"
    mine.write_text(rig + mine.read_text())
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHONPATH"))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert "1 passed" in done.stdout, done.stdout + done.stderr
