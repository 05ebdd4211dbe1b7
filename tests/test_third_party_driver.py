"""A driver from a package of its own: installed without a network, found by its name, and true to the contract."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from norton_bench.errors import RigError
from norton_bench.rig.load import parse_rig
from norton_bench.rig.new.interview import Interview
from norton_bench.rig.new.options import Prepared
from norton_drivers import registry
from norton_drivers.errors import WiringError

ROOT = Path(__file__).parents[1]
RIG = """
[rig]
name = "foreign"
rate = "1 kHz"
[bus.can0]
interface = "socketcan"
channel = "can0"
[actuator]
driver = "turnwell"
bus = "can0"
node = {node}
command = {{ unit = "N*m", limit = "0.5 N*m" }}
[limits]
velocity = "60 rad/s"
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the example's package is installed."""
    folder = tmp_path_factory.mktemp("installed")
    source = shutil.copytree(ROOT / "examples" / "third-party-driver", folder / "source")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    target = folder / "site"
    subprocess.run([*pip, "--no-build-isolation", "--target", target, source], check=True, timeout=120)
    return target


@pytest.fixture
def found(installed: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The same, where this process finds it, and has not imported it yet."""
    monkeypatch.syspath_prepend(installed)
    forget(monkeypatch)
    yield installed
    forget(monkeypatch)


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("norton_bench_turnwell")]:
        monkeypatch.delitem(sys.modules, name)


def test_it_keeps_the_contract(installed: Path, tmp_path: Path) -> None:
    tests = shutil.copytree(installed.parent / "source" / "tests", tmp_path / "tests")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{installed}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout


def test_it_is_listed_without_being_imported_and_a_rig_file_can_name_it(found: Path) -> None:
    assert "turnwell" in registry.names(registry.AMPLIFIERS)
    assert "norton_bench_turnwell.driver" not in sys.modules
    rig = parse_rig(RIG.format(node=5), place="rig.toml")
    assert (rig.wiring.actuator.driver, rig.wiring.actuator.options) == ("turnwell", {"node": 5})
    with pytest.raises(RigError, match=r"rig.toml: \[actuator\] node: .*the drive's node number"):
        parse_rig(RIG.format(node=500), place="rig.toml")


def test_rig_new_asks_for_it_and_rig_check_knows_it(found: Path) -> None:
    answers = {
        "actuator.driver": "turnwell", "actuator.node": "5", "actuator.command": "0.5 N*m",
        "bus.can0.channel": "can0", "limits.velocity": "60 rad/s",
    }  # fmt: skip
    rig = parse_rig(Interview(Prepared(answers), "foreign").rig(), place="rig.toml")
    assert (rig.wiring.actuator.driver, rig.wiring.actuator.options) == ("turnwell", {"node": 5})
    state = can.Message(arbitration_id=0x207, data=bytes(3), is_extended_id=False)
    assert registry.recognition()["turnwell"].recognise(state, {}).options == {"node": 7}


def test_a_package_that_cannot_be_imported_is_named_in_a_sentence(found: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = found.parent / "broken"
    shutil.copytree(found, broken, dirs_exist_ok=True)
    (broken / "norton_bench_turnwell" / "driver.py").write_text("import a_library_that_nobody_has\n")
    monkeypatch.syspath_prepend(broken)
    words = (
        r"package norton-bench-turnwell 1\.0\.0 says that it is norton_bench_turnwell\.driver:open_amplifier, but "
        r"importing that fails \(ModuleNotFoundError: No module named 'a_library_that_nobody_has'\); update or "
    )
    with pytest.raises(WiringError, match=words):
        registry.load(registry.AMPLIFIERS, "turnwell", asked_by="[actuator] driver")
    with pytest.raises(RigError, match=rf"rig\.toml: \[actuator\]: driver = 'turnwell': {words}") as caught:
        parse_rig(RIG.format(node=5), place="rig.toml")
    assert "\n" not in str(caught.value)
