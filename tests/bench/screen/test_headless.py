"""Whoever has no terminal never pays for one."""

import subprocess
import sys

import pytest

HEADLESS = """
import sys
from importlib import import_module
for name in ("norton_bench.cli.app", "norton_bench.cli.experiment", "norton_bench.cli.recordings",
             "norton_bench.cli.screen", "norton_bench.session.engine", "norton_bench.session.hosted",
             "norton_bench.session.replay", "norton_bench.session.replay", "norton_bench.report.render",
             "norton_bench.screen.figures", "norton_bench.screen.picture.picture", "norton_bench.screen.plots",
             "norton_bench.screen.panels.result", "norton_bench.screen.experiment"):
    import_module(name)
    assert not [module for module in sys.modules if module.split(".")[0] == "textual"], name
"""
UNDRAWN = """
import sys
import norton_bench.cli.experiment, norton_bench.session.engine, norton_bench.session.hosted
assert "matplotlib" not in sys.modules
"""
LIGHT = """
import sys
import norton_bench.screen.app
assert not [module for module in sys.modules if module.split(".")[0] in ("matplotlib", "filterpy")]
"""


@pytest.mark.long
@pytest.mark.parametrize(
    "program",
    [HEADLESS, UNDRAWN, LIGHT],
    ids=["no textual without a screen", "nothing that draws before there is a report", "no report with a screen"],
)
def test_imports(program: str) -> None:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("arguments", [[], ["--replay", "x.mcap"], ["rig.toml"]])
def test_without_a_terminal_it_says_so(arguments: list[str]) -> None:
    command = [sys.executable, "-m", "norton_bench", "ui", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    assert done.returncode == 2
    assert "ui needs a terminal" in done.stderr
    assert "Traceback" not in done.stderr
