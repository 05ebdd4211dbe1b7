"""The gallery from end to end: one experiment through frames and bytes, its table, its page, and what makes it fail."""

import json
from dataclasses import replace
from html import escape
from pathlib import Path

import pytest

from norton_bench.cli import app
from norton_bench.gallery import paper
from norton_bench.gallery.paper import CATALOGUE, prove, rigs_in, write_gallery
from tests.bench.gallery.experiments import measured

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def motor():
    return measured("motor", 5)


def test_every_claim_about_the_motor_comes_true(motor):
    rows = [row for claim in CATALOGUE["motor"].claims(motor) for row in claim.rows]
    assert len(rows) == 14
    assert [f"{row.what}: {row.found} for {row.expected}" for row in rows if not row.passed] == []


def test_another_inertia_is_not_taken_for_this_one(motor):
    other = replace(motor, true={**motor.true, "inertia": 1.2 * motor.true["inertia"]})
    assert not all(row.passed for claim in CATALOGUE["motor"].claims(other) for row in claim.rows)


@pytest.mark.parametrize("parameter", ["torque_gain", "viscous_damping", "coulomb_torque"])
def test_a_motor_that_is_another_by_five_per_cent_is_not_taken_for_this_one(motor, parameter):
    other = replace(motor, true={**motor.true, parameter: 1.05 * motor.true[parameter]})
    assert not all(row.passed for claim in CATALOGUE["motor"].claims(other) for row in claim.rows)


def test_each_claim_has_its_picture_and_its_table_on_the_page(motor, monkeypatch, tmp_path):
    monkeypatch.setattr(paper, "measure", lambda *_args: motor)
    proofs = prove("motor", motor.rig, 5)
    page, pictures = write_gallery(tmp_path, proofs, "norton-bench paper")
    text = page.read_text()
    assert [picture.name for picture in pictures] == [
        "gallery-one-source.svg",
        "gallery-three-branches.svg",
        "gallery-steady-torque.svg",
        "gallery-inertial-frame.svg",
        "gallery-slow-approach.svg",
    ]
    for proof in proofs:
        assert escape(proof.title, quote=True).replace("&#x27;", "&#39;") in text
        assert all(escape(row.what).replace("&#x27;", "&#39;") in text for row in proof.rows)
    for picture in pictures:
        assert picture.read_text().startswith('<svg xmlns="http://www.w3.org/2000/svg"')
        assert "--measured:" in picture.read_text()


def test_the_command_prints_the_table_and_fails_with_a_row(motor, monkeypatch, capsys):
    monkeypatch.setattr(paper, "measure", lambda *_args: motor)
    told = []

    def in_one_process(rigs, seeds, jobs, on_done):
        told.append((sorted(rigs), seeds))
        rows = prove("motor", rigs["motor"], seeds[0])
        wrong = replace(rows[0].rows[0], expected=1.0)
        return (replace(rows[0], rows=(wrong,)), *rows[1:])

    monkeypatch.setattr(paper, "gallery", in_one_process)
    assert app.main(["paper", "--rigs", str(ROOT / "rigs"), "--seeds", "5", "--json", "--quiet"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert told == [(sorted(CATALOGUE), (5,))]
    assert not data["passed"]
    assert [row["pass"] for row in data["rows"]] == [False] + [True] * (len(data["rows"]) - 1)
    assert {"seed", "claim", "figure", "unit", "expected", "found", "interval", "rival", "pass"} == set(data["rows"][0])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--rigs", "nowhere"], "nowhere/sim-odrive.toml: no such rig file"),
        (["--seeds", "3-1"], '--seeds "3-1": write numbers and ranges'),
        (["--seeds", "one"], '--seeds "one": write numbers and ranges'),
    ],
)
def test_what_cannot_be_run_is_refused_in_a_sentence(arguments, sentence, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert app.main(["paper", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_every_experiment_has_its_rig():
    rigs = rigs_in(ROOT / "rigs")
    assert sorted(rigs) == sorted(CATALOGUE)
    for name, entry in CATALOGUE.items():
        for procedure in entry.procedures:
            procedure.require(rigs[name])
