"""The plugin in a pytest of its own: light until it is asked for something, and clear about what is not so."""

import os
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.pytest_plugin.checks import simulated_rig

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
RIG = ROOT / "rigs" / "sim-free-shaft.toml"
SESSION = """\
[parameters]
levels = 3
[[step]]
do = "tare"
duration = "500 ms"
[[step]]
do = "free"
levels = "$levels"
dwell = "200 ms"
duration = "2 s"
[[step]]
do = "ask"
name = "done"
text = "Done?"
[[expect]]
parameter = "amplifier_bandwidth"
interval = "0.0001 %"
"""
TESTS = """\
import pytest
from norton_bench.errors import UsageError

@pytest.fixture(scope="session")
def found(norton_rig, norton_run):
    return norton_run(norton_rig({rig!r}, {{"simulated.actuator.coulomb_torque": "30 mN*m"}}), "s.toml", seed=2)

def test_it_is_near(found):
    bandwidth = found.parameter("amplifier_bandwidth")
    assert bandwidth.within("10 %").of("600 rad/s")
    assert bandwidth.known_within("20 %")
    assert bandwidth.has_status("valid")
    assert bandwidth.covers(f"{{bandwidth.value + 1.9 * bandwidth.std}} rad/s")
    assert found.converged()
    # Nothing but a torque sensor tells more of it.
    assert found.parameter("coulomb_torque").has_status("ratio only")
    assert found.recording.is_file() and found.report.is_file()

def test_the_same_run_is_run_once(found, norton_rig, norton_run):
    rig = norton_rig({rig!r}, {{"simulated.actuator.coulomb_torque": "30 mN*m"}})
    assert norton_run(rig, "s.toml", seed=2) is found

def test_too_far(found):
    found.parameter("amplifier_bandwidth").within("2 %").of("60 rad/s")

def test_too_wide(found):
    assert found.parameter("amplifier_bandwidth").known_within("0.0001 %")

def test_not_covered(found):
    found.parameter("amplifier_bandwidth").covers("60 rad/s")

def test_no_number(found):
    found.parameter("inertia").within("2 %").of("5e-5 kg*m^2")

def test_nothing_predicted(found):
    found.predicts("torque", within="5 %")

def test_not_as_the_file_expects(found):
    found.as_expected()

def test_no_parameter(found):
    with pytest.raises(UsageError, match="did you mean"):
        found.parameter("inertai")
"""
ALONE = {**os.environ, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_ADDOPTS": ""}


def test_it_loads_nothing_heavy() -> None:
    heavy = '{"numpy", "scipy", "numba", "textual", "rich"}'
    code = f"import sys, norton_bench.pytest_plugin; print(*{heavy} & set(sys.modules))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=ALONE, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == []


def test_pytest_finds_it_by_its_entry_point() -> None:
    entry_points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["pytest11"]
    (module,) = entry_points.values()
    assert hasattr(import_module(module), "norton_run")


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What pytest prints of the tests above."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "s.toml").write_text(SESSION)
    (folder / "test_user.py").write_text(TESTS.format(rig=str(RIG)))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "norton_bench.pytest_plugin",
        "-rA",
        "-q",
        "--norton-out",
        "kept",
        "--basetemp",
        "tmp",
    ]
    done = subprocess.run(command, cwd=folder, env=ALONE, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    assert [path.name for path in (folder / "kept").iterdir()] == ["1-sim-free-shaft"]
    return done.stdout


def test_what_is_true_passes(said: str) -> None:
    passed = {line.partition("::")[2] for line in said.splitlines() if line.startswith("PASSED")}
    assert passed == {"test_it_is_near", "test_the_same_run_is_run_once", "test_no_parameter"}


@pytest.mark.parametrize(
    ("test", "sentence"),
    [
        ("test_too_far", "AssertionError: amplifier_bandwidth = "),
        ("test_too_far", "(valid): is not within 2 % of 60 rad/s, but "),
        ("test_too_wide", "is not within ±0.0001 %"),
        ("test_not_covered", "its 95 % interval does not hold 60 rad/s"),
        ("test_no_number", "AssertionError: inertia is not known (ratio only): is not within 2 % of 5e-5 kg*m^2"),
        ("test_nothing_predicted", "torque is predicted to nan %, which is not within 5 %"),
        ("test_not_as_the_file_expects", "not as expected, interval <= 0.0001 %"),
    ],
)
def test_what_is_not_fails_with_a_sentence(said: str, test: str, sentence: str) -> None:
    text = said[said.index(f"_ {test} _") :]
    assert sentence in text[: text.index("\n___", 1) if "\n___" in text[1:] else None]


def test_overrides_go_to_their_place() -> None:
    rig = simulated_rig(RIG, {"simulated.actuator.inertia": "8e-5 kg*m^2", "limits.velocity": "70 rad/s"})
    assert rig.simulated["actuator"]["inertia"] == "8e-5 kg*m^2"
    assert rig.limits.velocity_rad_s == 70.0
    assert "8e-5 kg*m^2" in rig.text


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"limits.velocty": "1 rad/s"}, r'\[limits\] velocty: unknown key; did you mean "velocity"\?'),
        ({"rig.name.x": 1}, "rig.name.x: name is no section; name a key like"),
    ],
)
def test_a_wrong_override_is_told(overrides: dict[str, object], said: str) -> None:
    with pytest.raises(RigError, match=said):
        simulated_rig(RIG, overrides)
