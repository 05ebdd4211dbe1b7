"""The example workflow: what its steps run, run as it stands, on a rig at half its rate."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.bench.half_rate import half_rate_text

ROOT = Path(__file__).parents[1]
WORKFLOW = (ROOT / "examples" / "ci" / "norton-bench.yml").read_text()
# Three sessions, each in a fresh process.
pytestmark = [pytest.mark.timeout(900), pytest.mark.long]
# Still far better known than what the session expects.
SHORTER = {'duration = "2 s" ': 'duration = "1 s" ', 'duration = "4 s"': 'duration = "2 s"'}
STEPS = dict(re.findall(r"^ +- name: (.+)\n +run: (.+)$", WORKFLOW, re.MULTILINE))


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What all steps but the installation leave."""
    folder = tmp_path_factory.mktemp("ci")
    here = folder / "examples" / "ci"
    shutil.copytree(ROOT / "examples" / "ci", here, ignore=shutil.ignore_patterns("__pycache__"))
    session = (here / "session.toml").read_text(encoding="utf-8")
    for usual, shorter in SHORTER.items():
        assert session.count(usual) == 1
        session = session.replace(usual, shorter)
    (here / "session.toml").write_text(session, encoding="utf-8")
    (folder / "rigs").mkdir()
    (folder / "rigs" / "sim-odrive.toml").write_text(half_rate_text("sim-odrive"), encoding="utf-8")
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HERE": str(here),
        # As if installed, also where the installation is older than the plugin.
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PYTEST_ADDOPTS": f"-p norton_bench.pytest_plugin -c {os.devnull} --rootdir . -p no:cacheprovider",
    }
    for name, command in STEPS.items():
        if name != "Install":
            done = subprocess.run(
                command,
                shell=True,
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                timeout=600,
                check=False,
            )
            assert done.returncode == 0, (name, done.stdout, done.stderr)
    return folder / "results"


def test_the_workflow_has_the_steps_that_matter() -> None:
    assert list(STEPS) == ["Install", "Check the session against its rig", "Run it on the simulated bench", "Test"]
    assert STEPS["Install"] == 'python -m pip install "$NORTON_BENCH"'


@pytest.mark.parametrize(("report", "tests"), [("bench.xml", 6), ("tests.xml", 2)])
def test_its_reports_tell_of_success(results: Path, report: str, tests: int) -> None:
    (suite,) = ET.parse(results / report).getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == (str(tests), "0", "0")


def test_it_keeps_the_recordings(results: Path) -> None:
    assert (results / "bench" / "sim-odrive.mcap").is_file()
    assert len(list((results / "tests").glob("*/*.report.html"))) == 2
