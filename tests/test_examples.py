"""The examples run, and the sessions that are shipped suit every rig that can perform them."""

import re
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.rig.load import load_rig
from norton_bench.session.program import make_experiment
from norton_bench.session.schema import load_session
from tests.bench.half_rate import half_rate_text

ROOT = Path(__file__).parents[1]
SHORT = """\
rig = "{rig}"
[[step]]
do = "tare"
duration = "0.5 s"
[[step]]
do = "free"
levels = 3
dwell = "200 ms"
duration = "2 s"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With the examples and, beside them, the rigs they name, at half their rate: as good for what is looked at."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "rigs").mkdir()
    for name in ("sim-odrive", "sim-free-shaft"):
        (tmp_path / "rigs" / f"{name}.toml").write_text(half_rate_text(name), encoding="utf-8")
    return tmp_path


def example(name: str, *arguments: object, folder: Path) -> str:
    """What ``examples/<name>`` prints."""
    return printed_by(folder / "examples" / name, *arguments, folder=folder)


def printed_by(script: Path, *arguments: object, folder: Path) -> str:
    """What ``script`` prints when it is run in ``folder``."""
    done = subprocess.run(
        [sys.executable, str(script), *map(str, arguments)],
        cwd=folder,
        # One thread: those of linear algebra wait in loops, on cores that other tests need.
        env={"TMPDIR": str(folder), "PATH": "", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_identify_prints_parameters_and_its_network_can_be_used(folder: Path) -> None:
    session = folder / "short.toml"
    session.write_text(SHORT.format(rig=folder / "rigs" / "sim-free-shaft.toml"))
    said = example("identify.py", session, folder=folder)
    assert re.search(r"amplifier_bandwidth +(5[4-9]\d|6[0-5]\d)(\.\d+)? ± .* rad/s \(valid\)", said)
    assert "(ratio only)" in said
    network = re.search(r"^network +(\S+\.network\.json)$", said, re.MULTILINE)
    assert network is not None
    used = example("use_network.py", network[1], folder=folder)
    # τc / (Km Ka): what no scale is needed for.
    low, high = re.findall(r"breaks away at commands of (\S+) and (\S+) N\*m", used)[0]
    assert -float(low) == float(high) == pytest.approx(0.02 / 0.9, rel=0.03)
    velocity = float(re.findall(r"source says (\S+) rad/s", used)[0])
    assert velocity == pytest.approx(0.02 / 1e-3, rel=0.05)


@pytest.mark.long
def test_own_session_finds_the_heavier_actuator(folder: Path) -> None:
    said = example("own_session.py", 1, folder=folder)
    value, std = map(float, re.findall(r"inertia (\S+) ± (\S+) kg\*m\^2, where 8e-05 is true", said)[0])
    assert value == pytest.approx(8e-5, rel=0.03)
    assert 0 < std < 0.03 * 8e-5


@pytest.mark.long
def test_own_script_goes_on_until_friction_is_known(folder: Path) -> None:
    said = example("own_script.py", 0.03, folder=folder)
    value, plus_minus, rounds = re.findall(
        r"coulomb_torque = (\S+) ± (\S+) N\*m \(valid\) after (\d) round\(s\)", said
    )[0]
    assert float(value) == pytest.approx(0.02, rel=0.03)
    assert float(plus_minus) <= 0.03 * float(value)
    assert 1 <= int(rounds) <= 5


@pytest.mark.long
def test_the_script_in_the_docs_runs_as_printed(folder: Path) -> None:
    (text,) = re.findall(
        r"```python\n(.*?)```", (ROOT / "docs" / "scripting.md").read_text(encoding="utf-8"), re.DOTALL
    )
    script = folder / "friction.py"
    script.write_text(text.replace("seed=1", "seed=1, live=False"), encoding="utf-8")  # the same in half of the time
    said = printed_by(script, folder=folder)
    value = re.fullmatch(r"coulomb_torque = (\S+) ± \S+ N\*m \(valid\)\n", said)
    assert value is not None, said
    assert float(value[1]) == pytest.approx(0.02, rel=0.01)


@pytest.mark.long
def test_networks_shows_one_actuator_in_four_shapes_a_muscle_and_an_arm(folder: Path) -> None:
    said = example("networks.py", folder=folder)
    # A spring that is its source's match is moved half of its way, to within what 1 s leaves of the oscillation.
    places = [float(place) for place in re.findall(r"is moved to (\S+) rad", said)]
    assert len(places) == 4
    assert places == pytest.approx([0.2] * 4, abs=0.01)
    assert len(set(places)) == 1
    # 0 = (π − θ)² c − K θ at c = 0.5, and the torque beside it.
    assert "rests at 1.225 rad" in said
    assert "exerts 2.739 and 0.793 N m" in said
    assert "f_T is what the port exerts that is blocked at 0 rad" in said
    # K (0.4 − θ) = G sin θ
    assert "the arm with its weight moves to 0.34" in said
    assert "two muscles in series: two networks in impedance form take motion in" in said


# What each rig can perform, of the sessions that are shipped, or what it lacks.
SPOKEN_TO = ("sim-mit", "sim-damiao", "sim-robstride")
ON_SERIAL_LINES = ("sim-odrive-uart", "sim-vesc-uart", "sim-simplefoc", "sim-moteus-fdcanusb")
ON_CAN = ("sim-odrive", "sim-dbc", "sim-dyn200", "sim-cia402", "sim-vesc", "sim-cubemars", "sim-moteus", *SPOKEN_TO)
WITH_LOAD = (*ON_CAN, *ON_SERIAL_LINES)
SESSIONS = ("characterise", "quick", "refine", "zero-torque")
LACKS = dict.fromkeys(product(SESSIONS, WITH_LOAD), "")
LACKS |= dict.fromkeys(product(SESSIONS, ["sim-free-shaft"]), "'calibrate' needs a load drive")
LACKS |= dict.fromkeys(product(("in-situ",), WITH_LOAD), "")
LACKS |= dict.fromkeys(product(SESSIONS, ["sim-in-situ"]), "'calibrate' needs a torque sensor")
LACKS |= {("in-situ", "sim-free-shaft"): "'in_situ' needs a load drive", ("in-situ", "sim-in-situ"): ""}
LACKS |= dict.fromkeys(product(["characterise"], SPOKEN_TO), "'imposed' asks for 40 rad/s")
# Those that are identified by tables, and the sessions that tabulate.
TABULATE = ("two-ports", "muscle")
BY_TABLES = (
    "sim-pneumatic",
    "sim-series-elastic",
    "sim-gear-train",
    "sim-arm",
    "sim-gravity",
    "sim-variable-stiffness",
)
LACKS |= dict.fromkeys(product(SESSIONS, BY_TABLES), "builds on a fitted model|'imposed' asks for")
LACKS |= dict.fromkeys(product(TABULATE, [*WITH_LOAD, *BY_TABLES]), "")
LACKS |= dict.fromkeys(product(TABULATE, ["sim-free-shaft"]), "'calibrate' needs a load drive")
LACKS |= dict.fromkeys(product(TABULATE, ["sim-in-situ"]), "'calibrate' needs a torque sensor")
LACKS |= dict.fromkeys(product(["in-situ"], BY_TABLES), "")
LACKS |= dict.fromkeys(product(SESSIONS, ["sim-servo"]), "the command of this actuator is a position")
LACKS |= dict.fromkeys(product(SESSIONS, ["sim-mit-velocity"]), "the command of this actuator is a velocity")
SERVOS = ("sim-servo", "sim-mit-velocity")
LACKS |= dict.fromkeys(product(["in-situ"], SERVOS), "")
LACKS |= dict.fromkeys(product(["quick"], SERVOS), "'imposed' asks for 20 rad/s")
LACKS |= dict.fromkeys(product(TABULATE, SERVOS), "")
BODY = "virtual-body"
LACKS |= dict.fromkeys(product([BODY], [*WITH_LOAD, *BY_TABLES]), "")
LACKS |= {(BODY, "sim-free-shaft"): "'calibrate' needs a load drive"}
LACKS |= {(BODY, "sim-in-situ"): "'calibrate' needs a torque sensor"}
LACKS |= dict.fromkeys(product([BODY], SERVOS), "'render' is for a motor")
ARM = "arm"
LACKS |= dict.fromkeys(product([ARM], [*WITH_LOAD, *BY_TABLES]), "")
LACKS |= {(ARM, "sim-free-shaft"): "'calibrate' needs a load drive"}
LACKS |= {(ARM, "sim-in-situ"): "'calibrate' needs a torque sensor"}
LACKS |= dict.fromkeys(product([ARM], SERVOS), "a servo would jump from level to level")
EVERY = (*SESSIONS, "in-situ", *TABULATE, BODY, ARM)
LACKS |= {(session, "sim-dynamixel-servo"): LACKS[session, "sim-servo"] for session in EVERY}
GEARED = ("sim-dynamixel", "sim-feetech")
LACKS |= dict.fromkeys(product(("in-situ", "refine", "zero-torque", *TABULATE, BODY, ARM), GEARED), "")
LACKS |= dict.fromkeys(product(("characterise", "quick"), GEARED), "'imposed' asks for [24]0 rad/s")
LACKS |= {(session, "sim-dynamixel-alone"): "needs a load drive" for session in EVERY}


def test_every_session_and_rig_that_is_shipped_is_looked_at() -> None:
    names = [{path.stem for path in (ROOT / folder).glob("*.toml")} for folder in ("sessions", "rigs")]
    assert set(LACKS) == {(session, rig) for session in names[0] for rig in names[1]}


@pytest.mark.parametrize(("session_name", "rig_name"), LACKS, ids=str)
def test_sessions_suit_the_rigs_that_can_perform_them(session_name: str, rig_name: str) -> None:
    session = load_session(ROOT / "sessions" / f"{session_name}.toml")
    rig = load_rig(ROOT / "rigs" / f"{rig_name}.toml")
    lacks = LACKS[session_name, rig_name]
    if not lacks:
        assert len(make_experiment(session, rig).plan) >= len(session.steps)
        return
    with pytest.raises(RigError, match=lacks):
        make_experiment(session, rig)
