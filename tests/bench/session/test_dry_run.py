"""A session looked through beforehand: what it asks for at most, how long it takes, and what goes beyond the rig."""

from dataclasses import replace
from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.session import engine
from norton_bench.session.dry_run import dry_run, peaks_of, segments_of
from norton_bench.session.program import make_program
from norton_bench.session.schema import load_session, parse_session, standard_session
from norton_drivers.errors import WiringError

ROOT = Path(__file__).parents[3]
RIGS = sorted((ROOT / "rigs").glob("*.toml"))
RIG = load_rig(ROOT / "rigs" / "sim-odrive.toml")
HEAD = '[[step]]\ndo = "tare"\n[[step]]\ndo = "calibrate"\nduration = "2 s"\n'


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_the_standard_session_keeps_to_every_rigs_limits(path: Path) -> None:
    rig = load_rig(path)
    found = dry_run(standard_session(rig), rig)
    assert found.at_most_s == found.at_least_s > 30
    decided_as_it_goes = {"in_situ"}
    assert {step.planned.name for step in found.steps if not step.segments} <= decided_as_it_goes


def test_what_is_asked_is_what_the_procedures_ask() -> None:
    text = HEAD + '[[step]]\ndo = "imposed"\nvelocities = ["-30 rad/s", "20 rad/s"]\namplitude = "10 %"\ncommands = 1\n'
    *_, imposed = dry_run(parse_session(text, place="s.toml"), RIG).steps
    assert imposed.peaks.velocity_rad_s == pytest.approx(30.0)
    assert imposed.peaks.command == RIG.command.limit
    assert 10.0 < imposed.peaks.travel_rad < 15.0  # 0.35 s at each velocity, and the changes between them
    assert imposed.begins_s > 14.0


def test_repetitions_are_counted_as_often_as_they_may_come() -> None:
    text = HEAD + (
        '[[step]]\ndo = "rest"\nduration = "10 s"\n'
        'repeat_until = { parameter = "inertia", interval = "1 %", at_most = 4 }\n'
    )
    found = dry_run(parse_session(text, place="s.toml"), RIG)
    assert found.at_most_s - found.at_least_s == pytest.approx(30.0)
    first_s = found.steps[2].begins_s
    assert [step.begins_s - first_s for step in found.steps[3:]] == pytest.approx([10.0, 20.0, 30.0])


def limited(**limits: float) -> Rig:
    return replace(RIG, limits=replace(RIG.limits, **limits))


def test_travel_beyond_the_limit_is_told_once_with_its_place() -> None:
    text = HEAD + '[[step]]\ndo = "imposed"\nvelocities = "10:10:40 rad/s"\nrepeat = 2\n'
    with pytest.raises(RigError) as refusal:
        dry_run(parse_session(text, place="s.toml"), limited(position_rad=20.0))
    assert str(refusal.value).startswith(
        "s.toml: [step 3, imposed]: turns the shaft as far as 156 rad, but [limits] position is 20 rad; ask for less"
    )
    assert len(str(refusal.value).splitlines()) == 1


def test_what_the_simulation_reads_is_read_beforehand() -> None:
    wrong = load_rig(ROOT / "rigs" / "sim-odrive.toml")
    wrong = replace(wrong, simulated={**wrong.simulated, "seed": -1})
    with pytest.raises(WiringError, match="seed = -1"):
        dry_run(standard_session(wrong), wrong)
    dry_run(standard_session(wrong), wrong, seed=1)
    text = HEAD + '[[fault]]\nkind = "dorp"\n'
    with pytest.raises(WiringError, match='did you mean "drop"'):
        dry_run(parse_session(text, place="s.toml"), RIG)


def test_nothing_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "load_backend", None)
    hardware = replace(RIG, backend="hardware")
    assert dry_run(load_session(ROOT / "sessions" / "characterise.toml"), hardware).prompts == ()


def test_every_procedure_can_be_walked_through() -> None:
    session = load_session(ROOT / "sessions" / "characterise.toml")
    for made in make_program(session, RIG).every_turn():
        segments = tuple(segments_of(made.action, Knowledge(RIG)))  # type: ignore[arg-type]
        seconds = sum(segment.ticks for segment in segments) * RIG.tick_s
        assert seconds == pytest.approx(made.action.duration_s(RIG), rel=0.1), made.step.do  # type: ignore[union-attr]
        assert peaks_of(segments).command <= RIG.command.limit * (1 + 1e-9)
