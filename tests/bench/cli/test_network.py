"""``network``: what the commands print and write, and how they refuse."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from norton_bench.cli import app
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.algebra import Carried, Gear, Yielding, outward
from norton_bench.networks.family import coupled
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Load
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.operator import Operator
from tests.bench.networks.some import ALL_TERMS, MOTOR, PNEUMATIC, series_elastic

ARM = LinearNetwork(
    Kind.NORTON,
    Form.IMPEDANCE,
    Operator.rational([50.0], [1.0, 50.0]),
    Operator.polynomial(3.0, 0.1, 0.01),
    ("rad",),
    {"made": "by hand"},
)

PLAY = series_elastic("K*(dx - min(max(dx, -play), play))")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for name, network in {"arm": ARM, "motor": MOTOR, "muscle": PNEUMATIC, "play": PLAY}.items():
        save(network, tmp_path / f"{name}.network.json")
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    assert app.main(["network", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert app.main(["network", *map(str, arguments)]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    return sentence


def test_show_says_what_it_is_and_what_it_can_become(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = told(capsys, "show", files / "muscle.network.json")
    assert (data["type"], data["form"], data["equations"]) == ("norton", "impedance", "nonlinear")
    assert data["commands"] == {"c": "N*m/rad"}
    assert [each["holds"] for each in data["conditions"]] == [True] * 4
    assert [each["exists"] for each in data["equivalents"]] == [True] * 4
    assert [len(each["tables"]) for each in data["equivalents"]] == [1, 2, 0, 1]
    assert data["equivalents"][3]["tables"][0].startswith("an inverse to within 1.6e-05 rad, for f from -3.006 to")
    play = told(capsys, "show", files / "play.network.json")["equivalents"]
    assert [each["exists"] for each in play] == [False, False, True, False]
    assert all("stays at" in each["why"] for each in play if not each["exists"])
    motor = told(capsys, "show", files / "motor.network.json")
    assert all(each["exists"] for each in motor["equivalents"])
    assert app.main(["network", "show", str(files / "motor.network.json")]) == 0
    assert "exertion source: does not hold: a blocked port exerts" in capsys.readouterr().out


def test_show_lists_the_terms_with_their_values_intervals_and_equations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = replace(ALL_TERMS, covariance_names=("coulomb_asymmetry",), covariance=((0.01**2,),))
    save(known, tmp_path / "motor.network.json")
    data = told(capsys, "show", tmp_path / "motor.network.json")
    assert [each["name"] for each in data["terms"]] == [each.name for each in ALL_TERMS.terms]
    (asymmetry,) = (each for each in data["terms"] if each["name"] == "asymmetry")
    assert asymmetry["equation"] == "γ = 1 + a·sgn ω"
    assert asymmetry["parameters"][0] == {
        "name": "coulomb_asymmetry", "symbol": "a", "value": 0.2, "unit": "1", "half_interval": pytest.approx(0.0196),
    }  # fmt: skip
    assert app.main(["network", "show", str(tmp_path / "motor.network.json")]) == 0
    printed = capsys.readouterr().out
    assert "dahl motor, with terms" in printed
    assert "term asymmetry: γ = 1 + a·sgn ω: a = 0.2 ± 0.02: friction differs between the two directions" in printed
    assert "a = 0.001 N*m, b = -0.002 N*m, p = 3.7 a turn" in printed
    assert "p = 6 a turn" in printed


def test_export_to_mujoco_prints_what_the_terms_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(ALL_TERMS, tmp_path / "motor.network.json")
    dry = told(capsys, "export", tmp_path / "motor.network.json", "--to", "mujoco")
    kept = told(capsys, "export", tmp_path / "motor.network.json", "--to", "mujoco-dcmotor")
    assert kept["file"] == str(tmp_path / "motor.dcmotor.mjcf.xml")
    assert (len(dry["left_out"]), len(kept["left_out"])) == (9, 5)
    assert app.main(["network", "export", str(tmp_path / "motor.network.json"), "--to", "mujoco-dcmotor"]) == 0
    assert "The term ripple is left out" in "".join(capsys.readouterr())


def test_convert_writes_what_gives_the_original_back(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = told(capsys, "convert", files / "arm.network.json", "--type", "thevenin", "--form", "admittance")["network"]
    assert there == str(files / "arm.thevenin-admittance.json")
    back = told(
        capsys, "convert", there, "--type", "norton", "--form", "impedance", "--out", files / "back.network.json"
    )
    found = load(back["network"])
    assert isinstance(found, LinearNetwork)
    assert found.connection.answers_as(ARM.connection)
    assert found.source.answers_as(ARM.source)
    assert dict(found.provenance) == {"made": "by hand", "converted_from": "arm.thevenin-admittance.json"}


def test_a_motor_that_was_converted_is_a_motor_again(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = told(capsys, "convert", files / "motor.network.json", "--type", "thevenin", "--form", "admittance")[
        "network"
    ]
    data = told(capsys, "show", there)
    assert data["equations"] == "nonlinear"
    assert all(each["exists"] and not each["tables"] for each in data["equivalents"])
    back = told(
        capsys, "convert", there, "--type", "norton", "--form", "impedance", "--out", files / "back.network.json"
    )
    found = load(back["network"])
    assert isinstance(found, NortonNetwork)
    assert replace(found, provenance={}) == replace(MOTOR, provenance={})


@pytest.mark.long
def test_networks_are_joined_geared_and_seen_through_others(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A series-elastic drive made of files alone: motor, gear of 10, spring, and a link with its weight."""
    spring, link = files / "spring.network.json", files / "link.network.json"
    told(capsys, "element", "--stiffness", "8", "--damping", "0.02", "--out", spring)
    told(capsys, "element", "--impedance", "J*a + G*sin(x)", "--set", "J=0.01", "--set", "G=0.4", "--out", link)
    geared = told(capsys, "gear", files / "motor.network.json", "--ratio", "10")["network"]
    admittance = told(capsys, "convert", geared, "--form", "admittance")["network"]
    behind = told(capsys, "through", admittance, spring, "--as", "yielding")
    assert (behind["type"], behind["form"], behind["commands"]) == ("thevenin", "impedance", {"c": "N*m"})
    arm = told(capsys, "through", behind["network"], link, "--as", "carried", "--out", files / "arm2.network.json")
    made = load(arm["network"])
    assert made.provenance["made"].endswith("through link.network.json (carried)")
    by_hand = outward(MOTOR, Gear(10.0), Yielding(load(spring)), Carried(load(link)))
    command = np.full(50, 0.1)
    assert coupled(made, command, Load(), 1e-3).position_rad == pytest.approx(
        coupled(by_hand, command, Load(), 1e-3).position_rad, abs=1e-9
    )
    removed = told(capsys, "through", arm["network"], link, "--as", "carried", "--remove")["network"]
    assert removed == str(files / "arm2.inner.json")
    both = told(capsys, "join", spring, spring, "--in", "parallel")
    assert both["network"] == str(files / "spring-spring.parallel.json")
    joined = load(told(capsys, "join", both["network"], spring, "--in", "series")["network"])
    assert isinstance(joined, LinearNetwork)
    assert joined.impedance.response(0.0)[0, 0].real == pytest.approx(16.0 * 8.0 / 24.0)


def test_what_cannot_be_joined_is_one_sentence(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motor, out = files / "motor.network.json", files / "x.json"
    assert "ratio 0.0" in refused(capsys, "gear", motor, "--ratio", "0")
    assert "give two or more" in refused(capsys, "join", motor, "--in", "series")
    assert "is either --impedance" in refused(capsys, "element", "--out", out)
    assert "is either --impedance" in refused(capsys, "element", "--stiffness", "3", "--set", "K=3", "--out", out)
    assert "no value; write it as --set K=3" in refused(
        capsys, "element", "--impedance", "K*x", "--set", "K", "--out", out
    )
    assert '"K" in "K*x" is not known' in refused(capsys, "element", "--impedance", "K*x", "--out", out)
    assert "has no commands of its own" in refused(capsys, "through", motor, motor, "--as", "carried")
    told(capsys, "element", "--stiffness", "3", "--out", out)
    assert "has no command, so there is no source" in refused(capsys, "plot", out)


def test_plot_draws(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = told(capsys, "plot", files / "motor.network.json", "--span", "0.2")["plot"]
    assert drawn == str(files / "motor.svg")
    assert Path(drawn).read_text().count("<path") > 10


def test_what_cannot_be_done_is_one_sentence(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "convert", files / "play.network.json", "--form", "admittance")
    assert said.startswith(f"{files / 'play.network.json'}: the exertion stays at dx = -0.0")
    assert "cannot be read" in refused(capsys, "show", files / "none.json")
    assert "--settle" in refused(capsys, "show", files / "arm.network.json", "--settle", "3 rad")
    assert "must be greater than zero" in refused(capsys, "show", files / "arm.network.json", "--settle", "0 s")
    assert "shows nothing" in refused(capsys, "plot", files / "arm.network.json", "--span", "0")
    assert "name it" in refused(capsys, "plot", files / "arm.network.json", "--out", files / "x.doc")


def test_export_writes_each_kind_and_says_what_it_lacks(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = {
        to: told(capsys, "export", files / "motor.network.json", "--to", to)
        for to in ("mujoco", "urdf", "isaaclab", "c", "fmu")
    }
    names = {to: Path(data["file"]).name for to, data in written.items()}
    assert names == {
        "mujoco": "motor.mjcf.xml",
        "urdf": "motor.urdf",
        "isaaclab": "motor.isaaclab.py",
        "c": "motor.h",
        "fmu": "motor.fmu",
    }
    assert "Presliding is left out" in written["mujoco"]["left_out"][0]
    assert "motor_step(" in (files / "motor.h").read_text()
    assert (files / "motor.fmu").read_bytes()[:2] == b"PK"
    assert "no words" in refused(capsys, "export", files / "muscle.network.json", "--to", "mujoco")
    lost = files / "none" / "x.h"
    assert "cannot be written" in refused(capsys, "export", files / "motor.network.json", "--to", "c", "--out", lost)
