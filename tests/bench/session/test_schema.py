"""Session files: steps become options in SI, and every mistake is told with its place and the mend."""

from pathlib import Path

import pytest

from bench.errors import ExitCode, UsageError
from bench.procedures.catalogue import CATALOGUE
from bench.procedures.options import FreeOptions, ImposedOptions, TareOptions
from bench.rig.load import load_rig
from bench.session.program import make_experiment
from bench.session.schema import STEPS, load_session, parse_session, standard_session

ROOT = Path(__file__).parents[3]
SESSIONS = sorted((ROOT / "sessions").glob("*.toml"))


def test_steps_become_options_in_si() -> None:
    session = parse_session(
        'rig = "../rigs/a.toml"\nseed = 4\n'
        '[[step]]\ndo = "tare"\n'
        '[[step]]\ndo = "free"\namplitude = "40 %"\nlevels = 7\ndwell = "300 ms"\n'
        '[[step]]\ndo = "imposed"\nvelocities = "-20:10:20 rad/s"\nduration = "0.5 min"\n',
        place="sessions/s.toml",
    )
    assert session.rig == Path("sessions/../rigs/a.toml")
    assert session.seed == 4
    assert [step.do for step in session.steps] == ["tare", "free", "imposed"]
    tare, free, imposed = (step.options for step in session.steps)
    assert tare == TareOptions()
    assert free == FreeOptions(amplitude=0.4, levels=7, dwell_s=0.3)
    assert imposed == ImposedOptions(velocities_rad_s=(-20, -10, 0, 10, 20), duration_s=30)


def test_velocities_may_be_listed() -> None:
    session = parse_session('[[step]]\ndo = "imposed"\nvelocities = ["60 rpm", "-1 rad/s"]\n', place="s")
    assert session.steps[0].options == ImposedOptions(velocities_rad_s=(pytest.approx(6.283185307), -1))


@pytest.mark.parametrize("name", STEPS)
def test_what_a_file_leaves_out_is_as_the_procedure_has_it(name: str) -> None:
    (step,) = parse_session(f'[[step]]\ndo = "{name}"\n', place="s").steps
    model, options = STEPS[name]
    assert step.options == options()
    assert options(**model().model_dump()) == options()


def test_every_procedure_has_its_step() -> None:
    assert set(STEPS) == set(CATALOGUE)


@pytest.mark.parametrize("path", SESSIONS, ids=lambda path: path.stem)
def test_the_sessions_that_are_shipped_can_run(path: Path) -> None:
    session = load_session(path)
    assert session.rig is not None
    rig = load_rig(session.rig)
    assert len(make_experiment(session, rig).plan) >= len(session.steps)


@pytest.mark.parametrize("path", sorted((ROOT / "rigs").glob("*.toml")), ids=lambda path: path.stem)
def test_the_standard_session_suits_every_rig(path: Path) -> None:
    rig = load_rig(path)
    session = standard_session(rig)
    assert [step.name for step in make_experiment(session, rig).plan] == [step.do for step in session.every_step()]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", 's.toml: [[step]]: there is no step; add a section [[step]], in double brackets, with do = "tare"'),
        ('[step]\ndo = "tare"\n', "s.toml: [[step]]: there is no step; add a section [[step]], in double brackets"),
        ('sed = 1\n[[step]]\ndo = "tare"\n', 's.toml: sed: unknown key; did you mean "seed"?'),
        ('seed = -1\n[[step]]\ndo = "tare"\n', "s.toml: seed: -1 must be at least 0"),
        ("[[step]]\n", "s.toml: [step 1] do: is missing; add do ="),
        ('[[step]]\ndo = "fre"\n', 's.toml: [step 1] do: "fre" is not a procedure; did you mean "free"?'),
        ("[[step]]\ndo = [1]\n", "s.toml: [step 1] do: [1] is not a procedure; known: "),
        ("step = [3]\n", "s.toml: [step 1]: is a section, not 3; write [[step]] on a line of its own"),
        (
            '[[step]]\ndo = "tare"\n[[step]]\ndo = "free"\namplitud = "6 %"\n',
            's.toml: [step 2, free] amplitud: unknown key; did you mean "amplitude"?',
        ),
        ('[[step]]\ndo = "free"\namplitude = 60\n', "s.toml: [step 1, free] amplitude: 60 must be at most 1; write it"),
        ('[[step]]\ndo = "free"\namplitude = "60 rad/s"\n', 's.toml: [step 1, free] amplitude: "60 rad/s" is not in'),
        ('[[step]]\ndo = "tare"\nduration = 2\n', 's.toml: [step 1, tare] duration: "2" has no unit; write it like'),
        (
            '[[step]]\ndo = "blocked"\nlevels = 2.5\n',
            "s.toml: [step 1, blocked] levels: expected a whole number, not 2.5",
        ),
        ('[[step]]\ndo = "imposed"\nvelocities = []\n', "s.toml: [step 1, imposed] velocities: names no velocity"),
        (
            '[[step]]\ndo = "imposed"\nvelocities = "1:2"\n',
            "s.toml: [step 1, imposed] velocities: expected a range such",
        ),
        ("[[step]\n", "s.toml: is not TOML: "),
    ],
)
def test_one_mistake_gives_one_sentence(text: str, said: str) -> None:
    with pytest.raises(UsageError) as refusal:
        parse_session(text, place="s.toml")
    (sentence,) = str(refusal.value).splitlines()
    assert sentence.startswith(said)
    assert refusal.value.exit_code == ExitCode.USAGE


def test_all_mistakes_are_told_at_once() -> None:
    with pytest.raises(UsageError) as refusal:
        parse_session('sed = 1\n[[step]]\ndo = "x"\n[[step]]\ndo = "tare"\nz = 1\nduration = 2\n', place="s")
    assert len(str(refusal.value).splitlines()) == 4
